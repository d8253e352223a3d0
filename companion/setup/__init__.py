"""Writes a configuration for the devices that are connected."""
