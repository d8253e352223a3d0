"""Pictures and pages drawn from a log or from the running service."""
