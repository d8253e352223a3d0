"""Three-valued queries: free, occupied or unknown."""
