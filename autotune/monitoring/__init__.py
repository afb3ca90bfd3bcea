"""The daily check of an axis: has it drifted, and what its history says."""
