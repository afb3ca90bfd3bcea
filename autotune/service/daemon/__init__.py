"""The service: configuration, schedule, jobs, history, HTTP API, metrics, notices."""
