"""How PX4 and ArduPilot read obstacle messages, for tests and simulation."""
