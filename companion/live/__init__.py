"""The live service: its threads, its health report and its main loop."""
