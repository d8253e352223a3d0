"""Tracked obstacles: the planes of a camera's frames, associated and filtered over time.

Names of parameters that mean the same in all modules; docstrings say what differs. Lengths are in metres, angles in rad,
stamps (`..._ns`) in ns. Places are in the axes of TrackingFrame, z down.

    table            TrackTable; tracks: its (T,) TRACK; j: a slot of it, k: a cell of the slot
    t, track, other  a record of TRACK
    detections       (N,) DETECTION of the frame; d, e: one of them, i: its index
    pairs, scores    (P, 3) int32 and (P,) float64 of `find_pairs`
    gate             Gate; gate_m: a distance from the line of a track
    low, high, s     places along the line of a track, from its anchor
    ax, ay, bx, by   ends of a plane, a to b; free space on the right
    x, y             a place; x_m, y_m: that of the camera
    top, bottom      heights; top is the lesser z
    eye              (x, y, z) of the camera; eye_z: the last of them
    exposure         Exposure; t_ns: of the frame, dt_s: since the frame before
    view             FreeView of the frame; limits: its directions of `measured_limits`
    groups, objects  (G,) GROUP and (M,) OBJECT; g, o: one of them
    next_id          id of the next track or object; functions that use it return the one after"""
