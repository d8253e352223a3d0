"""The simulator: scenes, ray caster, sensor model, flights, simulated camera and autopilot."""
