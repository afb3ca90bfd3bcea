"""Effects: pure mathematics and compiled kernels; DriveModel = inertia + effects."""
