"""Other methods on the same frames, side by side."""
