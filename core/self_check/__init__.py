"""Checks of the set-up from what the camera measures: its mount, and its exposure stamps."""
