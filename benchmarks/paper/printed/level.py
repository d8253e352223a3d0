"""Section 3.2 as printed: the source's own window, rotated by the roll; disparity divided by Lemma 1's factor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from core.frames import Rotation
from core.stages.view_geometry import Q_FAR, Q_MIN, Q_UNKNOWN, ViewGeometry, disparity_lsb_per_px
from core.types import FAR_MM, CameraInfo

from .params import PaperParams

_FAR = np.uint16(FAR_MM)


def view_geometry_paper(info: CameraInfo, R_level_optical: Rotation, params: PaperParams) -> ViewGeometry:
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
    edges = tan_edge.astype(np.float32)
    return ViewGeometry(
        cols=k.width,
        rows=k.height,
        f_px=k.fy,
        cu=k.cx,
        cv=k.cy,
        lsb_per_px=disparity_lsb_per_px(info.min_range_m, k.fy),
        tan_edge=edges,
        tan_mid=np.float32(0.5) * (edges[1:] + edges[:-1]),
        lateral=lateral.astype(np.float32),
        H=turn,
    )


@njit(cache=True, nogil=True)
def level_paper(depth_mm: Any, H: Any, lateral: Any, gain: Any, out: Any) -> None:
    """Lemma 1: disparity of the rotated image divided by (cos(theta) - (v - v0)/f sin(theta)); columns stay as they are.

    depth_mm: (H, W) uint16 of `classify`. H: (3, 3) float64, lateral: (V,) float32 of the view. gain: quantised
    disparity per 1/m. out: (U, V) uint16 quantised disparity."""
    src_rows, src_cols = depth_mm.shape
    cols, rows = out.shape
    for u in range(cols):
        for v in range(rows):
            x = int(math.floor(H[0, 0] * u + H[0, 1] * v + H[0, 2] + 0.5))
            y = int(math.floor(H[1, 0] * u + H[1, 1] * v + H[1, 2] + 0.5))
            out[u, v] = Q_UNKNOWN
            if 0 <= x < src_cols and 0 <= y < src_rows and depth_mm[y, x] != 0:
                d = np.float32(1000.0) / np.float32(depth_mm[y, x])
                far = depth_mm[y, x] == _FAR
                out[u, v] = Q_FAR if far else max(Q_MIN, min(65535, int(d * lateral[v] * gain)))
