"""Accuracy of the model."""
