"""Live stream, figures, report."""
