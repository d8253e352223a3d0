"""Compiles kernels ahead of time and keeps them on disk."""
