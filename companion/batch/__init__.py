"""Processes many flights again, and searches and compares the results."""
