"""The simulated flight that `companion demo` runs."""
