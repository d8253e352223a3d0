"""Rendered grey image pairs of simulated scenes, and the stereo matching of several cameras."""
