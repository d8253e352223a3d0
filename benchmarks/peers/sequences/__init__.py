"""Methods that merge the frames of a flight: the same frames and poses for all, the same judge."""
