"""Random valid configurations, on the whole path from the file to OBSTACLE_DISTANCE, the guard, a replay and the client."""
