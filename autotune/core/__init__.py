"""Errors, axis, drive protocol, recording: the vocabulary of every layer."""
