"""What is sent to and read from the autopilot: obstacle distances, failsafe, parameters, texts."""
