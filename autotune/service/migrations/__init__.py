"""Alembic migrations of the history; run by the service itself when it opens a database."""
