"""Checks of the set-up while the service runs: mounts and exposure stamps of the cameras."""
