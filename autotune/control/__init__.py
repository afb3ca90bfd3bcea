"""Feedforward, adaptation, PID synthesis, stability."""
