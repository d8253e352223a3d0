"""Reads MCAP files and encodes and decodes their messages."""
