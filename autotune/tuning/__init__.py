"""Tuning run, proof, commit, journal and recovery."""
