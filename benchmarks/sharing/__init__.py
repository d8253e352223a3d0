"""Obstacles shared between simulated vehicles, as processes on a lossy radio."""
