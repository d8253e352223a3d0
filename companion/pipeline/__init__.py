"""The pipeline from depth, attitude and position to published models."""
