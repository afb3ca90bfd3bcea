"""Kinds of recordings as evidence: repeated programmes, single recordings, speed curves."""
