"""Self-checks of the cameras' mounts and exposure stamps while the service runs."""
