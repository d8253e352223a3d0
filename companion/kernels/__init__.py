"""Compiling kernels ahead of time and keeping them on disk."""
