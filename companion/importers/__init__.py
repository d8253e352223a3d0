"""Recordings of other systems turned into logs."""
