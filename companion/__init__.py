"""The service around the core: configuration, time matching, pipeline, logs, commands."""
