"""Obstacles shared between vehicles: messages, frames of reference, and what neighbours have reported."""
