"""Camera processes: one worker process per camera, its supervision and its masks."""
