"""Rough surfaces in contact: what stiffness at rest, break-away and Dahl's curve come from (thesis, chapter 2)."""
