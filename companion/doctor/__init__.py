"""Checks of cameras, autopilot, log and kernels before a flight."""
