"""Obstacles shared with other vehicles: what is sent, what is received, and where it goes."""
