"""The merged world held against the truth, its cost and its size."""
