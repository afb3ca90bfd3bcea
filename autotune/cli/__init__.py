"""Arguments in, text and exit codes out; puts the parts together."""
