"""Several axes, looked after for years: schedule, jobs, history, HTTP, locks."""
