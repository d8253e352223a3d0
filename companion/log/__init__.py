"""MCAP logs: writing, recording in flight, reading what is in them, repairing them."""
