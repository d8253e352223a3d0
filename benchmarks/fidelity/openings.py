"""How large an opening of a wall is in a model: the largest free rectangle on the wall's plane around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.frames import horizontal_heading_rad, rotation_level_ned
from drivers.simulation.scenes import Opening
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]

STEP_M = 0.01
BORDER_M = 0.25
"""How far beyond the true opening a free rectangle may reach."""
REACH_M = 0.75
"""Planes within this distance of the wall's plane close it."""
HIDDEN_M = 0.5
"""An object this much nearer than the opening hides it."""


PASSABLE_M = (2.0, 1.0)
"""Width and height that the vehicle passes (Ws, Hs): smaller openings are filled, others must stay open."""
SHRINK_M = (0.2, 0.1)
"""Allowed loss of an opening's size, by the paper's figure: 2.9 x 2.1 m was measured as 2.7 x 2.0 m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpeningSize:
    """width_m, height_m: the largest free rectangle; free_share: of the true opening's area that the model
    leaves free; passable: whether a rectangle of PASSABLE_M is free; kept: whether one of the true size less
    SHRINK_M is. distance_m: to its middle; angle_deg: of the view against straight on; px_m: what a pixel
    spans there."""

    true_width_m: float
    true_height_m: float
    width_m: float
    height_m: float
    free_share: float
    passable: bool
    kept: bool
    distance_m: float
    angle_deg: float
    px_m: float

    @property
    def to_be_passed(self) -> bool:
        """Whether the true opening is one that the vehicle passes."""
        return self.true_width_m >= PASSABLE_M[0] and self.true_height_m >= PASSABLE_M[1]

    @property
    def too_large(self) -> bool:
        """Whether the model's opening is larger than the true one by more than a pixel on each side."""
        slack = 2.0 * self.px_m + 2.0 * STEP_M
        return self.width_m > self.true_width_m + slack or self.height_m > self.true_height_m + slack


def in_view(opening: Opening, frame: Rendered) -> bool:
    """Whether the camera sees the opening with its border unobstructed, so that its size can be measured."""
    a, b = np.array(opening.a_m), np.array(opening.b_m)
    out = (b - a) / math.dist(opening.a_m, opening.b_m) * BORDER_M
    frame_m = (opening.top_m - BORDER_M, opening.bottom_m + BORDER_M)
    corners = [_pixel(np.array([*xy, z]), frame) for xy in (a - out, b + out) for z in frame_m]
    if any(corner is None for corner in corners):
        return False
    for across in np.linspace(0.05, 0.95, 7):
        for z in np.linspace(opening.top_m, opening.bottom_m, 7)[1:-1]:
            seen = _pixel(np.array([*(a + across * (b - a)), z]), frame)
            if seen is None or frame.truth.depth_m[seen[1], seen[0]] < seen[2] - HIDDEN_M:
                return False
    return True


def _pixel(point_ned_m: Floats, frame: Rendered) -> tuple[int, int, float] | None:
    """Column, row and depth of a point in the image; None outside of it."""
    k = frame.info.intrinsics
    p = (point_ned_m - frame.position_ned_m) @ frame.R_ned_optical
    if p[2] <= 0.0:
        return None
    u, v = k.fx * p[0] / p[2] + k.cx, k.fy * p[1] / p[2] + k.cy
    if not (0.0 <= u <= k.width - 1 and 0.0 <= v <= k.height - 1):
        return None
    return round(u), round(v), float(p[2])


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
    ground = frame.scene.ground
    floor = ground.z_m + ground.slope_x * opening.a_m[0] + ground.slope_y * opening.a_m[1] - opening.top_m
    free[max(0, round((floor + BORDER_M) / STEP_M)) :] = False  # the ground closes what lies below it
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
    middle = np.array([*(0.5 * (a + b)[:2]), 0.5 * (top + bottom)])
    distance = float(np.linalg.norm(middle))
    straight = abs(float(middle[:2] @ [-along[1], along[0]])) / distance
    return OpeningSize(
        true_width_m=width,
        true_height_m=height,
        width_m=columns * STEP_M,
        height_m=rows * STEP_M,
        free_share=float(inside.mean()),
        passable=_fits(free, *PASSABLE_M),
        kept=_fits(free, width - SHRINK_M[0], height - SHRINK_M[1]),
        distance_m=distance,
        angle_deg=math.degrees(math.acos(min(1.0, straight))),
        px_m=distance / frame.info.intrinsics.fx,
    )


def _fits(free: NDArray[np.bool_], width_m: float, height_m: float) -> bool:
    """Whether a rectangle of a size is free somewhere."""
    w, h = round(width_m / STEP_M), round(height_m / STEP_M)
    if not (0 < w <= free.shape[1] and 0 < h <= free.shape[0]):
        return False
    total = np.pad(free.astype(np.int64), ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    inside = total[h:, w:] - total[:-h, w:] - total[h:, :-w] + total[:-h, :-w]
    return bool((inside == w * h).any())


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
