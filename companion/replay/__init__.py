"""Replaying a log through the pipeline and comparing the results."""
