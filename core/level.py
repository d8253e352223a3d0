"""Section 4.1, Lemma 1 in exact form: the frame as a gravity-aligned camera would have seen it.

A pure rotation has no parallax, so every pixel keeps its own measurement and only changes its place: columns become
truly vertical for any roll and pitch, and Eq. 15 holds as it stands. The paper's form (rotate the image by -roll,
divide by Lemma 1's factor) is `level_paper`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .frames import Rotation
from .params import Params
from .types import CameraInfo, Intrinsics

Q_UNKNOWN, Q_FAR, Q_MIN = 0, 1, 2
"""Codes of the levelled image: no measurement, free to the maximum, and the least measured value."""
_MAX_QUANTUM, _MAX_CODE = 64.0, 60000.0
"""Resolution of the codes: so many per pixel of disparity, unless half of the least range would not fit 16 bits."""


def code_quantum(info: CameraInfo, f_px: float) -> float:
    """Codes per pixel of disparity in a view of focal length f_px."""
    return min(_MAX_QUANTUM, _MAX_CODE * 0.5 * info.min_range_m / f_px)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ViewGeometry:
    """The levelled view: a virtual camera looking along level_cam x.

    cols, rows: its size; f_px: focal length; cu, cv: principal point. A cell (u, v) at forward distance X lies at
    y = X * (u - cu)/f_px * lateral[v] and z = X * tan_edge between its edges tan_edge[v], tan_edge[v + 1] (down).
    quantum: codes per pixel of disparity, code = f_px/X * quantum. H: (3, 3) float64, H (u, v, 1) is the cell's ray in
    the source's pixels (homogeneous, third component: Z_optical / X)."""

    cols: int
    rows: int
    f_px: float
    cu: float
    cv: float
    quantum: float
    tan_edge: NDArray[np.float32]
    lateral: NDArray[np.float32]
    H: NDArray[np.float64]


def border_rays(k: Intrinsics) -> NDArray[np.float64]:
    """(N, 3) optical rays of the outer edge of the image, half a pixel beyond the outermost centres."""
    us = np.linspace(-0.5, k.width - 0.5, 33)
    vs = np.linspace(-0.5, k.height - 0.5, 33)
    edge = [(u, v) for u in us for v in (vs[0], vs[-1])] + [(u, v) for v in vs for u in (us[0], us[-1])]
    return np.array([((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0) for u, v in edge])


def tilt_rad(R_level_optical: Rotation) -> float:
    """Angle between the optical axis and the horizontal, >= 0."""
    return math.asin(min(1.0, abs(float(R_level_optical[2, 2]))))


def view_geometry(info: CameraInfo, R_level_optical: Rotation, params: Params) -> ViewGeometry:
    """The virtual camera whose window covers every source pixel not steeper than `max_elevation_deg`.

    Keeps the source's focal length unless the window would exceed `max_view_ratio` cells per source pixel."""
    k = info.intrinsics
    limit = math.tan(math.radians(params.max_elevation_deg))
    rays = border_rays(k) @ R_level_optical.T
    forward = np.maximum(rays[:, 0], 1e-9)
    side = np.clip(np.where(rays[:, 0] > 1e-6, rays[:, 1] / forward, np.sign(rays[:, 1]) * limit), -limit, limit)
    down = np.clip(np.where(rays[:, 0] > 1e-6, rays[:, 2] / forward, np.sign(rays[:, 2]) * limit), -limit, limit)
    f_px = float(min(k.fx, k.fy))
    cells = (side.max() - side.min()) * (down.max() - down.min()) * f_px * f_px
    f_px *= math.sqrt(min(1.0, params.max_view_ratio * k.width * k.height / cells))
    cu, cols = _axis(f_px * side.min(), f_px * side.max(), k.cx)
    cv, rows = _axis(f_px * down.min(), f_px * down.max(), k.cy)
    to_source = np.array([[k.fx, 0.0, k.cx], [0.0, k.fy, k.cy], [0.0, 0.0, 1.0]]) @ R_level_optical.T
    from_cell = np.array([[0.0, 0.0, f_px], [1.0, 0.0, -cu], [0.0, 1.0, -cv]]) / f_px
    edges = ((np.arange(rows + 1) - 0.5 - cv) / f_px).astype(np.float32)
    quantum = code_quantum(info, f_px)
    return ViewGeometry(
        cols=cols, rows=rows, f_px=f_px, cu=cu, cv=cv, quantum=quantum,
        tan_edge=edges, lateral=np.ones(rows, np.float32), H=to_source @ from_cell,
    )  # fmt: skip


def _axis(low_px: float, high_px: float, source_centre: float) -> tuple[float, int]:
    """(principal point, cells) of one axis that reaches from low_px to high_px around it.

    The principal point has the source's own fraction of a pixel, so that a level camera's cells are its pixels."""
    fraction = source_centre - math.floor(source_centre)
    centre = math.ceil(-low_px - 0.5 - fraction - 1e-6) + fraction
    return centre, math.ceil(high_px - 0.5 + centre - 1e-6) + 1


@njit(cache=True, nogil=True)
def source_px_per_cell(H, u, v):
    """Area of a cell of the levelled view in source pixels at (u, v): below 1 cells repeat pixels.

    The Jacobian of the homography, det(H) / w^3."""
    w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    if w <= 1e-6:
        return 0.0
    a = H[0, 0] * (H[1, 1] * H[2, 2] - H[1, 2] * H[2, 1])
    b = H[0, 1] * (H[1, 0] * H[2, 2] - H[1, 2] * H[2, 0])
    c = H[0, 2] * (H[1, 0] * H[2, 1] - H[1, 1] * H[2, 0])
    return abs(a - b + c) / (w * w * w)


@njit(cache=True, nogil=True)
def outside_source(H, u, v, cols, rows):
    """Whether cell (u, v) of the levelled view looks past the edge of the source image (cols x rows)."""
    w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    if w <= 1e-6:
        return True
    x = (H[0, 0] * u + H[0, 1] * v + H[0, 2]) / w
    y = (H[1, 0] * u + H[1, 1] * v + H[1, 2]) / w
    # a thousandth of a pixel: the outermost pixels themselves are inside, whatever their rounding
    return x < -1e-3 or y < -1e-3 or x > cols - 1.0 + 1e-3 or y > rows - 1.0 + 1e-3


@njit(cache=True, nogil=True)
def _rows_inside(a, b, first, last):
    """The part of rows first..last in which a + b*v >= 0."""
    # bounded before it becomes an integer: with a slope of rounding errors the crossing lies beyond any integer
    if b > 0.0:
        first = max(first, int(math.ceil(min(max(-a / b, -1.0), 1e6))))
    elif b < 0.0:
        last = min(last, int(math.floor(min(max(-a / b, -1.0), 1e6))))
    elif a < 0.0:
        last = first - 1
    return first, last


@njit(cache=True, nogil=True)
def level_nearest(inverse, H, gain, out, picked):
    """Each cell of the levelled view takes its nearest source pixel. Depth is never interpolated.

    inverse: (H, W) float32. gain: f_px * quantum. out: (cols, rows) uint16 codes, one line per column. picked: (H * W,)
    uint8 out, which source pixels were taken. A cell outside the source is unknown."""
    picked[:] = 0
    src_rows, src_cols = inverse.shape
    cols, rows = out.shape
    flat = inverse.ravel()
    for u in range(cols):
        line = out[u]
        line[:] = 0
        a0, b0 = H[0, 0] * u + H[0, 2], H[0, 1]
        a1, b1 = H[1, 0] * u + H[1, 2], H[1, 1]
        a2, b2 = H[2, 0] * u + H[2, 2], H[2, 1]
        first, last = _rows_inside(a2 - 1e-3, b2, 0, rows - 1)
        first, last = _rows_inside(a0 + 0.4999 * a2, b0 + 0.4999 * b2, first, last)
        first, last = _rows_inside(a1 + 0.4999 * a2, b1 + 0.4999 * b2, first, last)
        first, last = _rows_inside((src_cols - 0.5001) * a2 - a0, (src_cols - 0.5001) * b2 - b0, first, last)
        first, last = _rows_inside((src_rows - 0.5001) * a2 - a1, (src_rows - 0.5001) * b2 - b1, first, last)
        for v in range(first, last + 1):
            w = np.float32(a2 + b2 * v)
            r = np.float32(1.0) / w
            x = min(max(np.int32(np.float32(a0 + b0 * v) * r + np.float32(0.5)), np.int32(0)), np.int32(src_cols - 1))
            y = min(max(np.int32(np.float32(a1 + b1 * v) * r + np.float32(0.5)), np.int32(0)), np.int32(src_rows - 1))
            at = np.uint32(y * np.int32(src_cols) + x)
            picked[at] = 1
            d = flat[at]
            code = min(d * w * np.float32(gain) + np.float32(0.5), np.float32(65535.0))
            if d > 0.0:
                line[v] = max(np.uint16(code), np.uint16(2))
            elif d < 0.0:
                line[v] = 1


@njit(cache=True, nogil=True)
def level_pool(inverse, picked, R, k, window, out):
    """Source pixels that no cell picked reach theirs all the same, the nearest thing winning: no pole is lost
    where the view minifies, and nothing grows where it does not.

    R: (3, 3) R_level_optical. k: (4,) fx, fy, cx, cy. window: (f_px, cu, cv, gain). Adds to `out` of level_nearest."""
    src_rows, src_cols = inverse.shape
    cols, rows = out.shape
    f, cu, cv, gain = window[0], window[1], window[2], window[3]
    for v in range(src_rows):
        yv = (v - k[3]) / k[1]
        a0, a1, a2 = R[0, 1] * yv + R[0, 2], R[1, 1] * yv + R[1, 2], R[2, 1] * yv + R[2, 2]
        for u in range(src_cols):
            d = inverse[v, u]
            # far never overrules a neighbour of which nothing is known: it would call the cell free
            if d <= 0.0 or picked[v * src_cols + u] != 0:
                continue
            xu = (u - k[2]) / k[0]
            forward = R[0, 0] * xu + a0
            if forward < 1e-3:
                continue
            r = f / forward
            iu = int(math.floor((R[1, 0] * xu + a1) * r + cu + 0.5))
            iv = int(math.floor((R[2, 0] * xu + a2) * r + cv + 0.5))
            if 0 <= iu < cols and 0 <= iv < rows:
                code = 1
                if d > 0.0:
                    code = max(2, min(65535, int(d / forward * gain + 0.5)))
                if code > out[iu, iv]:
                    out[iu, iv] = code


def level_safe(
    inverse: NDArray[np.float32], info: CameraInfo, R_level_optical: Rotation, g: ViewGeometry, out: NDArray[np.uint16],
    picked: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Fills `out` (cols, rows) uint16 with the codes of the levelled view g. picked: (H * W,) uint8 scratch."""
    k = info.intrinsics
    gain = g.f_px * g.quantum
    level_nearest(inverse, g.H, gain, out, picked)
    window = np.array([g.f_px, g.cu, g.cv, gain])
    level_pool(inverse, picked, np.ascontiguousarray(R_level_optical), np.array([k.fx, k.fy, k.cx, k.cy]), window, out)


@njit(cache=True, nogil=True)
def pool_columns(codes, step, out):
    """Nearest of each `step` neighbouring columns: never skips one. codes: (cols, rows); out: (ceil(cols/step), rows)."""
    cols, rows = codes.shape
    for j in range(out.shape[0]):
        out[j] = codes[j * step]
        for u in range(j * step + 1, min(cols, (j + 1) * step)):
            for v in range(rows):
                if codes[u, v] > out[j, v]:
                    out[j, v] = codes[u, v]


def pooled_geometry(g: ViewGeometry, step: int) -> ViewGeometry:
    """The geometry of `pool_columns`: a group's strip stands in its middle."""
    to_full = np.array([[step, 0.0, 0.5 * (step - 1)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return replace(
        g, cols=-(-g.cols // step), cu=(g.cu - 0.5 * (step - 1)) / step,
        lateral=(g.lateral * np.float32(step)), H=g.H @ to_full,
    )  # fmt: skip


def view_geometry_paper(info: CameraInfo, R_level_optical: Rotation, params: Params) -> ViewGeometry:
    """The paper's view: the source's own window, rotated by -roll beyond `paper_roll_deg`; rows levelled by pitch."""
    k = info.intrinsics
    # nose-up pitch and roll of the camera, from R_level_optical = Ry(pitch) Rx(roll) R_camfrd_optical
    pitch = math.asin(max(-1.0, min(1.0, -float(R_level_optical[2, 2]))))
    roll = math.atan2(float(R_level_optical[2, 0]), float(R_level_optical[2, 1]))
    c, s = (math.cos(roll), math.sin(roll)) if abs(roll) > math.radians(params.paper_roll_deg) else (1.0, 0.0)
    turn = np.array([[c, s, k.cx - c * k.cx - s * k.cy], [-s, c, k.cy + s * k.cx - c * k.cy], [0.0, 0.0, 1.0]])
    theta = -pitch  # the paper's theta is positive nose down, MAVLink's pitch nose up
    edge = (np.arange(k.height + 1) - 0.5 - k.cy) / k.fy
    mid = (np.arange(k.height) - k.cy) / k.fy
    forward = math.cos(theta) - edge * math.sin(theta)
    tan_edge = (math.sin(theta) + edge * math.cos(theta)) / np.maximum(forward, 1e-3)
    lateral = (k.fy / k.fx) / np.maximum(math.cos(theta) - mid * math.sin(theta), 1e-3)
    quantum = code_quantum(info, k.fy)
    return ViewGeometry(
        cols=k.width, rows=k.height, f_px=k.fy, cu=k.cx, cv=k.cy, quantum=quantum,
        tan_edge=tan_edge.astype(np.float32), lateral=lateral.astype(np.float32), H=turn,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def level_paper(inverse, H, lateral, gain, out):
    """Lemma 1: disparity of the rotated image divided by (cos(theta) - (v - v0)/f sin(theta)); columns stay as they are."""
    src_rows, src_cols = inverse.shape
    cols, rows = out.shape
    for u in range(cols):
        for v in range(rows):
            x = int(math.floor(H[0, 0] * u + H[0, 1] * v + H[0, 2] + 0.5))
            y = int(math.floor(H[1, 0] * u + H[1, 1] * v + H[1, 2] + 0.5))
            out[u, v] = 0
            if 0 <= x < src_cols and 0 <= y < src_rows:
                d = inverse[y, x]
                if d > 0.0:
                    out[u, v] = max(2, min(65535, int(d * lateral[v] * gain)))
                elif d < 0.0:
                    out[u, v] = 1
