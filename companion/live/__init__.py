"""The running service: its threads, its health and its main loop."""
