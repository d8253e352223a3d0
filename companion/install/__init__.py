"""Installing and removing the systemd service."""
