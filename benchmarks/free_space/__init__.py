"""Claimed free space against the true geometry, in the whole volume of each cell."""
