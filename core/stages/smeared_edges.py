"""Removes smeared edges: ramps of disparity between a near and a far surface where there is no surface.

Input: the depth image, the marks of `classify` and the counts of edges in `ExtractorState`. Output: the marks with
ramps made unknown, an image for the free space, and the next state. The paper has no such stage.

A stereo matcher compares windows of pixels. Where a window contains two surfaces, many cameras deliver a disparity
between both, so that a step of the scene becomes a ramp 10 to 40 px wide. Each pixel of a ramp is plausible by itself
and stable from frame to frame.

Three conditions distinguish a ramp from a slanted surface:

- It is so steep that a surface that continued it would pass close to the camera.
- It is narrow: beyond its near end the depth is known and does not continue the slope of 1/Z. Where that depth is
  unknown (a hole, the border of the image), the pixel is kept and does not count as evidence.
- Nearly all edges of the image are ramps. This is judged from the edges of several frames, or of one frame if it has
  many edges and nearly all are ramps. Until then, and for cameras with sharp edges, all pixels are kept."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..frames import Rotation
from ..jit import inner, inner_ieee, inner_inline, kernel
from ..params import Params
from ..types import FAR_MM, GREATEST_MARK_MM, SATURATED_MM, CameraInfo, ExtractorState, Ground

_SATURATED, _FAR = np.uint16(SATURATED_MM), np.uint16(FAR_MM)
_GREATEST_MARK = np.uint16(GREATEST_MARK_MM)
_ROW_STEP = 4
"""Edges are counted in every _ROW_STEP-th row."""
_NEVER_M = 1e9
_LEVEL_SHARE = np.float32(0.4)
"""Relative error of the slope of a horizontal surface that is measured over a few pixels. It is not a tuning
parameter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RampLimits:
    """Limits that define a ramp.

    Attributes:
        span_px: distance from a pixel to the two pixels it is compared with.
        reach_px: distance from a pixel to the pixel beyond the near end of a ramp.
        step_per_m: least step of 1/Z to each of the pixels span_px away, 1/m.
        judged_per_m: the same for the edges by which the camera is judged, 1/m. It is so large that noise does not
            reach it.
        relative: least step as a share of the pixel's own 1/Z.
        straight: greatest change of 1/Z over reach_px towards the near side, relative to the change over span_px."""

    span_px: int
    reach_px: int
    step_per_m: float
    judged_per_m: float
    relative: float
    straight: float


def ramp_limits(info: CameraInfo, ke_per_m: float, params: Params) -> RampLimits:
    """Returns the limits for a camera and the noise coefficient in use."""
    p, k = params, info.intrinsics
    span = max(round(p.smear_span_px * k.width / 640), 1)
    reach = max(round(p.smear_reach_px * k.width / 640), span + 1)
    angle = span / k.fx
    return RampLimits(
        span_px=span,
        reach_px=reach,
        step_per_m=max(angle / p.smear_passing_m, p.smear_sigmas * ke_per_m),
        judged_per_m=max(angle / p.smear_passing_m, p.smear_judged_sigmas * ke_per_m),
        relative=angle * math.tan(math.radians(p.smear_incidence_deg)),
        straight=max(p.smear_straight_share * reach / span, 1.0),
    )


@inner_inline
def on_ramp(left, middle, right, far_left, far_right, least, relative, straight):
    """True if the middle of five values of 1/Z along a line lies on a ramp.

    If 1/Z beyond the near end is unknown, a slanted surface looks the same, and the result is False.

    Args:
        left, middle, right: 1/Z in 1/m, span_px apart; 0: far, negative: unknown.
        far_left, far_right: 1/Z reach_px from the middle.
        least, relative, straight: step_per_m, relative and straight of `RampLimits`."""
    low, high = min(left, right), max(left, right)
    step = max(least, relative * middle)
    beyond = far_left if left > right else far_right
    return (
        (low >= np.float32(0.0))
        & (middle - low > step)
        & (high - middle > step)
        & (beyond >= np.float32(0.0))
        & (beyond - middle <= straight * (high - middle))
    )


@inner_ieee
def signed_inverse(mm, out):
    """Computes 1/Z in 1/m of one row: 0 where the sensor reports far, -1 where it reports nothing. out: float32."""
    for u in range(len(mm)):
        z = mm[u]
        d = np.float32(1000.0) / np.float32(z)
        if z == _FAR:
            d = np.float32(0.0)
        if (z <= _GREATEST_MARK) | (z == _SATURATED):
            d = np.float32(-1.0)
        out[u] = d


@kernel
def count_edges(depth_mm, row_step, span, reach, least, relative, straight):
    """Returns (ramps, steps) along every row_step-th row of depth_mm, (H, W) uint16.

    A ramp is a run of pixels for which `on_ramp` is True. A step is a change from one pixel to the next that is as
    large as the least ramp from end to end. One of its two pixels may be far. The other arguments are those of
    `RampLimits`."""
    rows, cols = depth_mm.shape
    line = np.full(cols + 2 * reach, np.float32(-1.0), np.float32)
    on = np.zeros(cols + 1, np.uint8)
    least, relative, straight = np.float32(least), np.float32(relative), np.float32(straight)
    ramps, steps = np.int64(0), np.int64(0)
    for v in range(row_step // 2, rows, row_step):
        signed_inverse(depth_mm[v], line[reach : reach + cols])
        far_left, left = line[:cols], line[reach - span : reach - span + cols]
        middle, right, far_right = line[reach : reach + cols], line[reach + span :], line[2 * reach :]
        following = line[reach + 1 :]
        row_ramps, row_steps = np.int32(0), np.int32(0)
        for u in range(cols):
            here = on_ramp(left[u], middle[u], right[u], far_left[u], far_right[u], least, relative, straight)
            on[u + 1] = np.uint8(here)
        for u in range(cols):
            a, b = middle[u], following[u]
            low, high = min(a, b), max(a, b)
            sharp = (low >= np.float32(0.0)) & (high - low > np.float32(2.0) * max(least, relative * low))
            row_steps = np.int32(row_steps + np.int32(sharp))
            row_ramps = np.int32(row_ramps + np.int32(on[u + 1] & ~on[u] & np.uint8(1)))
        ramps += row_ramps
        steps += row_steps
    return ramps, steps


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
def near_end(inverse, row, column, span, reach, middle):
    """Returns 1/Z of the near surface beside the ramp at inverse[row, column].

    It is the greatest 1/Z within half of `reach` along its row and its column, in steps of `span`."""
    near = middle
    for k in range(1, reach // (2 * span) + 1):
        off = k * span
        near = max(near, max(inverse[row, column - off], inverse[row, column + off]))
        near = max(near, max(inverse[row - off, column], inverse[row + off, column]))
    return near


@kernel
def drop_ramps(depth_mm, inverse, span, reach, least, relative, straight, down, keep_m, marks, seen_to):
    """Makes the pixels of ramps along rows or columns unknown; returns how many of them were measured and how many
    far.

    A pixel more than keep_m below the camera is part of the ground and is kept, and so are horizontal surfaces at any
    height.

    Args:
        depth_mm: (H, W) uint16 as delivered, so that the far end of a ramp may lie beyond the clear range.
        inverse: (H + 2 reach, W + 2 reach) float32 scratch.
        span, reach, least, relative, straight: see `RampLimits`.
        down: (3,) float64. A point at pixel (u, v) lies down[0] u + down[1] v + down[2] below the camera per metre of
            depth, along the normal of the ground.
        keep_m: height below the camera.
        marks: (H, W) uint16 of `classify`, in and out.
        seen_to: (H, W) uint16 out: the marks before the removal, with the depth of the near end at each pixel of a
            ramp. The ray is measured up to that depth."""
    rows, cols = depth_mm.shape
    nothing = np.float32(-1.0)
    inverse[:reach] = nothing
    inverse[rows + reach :] = nothing
    inverse[:, :reach] = nothing
    inverse[:, cols + reach :] = nothing
    for v in range(rows):
        signed_inverse(depth_mm[v], inverse[reach + v, reach : reach + cols])
    least, relative, straight = np.float32(least), np.float32(relative), np.float32(straight)
    keep, across, along, twice = np.float32(keep_m), np.float32(down[0]), np.float32(down[1]), np.float32(2 * span)
    column, on = np.arange(cols).astype(np.float32), np.zeros(cols, np.uint8)
    measured, far = 0, 0
    for v in range(rows):
        row = inverse[reach + v]
        far_left, left = row[:cols], row[reach - span : reach - span + cols]
        middle, right, far_right = row[reach : reach + cols], row[reach + span :], row[2 * reach :]
        far_above, above = inverse[v, reach:], inverse[reach + v - span, reach:]
        below, far_below = inverse[reach + v + span, reach:], inverse[v + 2 * reach, reach:]
        first = np.float32(down[1] * v + down[2])
        line, seen = marks[v], seen_to[v]
        count = np.int32(0)
        for u in range(cols):
            m = middle[u]
            height = first + across * column[u]
            ramp = on_ramp(left[u], m, right[u], far_left[u], far_right[u], least, relative, straight)
            ramp &= ~is_level(right[u] - left[u], m, height, twice * across)
            steep = on_ramp(above[u], m, below[u], far_above[u], far_below[u], least, relative, straight)
            ramp |= steep & ~is_level(below[u] - above[u], m, height, twice * along)
            ramp &= height <= keep * m
            on[u] = np.uint8(ramp)
            count = np.int32(count + np.int32(ramp))
            seen[u] = line[u]
        if count == 0:
            continue
        for u in range(cols):
            if on[u] and line[u] != 0:
                if line[u] == _FAR:
                    far += 1
                else:
                    measured += 1
                near_mm = np.float32(1000.0) / near_end(inverse, reach + v, reach + u, span, reach, middle[u])
                seen[u] = np.uint16(min(max(near_mm, np.float32(1.0)), np.float32(line[u])))
                line[u] = np.uint16(0)
    return measured, far


@dataclass(frozen=True, slots=True)
class EdgeCounts:
    """Edges of one frame in every _ROW_STEP-th row: ramps and steps of `count_edges`, and the number of rows of the
    image."""

    ramps: int
    steps: int
    rows: int

    @property
    def total(self) -> int:
        """Number of ramps and steps."""
        return self.ramps + self.steps

    def at_least(self, edges: float) -> bool:
        """True if an image of 480 rows would have at least this number of edges."""
        return self.total >= edges * self.rows / 480


def edges_of(depth_mm: NDArray[np.uint16], limits: RampLimits) -> EdgeCounts:
    """Returns the edges of a depth image (H, W) uint16 that are too large to be noise."""
    ramps, steps = count_edges(
        depth_mm, _ROW_STEP, limits.span_px, limits.reach_px, limits.judged_per_m, limits.relative, limits.straight
    )
    return EdgeCounts(int(ramps), int(steps), depth_mm.shape[0])


def observe_edges(state: ExtractorState, edges: EdgeCounts, params: Params) -> ExtractorState:
    """Returns the state after a frame, with the weighted shares of ramps and steps updated.

    `edge_ramps` and `edge_steps` are sums over frames of the shares of ramps and of steps among the edges of each
    frame. The weight of a frame decreases by smear_memory with each later one, and both sums together are 1 -
    smear_memory^n after n frames. A frame with too few edges changes nothing."""
    if not edges.at_least(params.smear_min_edges):
        return state
    memory, weight = params.smear_memory, (1.0 - params.smear_memory) / edges.total
    return replace(
        state,
        edge_ramps=memory * state.edge_ramps + weight * edges.ramps,
        edge_steps=memory * state.edge_steps + weight * edges.steps,
    )


def smears(state: ExtractorState, edges: EdgeCounts, params: Params) -> bool:
    """True if the camera smears its edges.

    From smear_min_frames frames on, the mean share of ramps decides. Before that, the frame must have
    smear_clear_edges edges and the share must exceed smear_clear_share, which no measured view of a camera with sharp
    edges reaches.

    Args:
        state: the state after this frame.
        edges: edges of this frame.
        params: parameters."""
    p, weight = params, state.edge_ramps + state.edge_steps
    # half a frame less, so that rounding does not affect the comparison
    if weight > 1.0 - p.smear_memory ** (p.smear_min_frames - 0.5):
        return state.edge_ramps > p.smear_min_share * weight
    return (
        edges.at_least(p.smear_clear_edges) and state.edge_ramps > max(p.smear_clear_share, p.smear_min_share) * weight
    )


def drop_smeared_edges(
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    info: CameraInfo,
    R_level_optical: Rotation,
    ground: Ground,
    limits: RampLimits,
    params: Params,
    buffer: Buffers,
) -> tuple[NDArray[np.uint16], int, int]:
    """Makes the ramps in `marks` (H, W) uint16 unknown, except on the ground.

    The ground is kept because it is as steep as a ramp at a grazing angle.

    Returns:
        The image for the free space (`seen_to` of `drop_ramps`); the number of measured pixels and of far pixels
            removed."""
    rows, cols = depth_mm.shape
    reach = limits.reach_px
    inverse = buffer("inverse", (rows + 2 * reach, cols + 2 * reach), np.float32)
    down, keep_m = ground_line(info, R_level_optical, ground, params)
    seen_to = buffer("seen_to", marks.shape, np.uint16)
    measured, far = drop_ramps(
        depth_mm,
        inverse,
        limits.span_px,
        reach,
        limits.step_per_m,
        limits.relative,
        limits.straight,
        down,
        keep_m,
        marks,
        seen_to,
    )
    return seen_to, int(measured), int(far)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SmearedEdges:
    """Result of `remove_smeared_edges`.

    Attributes:
        active: True if the camera smears its edges, so that ramps were removed.
        state: the next state, with the shares of ramps and steps.
        free_marks: (H, W) uint16, the marks for the free space, see `drop_ramps`.
        measured: number of removed pixels that were measured.
        far: number of removed pixels that were far."""

    active: bool
    state: ExtractorState
    free_marks: NDArray[np.uint16]
    measured: int = 0
    far: int = 0

    @property
    def pixels(self) -> int:
        """Number of removed pixels."""
        return self.measured + self.far

    def remaining(self, counts: tuple[int, int, int]) -> tuple[int, int, int]:
        """Returns the counts (measured, far, flying) of `classify` without the removed pixels."""
        measured, far, flying = counts
        return measured - self.measured, far - self.far, flying


def remove_smeared_edges(
    state: ExtractorState,
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    info: CameraInfo,
    R_level_optical: Rotation,
    ground: Ground,
    ke_per_m: float,
    params: Params,
    buffers: Buffers,
) -> SmearedEdges:
    """Decides from this frame and earlier ones if the camera smears its edges, and then removes ramps from `marks`.

    Args:
        state: the state before the frame.
        depth_mm: (H, W) uint16 as delivered.
        marks: (H, W) uint16 of `classify`, in and out.
        info: description of the camera.
        R_level_optical: (3, 3) rotation.
        ground: ground of this frame.
        ke_per_m: noise coefficient.
        params: parameters.
        buffers: scratch memory."""
    limits = ramp_limits(info, ke_per_m, params)
    edges = edges_of(depth_mm, limits)
    after = observe_edges(state, edges, params)
    if not smears(after, edges, params):
        return SmearedEdges(active=False, state=after, free_marks=marks)
    seen_to, measured, far = drop_smeared_edges(depth_mm, marks, info, R_level_optical, ground, limits, params, buffers)
    return SmearedEdges(active=True, state=after, free_marks=seen_to, measured=measured, far=far)


def ground_line(
    info: CameraInfo, R_level_optical: Rotation, ground: Ground, params: Params
) -> tuple[NDArray[np.float64], float]:
    """Returns (down, keep_m) of `drop_ramps`. Without a ground, `down` is vertical and keep_m so large that no pixel
    is kept."""
    k = info.intrinsics
    x, y, z = R_level_optical
    slope_x, slope_y = (ground.slope_x, ground.slope_y) if ground.seen else (0.0, 0.0)
    across, down, ahead = z - slope_x * x - slope_y * y
    line = np.array([across / k.fx, down / k.fy, ahead - across * k.cx / k.fx - down * k.cy / k.fy])
    if not ground.seen:
        return line, _NEVER_M
    return line, max(ground.height_m - params.ground_tolerance_m, 0.5 * ground.height_m)
