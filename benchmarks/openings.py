"""How large an opening of a wall is in a model: the largest free rectangle on the wall's plane around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import horizontal_heading_rad, rotation_level_ned
from drivers.scenes import Opening
from drivers.simulated import Rendered

Floats = NDArray[np.float64]

STEP_M = 0.01
BORDER_M = 0.25
"""How far beyond the true opening a free rectangle may reach."""
REACH_M = 0.75
"""Planes within this distance of the wall's plane close it."""


@dataclass(frozen=True, slots=True)
class OpeningSize:
    """width_m, height_m: the largest free rectangle; free_share: of the true opening's area that the model
    leaves free."""

    true_width_m: float
    true_height_m: float
    width_m: float
    height_m: float
    free_share: float


def in_view(opening: Opening, frame: Rendered) -> bool:
    """Whether the camera sees the opening with the border around it, so that its size can be asked for."""
    a, b = np.array(opening.a_m), np.array(opening.b_m)
    out = (b - a) / math.dist(opening.a_m, opening.b_m) * BORDER_M
    k = frame.info.intrinsics
    for x, y in (a - out, b + out):
        for z in (opening.top_m - BORDER_M, opening.bottom_m + BORDER_M):
            p = (np.array([x, y, z]) - frame.position_ned_m) @ frame.R_ned_optical
            if p[2] <= 0.0:
                return False
            u, v = k.fx * p[0] / p[2] + k.cx, k.fy * p[1] / p[2] + k.cy
            if not (0.0 <= u <= k.width - 1 and 0.0 <= v <= k.height - 1):
                return False
    return True


def opening_size(opening: Opening, frame: Rendered, planes: Floats) -> OpeningSize:
    """The size that an opening has in a model (planes (N, 6), level_cam) of a frame."""
    to_level = rotation_level_ned(horizontal_heading_rad(frame.R_ned_optical))
    a = to_level @ (np.array([*opening.a_m, 0.0]) - frame.position_ned_m)
    b = to_level @ (np.array([*opening.b_m, 0.0]) - frame.position_ned_m)
    top, bottom = opening.top_m - frame.position_ned_m[2], opening.bottom_m - frame.position_ned_m[2]
    width, height = math.dist(a[:2], b[:2]), bottom - top
    border = round(BORDER_M / STEP_M)
    across, down = round(width / STEP_M) + 2 * border, round(height / STEP_M) + 2 * border
    free = np.ones((down, across), np.bool_)
    along = (b[:2] - a[:2]) / width
    for p in np.asarray(planes, np.float64):
        span = _crossing(p, a[:2], along)
        if span is None:
            continue
        first, last = (round((s + BORDER_M) / STEP_M) for s in span)
        upper, lower = (round((z - top + BORDER_M) / STEP_M) for z in (p[4], p[5]))
        free[max(0, upper) : max(0, lower), max(0, first) : max(0, last, first + 1)] = False
    rows, columns = _largest_rectangle(free)
    inside = free[border : down - border, border : across - border]
    return OpeningSize(width, height, columns * STEP_M, rows * STEP_M, float(inside.mean()))


def _crossing(plane: Floats, a: Floats, along: Floats) -> tuple[float, float] | None:
    """The part of a plane within REACH_M of the wall's plane, as coordinates along the wall from a."""
    normal = np.array([-along[1], along[0]])
    ends = plane[:4].reshape(2, 2) - a
    s, d = ends @ along, ends @ normal
    if d[0] == d[1]:
        return (float(s.min()), float(s.max())) if abs(d[0]) <= REACH_M else None
    low, high = sorted(((-REACH_M - d[0]) / (d[1] - d[0]), (REACH_M - d[0]) / (d[1] - d[0])))
    low, high = max(0.0, low), min(1.0, high)
    if low > high:
        return None
    both = s[0] + np.array([low, high]) * (s[1] - s[0])
    return float(both.min()), float(both.max())


def _largest_rectangle(free: NDArray[np.bool_]) -> tuple[int, int]:
    """Rows and columns of the largest all-True rectangle by area (stack over the histogram of each row)."""
    best, shape = 0, (0, 0)
    tall = np.zeros(free.shape[1] + 1, np.int64)
    for row in free:
        tall[:-1] = np.where(row, tall[:-1] + 1, 0)
        stack: list[tuple[int, int]] = []
        for i, h in enumerate(tall.tolist()):
            start = i
            while stack and stack[-1][1] >= h:
                start, high = stack.pop()
                if high * (i - start) > best:
                    best, shape = high * (i - start), (high, i - start)
            stack.append((start, h))
    return shape
