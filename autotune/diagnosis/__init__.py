"""Compare, localise, rank, verdict, next experiment."""
