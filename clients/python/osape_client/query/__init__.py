"""Queries of the newest frames: free, occupied or unknown."""
