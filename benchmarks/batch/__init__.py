"""Simulated fleets, and what `companion batch` takes for them."""
