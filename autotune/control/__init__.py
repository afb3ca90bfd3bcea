"""Feedforward, adaptation and refinement of fixed parameters."""
