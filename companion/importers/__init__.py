"""Conversion of other recordings into logs."""
