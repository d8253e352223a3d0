"""Closed loops of the output to the autopilot with models of its firmware."""
