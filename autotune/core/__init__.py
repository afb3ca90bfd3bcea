"""Errors, axis, drive and loop: the vocabulary of every layer."""
