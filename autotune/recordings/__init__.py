"""Recordings: in memory, as files, imported from others, and played as a drive."""
