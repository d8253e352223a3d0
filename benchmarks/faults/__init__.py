"""Random faults of camera, autopilot, link and computer, on the whole path from depth to OBSTACLE_DISTANCE, in simulated time."""
