"""Scenes with moving solids: the scene at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .ray_caster import CONVEX, CYLINDER, PLANE
from .scenes import Scene


def moved(scene: Scene, t_s: float) -> Scene:
    """The scene after t_s seconds: each solid shifted by its velocity times the time, without a rotation. The scene itself
    where nothing moves. Raises ValueError for a ground with a velocity."""
    if not len(scene.velocity_m_s):
        return scene
    rows, corners, halfspaces = scene.rows.copy(), scene.corners.copy(), scene.halfspaces.copy()
    for k in np.flatnonzero(scene.velocity_m_s.any(axis=1)):
        shift = scene.velocity_m_s[k] * t_s
        corners[k] += shift
        if scene.kinds[k] == PLANE:
            raise ValueError(f"scene {scene.name}: an endless plane has a velocity; only solids with bounds can move")
        if scene.kinds[k] == CONVEX:
            first, count = int(rows[k, 0]), int(rows[k, 1])
            halfspaces[first : first + count, 3] += halfspaces[first : first + count, :3] @ shift
            continue
        rows[k, 0:3] += shift
        if scene.kinds[k] == CYLINDER:
            rows[k, 3:6] += shift
    return replace(scene, rows=rows, corners=corners, halfspaces=halfspaces)
