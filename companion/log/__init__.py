"""MCAP logs: recording, writing, inspecting and repairing."""
