"""The configuration: sections, their ranges, loading, checking and documenting them."""
