"""Ramps of 1/Z along rows and columns of a depth image: their definition, their number, and their removal.

Used by smeared_edges.py, which decides if the camera smears its edges.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..jit import inner, inner_inline, kernel
from ..types import FAR_MM, GREATEST_MARK_MM, CameraInfo
from .classify import UNKNOWN_INVERSE, inverse_of_row

_FAR = np.uint16(FAR_MM)
_LEAST_MM, _GREATEST_MM = np.uint16(GREATEST_MARK_MM + 1), np.uint16(FAR_MM - 1)
"""Depths that count as measured in the search for ramps, whatever the range of the camera."""
_LEVEL_SHARE = np.float32(0.4)
"""Relative error of the slope of a horizontal surface that is measured over a few pixels."""
_SPAN_PX, _REACH_PX = 4, 24
"""`span_px` and `reach_px` of RampLimits, at an image width of 640."""
_STRAIGHT_SHARE = 0.67
"""Share of its slope that a ramp keeps at most over `reach_px`. A slanted surface keeps all of it."""
_PASSING_M = 1.0
"""A ramp, continued, passes the camera nearer than this."""
_INCIDENCE_DEG = 80.0
"""A ramp is a surface seen at more than this angle from its normal."""
_SIGMAS, _JUDGED_SIGMAS = 2.0, 5.0
"""Least rise of a ramp on each side, in noise: to be removed, and to count in the judgement of the camera."""


class RampLimits(NamedTuple):
    """Limits that define a ramp."""

    span_px: int  # distance from a pixel to the two pixels it is compared with
    reach_px: int  # distance from a pixel to the pixel beyond the near end of a ramp
    step_per_m: float  # least step of 1/Z to each of the pixels span_px away, 1/m
    # the same for the edges by which the camera is judged, 1/m. It is so large that noise does not reach it.
    judged_per_m: float
    relative: float  # least step as a share of the pixel's own 1/Z
    straight: float  # greatest change of 1/Z over reach_px towards the near side, relative to the change over span_px


class Slopes(NamedTuple):
    """Limits of `on_ramp`, float32: `step_per_m` or `judged_per_m`, `relative` and `straight` of RampLimits."""

    least: Any
    relative: Any
    straight: Any


class HeightLine(NamedTuple):
    """Height of pixels below the camera along the normal of the ground.

    A point at pixel (u, v) lies across u + down v + first below the camera per metre of depth."""

    across: float  # across, down, first: see above
    down: float
    first: float
    keep_m: float  # pixels that lie lower than this are part of the ground


def ramp_limits(info: CameraInfo, ke_per_m: float) -> RampLimits:
    """Returns the limits for a camera and the noise coefficient in use."""
    k = info.intrinsics
    span = max(round(_SPAN_PX * k.width / 640), 1)
    reach = max(round(_REACH_PX * k.width / 640), span + 1)
    angle = span / k.fx
    return RampLimits(
        span_px=span,
        reach_px=reach,
        step_per_m=max(angle / _PASSING_M, _SIGMAS * ke_per_m),
        judged_per_m=max(angle / _PASSING_M, _JUDGED_SIGMAS * ke_per_m),
        relative=angle * math.tan(math.radians(_INCIDENCE_DEG)),
        straight=max(_STRAIGHT_SHARE * reach / span, 1.0),
    )


@inner_inline
def on_ramp(left, middle, right, far_left, far_right, slopes):
    """True if the middle of five values of 1/Z along a line lies on a ramp.

    If 1/Z beyond the near end is unknown, a slanted surface looks the same, and the result is False.
    left, middle, right: 1/Z in 1/m of `inverse_of_row`, span_px apart. far_left, far_right: 1/Z reach_px from
    the middle."""
    low, high = min(left, right), max(left, right)
    step = max(slopes.least, slopes.relative * middle)
    beyond = far_left if left > right else far_right
    return (
        (low >= np.float32(0.0))
        & (middle - low > step)
        & (high - middle > step)
        & (beyond >= np.float32(0.0))
        & (beyond - middle <= slopes.straight * (high - middle))
    )


@kernel
def count_edges(depth_mm, row_step, limits):
    """Returns (ramps, rising, steps) along every row_step-th row of depth_mm, (H, W) uint16.

    A ramp is a run of pixels for which `on_ramp` is True; 1/Z of the rising ones is greater to the right. A step is a
    change from one pixel to the next that is as large as the least ramp from end to end. One of its two pixels may be
    far. limits: RampLimits; the least step is judged_per_m."""
    rows, cols = depth_mm.shape
    span, reach = limits.span_px, limits.reach_px
    line = np.full(cols + 2 * reach, UNKNOWN_INVERSE, np.float32)
    on = np.zeros(cols + 1, np.uint8)
    slopes = Slopes(np.float32(limits.judged_per_m), np.float32(limits.relative), np.float32(limits.straight))
    ramps, rising, steps = np.int64(0), np.int64(0), np.int64(0)
    for v in range(row_step // 2, rows, row_step):
        inverse_of_row(depth_mm[v], _LEAST_MM, _GREATEST_MM, line[reach : reach + cols])
        far_left, left = line[:cols], line[reach - span : reach - span + cols]
        middle, right, far_right = line[reach : reach + cols], line[reach + span :], line[2 * reach :]
        following = line[reach + 1 :]
        row_ramps, row_rising, row_steps = np.int32(0), np.int32(0), np.int32(0)
        for u in range(cols):
            here = on_ramp(left[u], middle[u], right[u], far_left[u], far_right[u], slopes)
            on[u + 1] = np.uint8(here)
        for u in range(cols):
            a, b = middle[u], following[u]
            low, high = min(a, b), max(a, b)
            sharp = (low >= np.float32(0.0)) & (high - low > np.float32(2.0) * max(slopes.least, slopes.relative * low))
            row_steps = np.int32(row_steps + np.int32(sharp))
            begins = np.int32(on[u + 1] & ~on[u] & np.uint8(1))
            row_ramps = np.int32(row_ramps + begins)
            row_rising = np.int32(row_rising + (begins & np.int32(right[u] > left[u])))
        ramps += row_ramps
        rising += row_rising
        steps += row_steps
    return ramps, rising, steps


@inner_inline
def is_level(change, middle, height, more):
    """True if 1/Z changes along the image as on a horizontal surface, within _LEVEL_SHARE.

    On a horizontal surface 1/Z is proportional to the height of the pixel below the camera per metre of depth.

    Args:
        change: difference of 1/Z between two pixels, 1/m.
        middle: 1/Z in the middle between them, 1/m.
        height: height below the camera per metre of depth, in the middle.
        more: change of that height between the two pixels."""
    expected = middle * more
    return abs(change * height - expected) <= _LEVEL_SHARE * abs(expected)


@inner
def near_end_inverse(inverse, row, column, span, reach):
    """Returns 1/Z of the near surface beside the ramp at inverse[row, column].

    It is the greatest 1/Z within half of `reach` along its row and its column, in steps of `span`."""
    near = inverse[row, column]
    for k in range(1, reach // (2 * span) + 1):
        off = k * span
        near = max(near, max(inverse[row, column - off], inverse[row, column + off]))
        near = max(near, max(inverse[row - off, column], inverse[row + off, column]))
    return near


@inner
def inverse_with_border(depth_mm, reach, inverse):
    """Fills `inverse` (H + 2 reach, W + 2 reach) by `inverse_of_row` of depth_mm (H, W); the border is unknown."""
    rows, cols = depth_mm.shape
    inverse[:reach] = UNKNOWN_INVERSE
    inverse[rows + reach :] = UNKNOWN_INVERSE
    inverse[:, :reach] = UNKNOWN_INVERSE
    inverse[:, cols + reach :] = UNKNOWN_INVERSE
    for v in range(rows):
        inverse_of_row(depth_mm[v], _LEAST_MM, _GREATEST_MM, inverse[reach + v, reach : reach + cols])


@inner
def ramps_of_row(inverse, v, limits, heights, on):
    """Sets on[u] where pixel (v, u) lies on a ramp and not on a horizontal surface; returns the number of these pixels.

    Args:
        inverse: (H + 2 reach, W + 2 reach) float32 of `inverse_with_border`.
        limits: RampLimits; the least step is step_per_m.
        on: (W,) uint8 out, 1 or 0."""
    cols, span, reach = len(on), limits.span_px, limits.reach_px
    row = inverse[reach + v]
    far_left, left = row[:cols], row[reach - span : reach - span + cols]
    middle, right, far_right = row[reach : reach + cols], row[reach + span :], row[2 * reach :]
    far_above, above = inverse[v, reach:], inverse[reach + v - span, reach:]
    below, far_below = inverse[reach + v + span, reach:], inverse[v + 2 * reach, reach:]
    slopes = Slopes(np.float32(limits.step_per_m), np.float32(limits.relative), np.float32(limits.straight))
    keep, across, down = np.float32(heights.keep_m), np.float32(heights.across), np.float32(heights.down)
    first, twice = np.float32(heights.down * v + heights.first), np.float32(2 * span)
    count = np.int32(0)
    for u in range(cols):
        m = middle[u]
        height = first + across * np.float32(np.int32(u))
        ramp = on_ramp(left[u], m, right[u], far_left[u], far_right[u], slopes)
        ramp &= ~is_level(right[u] - left[u], m, height, twice * across)
        steep = on_ramp(above[u], m, below[u], far_above[u], far_below[u], slopes)
        ramp |= steep & ~is_level(below[u] - above[u], m, height, twice * down)
        ramp &= height <= keep * m
        on[u] = np.uint8(ramp)
        count = np.int32(count + np.int32(ramp))
    return count


@kernel
def drop_ramps(depth_mm, inverse, limits, heights, marks, free_marks):
    """Makes the pixels of ramps along rows or columns unknown; returns how many of them were measured and how many
    far.

    The ground is kept, and so are horizontal surfaces at any height.

    Args:
        depth_mm: (H, W) uint16 as delivered, so that the far end of a ramp may lie beyond the clear range.
        inverse: (H + 2 reach, W + 2 reach) float32 scratch.
        limits: RampLimits; the least step is step_per_m.
        marks: (H, W) uint16 of `classify`, in and out.
        free_marks: (H, W) uint16 out: the marks before the removal, with the depth of the near end at each pixel of a
            ramp. The ray is measured up to that depth."""
    rows, cols = depth_mm.shape
    span, reach = limits.span_px, limits.reach_px
    inverse_with_border(depth_mm, reach, inverse)
    on = np.zeros(cols, np.uint8)
    measured, far = 0, 0
    for v in range(rows):
        line, seen = marks[v], free_marks[v]
        seen[:] = line
        if ramps_of_row(inverse, v, limits, heights, on) == 0:
            continue
        for u in range(cols):
            if on[u] and line[u] != 0:
                if line[u] == _FAR:
                    far += 1
                else:
                    measured += 1
                near = near_end_inverse(inverse, reach + v, reach + u, span, reach)
                near_mm = np.float32(1000.0) / near
                seen[u] = np.uint16(min(max(near_mm, np.float32(1.0)), np.float32(line[u])))
                line[u] = np.uint16(0)
    return measured, far
