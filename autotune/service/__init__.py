"""Tuning run, commit, journal and store."""
