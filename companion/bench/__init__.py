"""`companion bench`: the speed of the algorithm on this machine."""
