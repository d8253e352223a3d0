"""Draws pictures and pages of a log or of the running service."""
