"""Writes the results of a log in formats of other programs."""
