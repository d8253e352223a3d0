"""Time and memory: of a frame, of the live service, of a start."""
