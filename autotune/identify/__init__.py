"""Recordings to parameters with uncertainty and validity."""
