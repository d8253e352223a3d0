"""Replays a log through the pipeline and compares the results."""
