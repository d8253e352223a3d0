"""The scenes that the experiments run on."""
