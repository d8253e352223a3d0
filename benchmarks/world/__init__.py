"""Accuracy, cost and size of the merged world."""
