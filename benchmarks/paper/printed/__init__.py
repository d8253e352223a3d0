"""The algorithm as the paper prints it, for comparison only: no command of the service can reach it."""
