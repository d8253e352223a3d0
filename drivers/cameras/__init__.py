"""Drivers of depth cameras and the channel for their frames."""
