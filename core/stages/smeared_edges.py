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
- Nearly all edges of the image are ramps, on the left sides of objects as on their right sides. A wall seen edge-on
  is a ramp on one side only; a frame with little else is no evidence. This is judged from the edges of several frames, or
  of one frame if it has many edges and nearly all are ramps. Until then, and for cameras with sharp edges, all pixels are
  kept."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..buffers import Buffers
from ..frames import Rotation
from ..params import Params
from ..types import CameraInfo, ExtractorState, Ground
from .ramps import HeightLine, RampLimits, count_edges, drop_ramps

_ROW_STEP = 4
"""Edges are counted in every _ROW_STEP-th row."""
_NEVER_M = 1e9
_ONE_SIDED_SHARE = 0.1
"""A camera smears both sides of objects: of the ramps of a D435 at least 0.38 are of the rarer side, of a wall seen edge-on
none."""
_MEMORY = 0.9
"""Share of the previous judgement that is kept at each frame."""


@dataclass(frozen=True, slots=True)
class EdgeCounts:
    """Edges of one frame in every _ROW_STEP-th row: ramps, rising ramps and steps of `count_edges`, and the number of rows
    of the image."""

    ramps: int
    rising: int
    steps: int
    rows: int

    @property
    def total(self) -> int:
        """Number of ramps and steps."""
        return self.ramps + self.steps

    def at_least(self, edges: float) -> bool:
        """True if an image of 480 rows would have at least this number of edges."""
        return self.total >= edges * self.rows / 480

    def one_sided(self, share: float) -> bool:
        """True if more than this share of the edges are ramps, and nearly all of these on the same side, as where a wall
        seen edge-on is nearly all that is measured."""
        rarer = min(self.rising, self.ramps - self.rising)
        return self.ramps > share * self.total and rarer < _ONE_SIDED_SHARE * self.ramps


def edges_of(depth_mm: NDArray[np.uint16], limits: RampLimits) -> EdgeCounts:
    """Returns the edges of a depth image (H, W) uint16 that are too large to be noise."""
    ramps, rising, steps = count_edges(depth_mm, _ROW_STEP, limits)
    return EdgeCounts(int(ramps), int(rising), int(steps), depth_mm.shape[0])


def observe_edges(state: ExtractorState, edges: EdgeCounts, params: Params) -> ExtractorState:
    """Returns the state after a frame, with the weighted shares of ramps and steps updated.

    `edge_ramps` and `edge_steps` are sums over frames of the shares of ramps and of steps among the edges of each
    frame. The weight of a frame decreases by _MEMORY with each later one, and both sums together are 1 -
    _MEMORY^n after n frames. A frame with too few edges, or whose ramps are one-sided, changes nothing."""
    if not edges.at_least(params.smear_min_edges) or edges.one_sided(params.smear_min_share):
        return state
    memory, weight = _MEMORY, (1.0 - _MEMORY) / edges.total
    return replace(
        state,
        edge_ramps=memory * state.edge_ramps + weight * edges.ramps,
        edge_steps=memory * state.edge_steps + weight * edges.steps,
    )


def smears(state: ExtractorState, edges: EdgeCounts, params: Params) -> bool:
    """True if the camera smears its edges.

    From smear_min_frames frames on, the mean share of ramps decides. Before that, the frame must have smear_clear_edges
    edges, ramps of both sides, and the share must exceed smear_clear_share, which no measured view of a camera with
    sharp edges reaches.
    state: the state after this frame; edges: edges of this frame."""
    p, weight = params, state.edge_ramps + state.edge_steps
    # half a frame less, so that rounding does not affect the comparison
    if weight > 1.0 - _MEMORY ** (p.smear_min_frames - 0.5):
        return state.edge_ramps > p.smear_min_share * weight
    if not edges.at_least(p.smear_clear_edges) or edges.one_sided(p.smear_min_share):
        return False
    return state.edge_ramps > max(p.smear_clear_share, p.smear_min_share) * weight


def judge_edges(
    state: ExtractorState, depth_mm: NDArray[np.uint16], limits: RampLimits, params: Params
) -> tuple[ExtractorState, bool]:
    """Decides from this frame and earlier ones if the camera smears its edges; returns the state after this frame and
    the verdict."""
    edges = edges_of(depth_mm, limits)
    after = observe_edges(state, edges, params)
    return after, smears(after, edges, params)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SmearedEdges:
    """Result of `remove_smeared_edges`."""

    active: bool  # True if the camera smears its edges, so that ramps were removed
    free_marks: NDArray[np.uint16]  # (H, W), the marks for the free space, see `drop_ramps`
    measured: int = 0  # number of removed pixels that were measured
    far: int = 0  # number of removed pixels that were far

    @property
    def pixels(self) -> int:
        """Number of removed pixels."""
        return self.measured + self.far

    def remaining(self, counts: tuple[int, int, int]) -> tuple[int, int, int]:
        """Returns the counts (measured, far, flying) of `classify` without the removed pixels."""
        measured, far, flying = counts
        return measured - self.measured, far - self.far, flying


def remove_smeared_edges(
    depth_mm: NDArray[np.uint16],
    marks: NDArray[np.uint16],
    limits: RampLimits,
    heights: HeightLine,
    buffers: Buffers,
) -> SmearedEdges:
    """Makes the ramps in `marks` unknown, except on the ground.

    The ground is kept because it is as steep as a ramp at a grazing angle.
    marks: (H, W) uint16 of `classify`, in and out."""
    rows, cols = depth_mm.shape
    inverse = buffers("inverse", (rows + 2 * limits.reach_px, cols + 2 * limits.reach_px), np.float32)
    free_marks = buffers("free_marks", marks.shape, np.uint16)
    measured, far = drop_ramps(depth_mm, inverse, limits, heights, marks, free_marks)
    return SmearedEdges(active=True, free_marks=free_marks, measured=int(measured), far=int(far))


def height_line(info: CameraInfo, R_level_optical: Rotation, ground: Ground, params: Params) -> HeightLine:
    """Returns the heights of pixels. Without a ground they are vertical, and keep_m is so large that no pixel is kept.

    R_level_optical: (3, 3) rotation."""
    k = info.intrinsics
    x, y, z = R_level_optical
    slope_x, slope_y = (ground.slope_x, ground.slope_y) if ground.seen else (0.0, 0.0)
    across, down, ahead = z - slope_x * x - slope_y * y
    keep_m = max(ground.height_m - params.ground_tolerance_m, 0.5 * ground.height_m) if ground.seen else _NEVER_M
    first = ahead - across * k.cx / k.fx - down * k.cy / k.fy
    return HeightLine(float(across / k.fx), float(down / k.fy), float(first), float(keep_m))
