"""Tracked obstacles: the planes of a camera's frames, associated and filtered over time."""
