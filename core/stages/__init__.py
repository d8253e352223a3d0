"""The stages of the algorithm, one module each."""
