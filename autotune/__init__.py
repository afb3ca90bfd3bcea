"""autotune: tunes servo axes by experiment, model and proof."""

__version__ = "0.1.0"
