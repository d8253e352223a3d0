"""Drivers of depth cameras and the channel that carries their frames."""
