"""Experiments with numbers: fidelity of the model on scenes with known truth, and what it is compared
with."""
