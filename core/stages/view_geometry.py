"""Geometry of the levelled view: a virtual camera that looks along level_cam x, and its mapping to the source image.

Input: intrinsics and attitude of a frame. Output: `ViewGeometry`, and `SOURCE`, the source image as seen from the
view. level.py transfers the pixels."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, kernel, record
from ..params import Params
from ..types import CameraInfo

Q_UNKNOWN, Q_FAR, Q_MIN = 0, 1, 2
"""Values of quantised disparity: not measured; free up to the maximum range; the least measured value."""
_MOST_LSB_PER_PX, _MAX_CODE = 64.0, 60000.0
"""Greatest resolution of quantised disparity per pixel, and the greatest code. The resolution is lower where half of
the least range would exceed that code."""
_LEAST_RANGE_M = 0.1
"""A lesser least range does not lower the resolution further: with one of a millimetre, a wall at 9.4 m would stand at
10 m. What is nearer than half of this is placed there."""
_MIN_CELLS = 2
"""Least number of columns and rows: the distance between two rows must be defined."""
_BORDER_POINTS = 32
"""Number of parts of each side of the image; the extent of the view is determined from their ends."""
_MAX_ELEVATION_DEG = 74.0
"""Steeper rays are unknown."""
_LIMIT = math.tan(math.radians(_MAX_ELEVATION_DEG))
"""Tangent of the greatest elevation and azimuth."""


@inner
def disparity_lsb_per_px(min_range_m, f_px):
    """Returns the steps of quantised disparity per pixel of disparity in a view of focal length f_px."""
    return min(_MOST_LSB_PER_PX, _MAX_CODE * 0.5 * max(min_range_m, _LEAST_RANGE_M) / f_px)


SOURCE = record(
    ("width_px", np.int64),
    ("height_px", np.int64),
    ("axis_x", np.float64),  # x and z of the optical axis in level_cam
    ("axis_z", np.float64),
    ("clear_m", np.float64),  # greatest depth that counts as measured, see `clear_range_m`
    ("max_range_m", np.float64),  # maximum range of the camera
    ("min_range_m", np.float64),  # minimum range of the camera
)
"""The source image of a view. One pixel of it may be repeated in the view, or several may fall into one cell."""


def source_of(info: CameraInfo, R_level_optical: Rotation, clear_m: float) -> NDArray[Any]:
    """Returns SOURCE of a frame, an array of shape (1,)."""
    k, out = info.intrinsics, np.zeros(1, SOURCE)
    out[0] = (
        k.width,
        k.height,
        R_level_optical[0, 2],
        R_level_optical[2, 2],
        clear_m,
        info.max_range_m,
        info.min_range_m,
    )
    return out


class ViewGeometry(NamedTuple):
    """The levelled view: a virtual camera that looks along level_cam x.

    A cell (u, v) at forward distance X lies at y = X (u - cu)/f_px lateral[v], and between z = X tan_edge[v] and z =
    X tan_edge[v + 1] (z is down)."""

    cols: int  # number of columns
    rows: int  # number of rows
    f_px: float  # focal length
    cu: float  # column of the principal point
    cv: float  # row of the principal point, which is that of the horizon
    lsb_per_px: float  # quantised disparity q per pixel of disparity, q = f_px / X lsb_per_px
    tan_edge: NDArray[np.float32]  # (rows + 1,), tangents of elevation at the edges of the rows, positive down
    tan_mid: NDArray[np.float32]  # (rows,), the same in the middle of the rows
    # (rows,) float32, width of a column in pixels of f_px: 1, or the step of pooled columns
    lateral: NDArray[np.float32]
    # (3, 3) float64. H (u, v, 1) is the ray of a cell in homogeneous pixels of the source; its third component is
    # Z_optical / X.
    H: NDArray[np.float64]

    @property
    def is_empty(self) -> bool:
        """True if all or nearly all rays of the source are steeper than the view reaches."""
        return min(self.cols, self.rows) < _MIN_CELLS


@inner
def window_of_border(R, k, width, height):
    """Returns the least and greatest y/x, and the least and greatest z/x, of the border of the image in level_cam.

    The border lies half a pixel beyond the outermost pixel centres. A ray that points backwards counts as +-_LIMIT.
    width, height: of the image."""
    limit = _LIMIT
    low_y, high_y, low_z, high_z = limit, -limit, limit, -limit
    for i in range(_BORDER_POINTS + 1):
        along_u = -0.5 + width * (i / _BORDER_POINTS)
        along_v = -0.5 + height * (i / _BORDER_POINTS)
        for side in range(4):
            u = along_u if side < 2 else (-0.5 if side == 2 else width - 0.5)
            v = along_v if side >= 2 else (-0.5 if side == 0 else height - 0.5)
            a, b = (u - k[2]) / k[0], (v - k[3]) / k[1]
            x = R[0, 0] * a + R[0, 1] * b + R[0, 2]
            y = R[1, 0] * a + R[1, 1] * b + R[1, 2]
            z = R[2, 0] * a + R[2, 1] * b + R[2, 2]
            y = y / x if x > 1e-6 else math.copysign(limit, y)
            z = z / x if x > 1e-6 else math.copysign(limit, z)
            y, z = min(max(y, -limit), limit), min(max(z, -limit), limit)
            low_y, high_y, low_z, high_z = min(low_y, y), max(high_y, y), min(low_z, z), max(high_z, z)
    return low_y, high_y, low_z, high_z


@inner
def is_rotation(R, tolerance):
    """True if R (3, 3) is finite and a rotation: R R^T is the unit matrix within `tolerance` per element, and det(R)
    > 0."""
    for i in range(3):
        for j in range(3):
            dot = R[i, 0] * R[j, 0] + R[i, 1] * R[j, 1] + R[i, 2] * R[j, 2]
            if not abs(dot - (1.0 if i == j else 0.0)) <= tolerance:
                return False  # nan included
    return determinant(R) > 0.0


@inner
def determinant(M):
    """Returns the determinant of M (3, 3)."""
    a = M[0, 0] * (M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1])
    b = M[0, 1] * (M[1, 0] * M[2, 2] - M[1, 2] * M[2, 0])
    c = M[0, 2] * (M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0])
    return a - b + c


def tilt_rad(R_level_optical: Rotation) -> float:
    """Returns the angle between the optical axis and the horizontal plane, >= 0."""
    return math.asin(min(1.0, abs(float(R_level_optical[2, 2]))))


def view_geometry(info: CameraInfo, R_level_optical: Rotation, params: Params) -> ViewGeometry:
    """Returns the virtual camera whose window covers every source pixel that is not steeper than
    _MAX_ELEVATION_DEG.

    The focal length is that of the source, unless the view would have more than `max_view_ratio` cells per source
    pixel. The view `is_empty` if no pixel is left, for example for a steep camera with a principal point outside of
    the image."""
    k, R = info.intrinsics, np.ascontiguousarray(R_level_optical)
    camera, size = np.array([k.fx, k.fy, k.cx, k.cy]), (k.width, k.height)
    return levelled_geometry(R, camera, size, params.max_view_ratio, float(info.min_range_m))


@kernel
def levelled_geometry(R, k, size, ratio, min_range_m):
    """Returns the ViewGeometry of a camera. size: (width, height) of the source; ratio: max_view_ratio."""
    width, height = size
    left, right, up, down = window_of_border(R, k, width, height)
    f_px = min(k[0], k[1])
    cells = (right - left) * (down - up) * f_px * f_px
    f_px *= math.sqrt(min(1.0, ratio * width * height / max(cells, 1.0)))
    cu, cols = _axis(f_px * left, f_px * right, k[2])
    cv, rows = _axis(f_px * up, f_px * down, k[3])
    cols, rows = max(cols, 0), max(rows, 0)
    edges, middles, H = np.empty(rows + 1, np.float32), np.empty(rows, np.float32), np.empty((3, 3))
    fill_view(R, k, f_px, cu, cv, edges, middles, H)
    lsb_per_px = disparity_lsb_per_px(min_range_m, f_px)
    return ViewGeometry(cols, rows, f_px, cu, cv, lsb_per_px, edges, middles, np.ones(rows, np.float32), H)


@inner
def fill_view(R, k, f_px, cu, cv, edges, middles, H):
    """Fills edges (rows + 1,), middles (rows,) and H (3, 3) of ViewGeometry.

    The ray of a cell is (1, (u - cu)/f, (v - cv)/f) in level_cam. The transpose of R_level_optical turns it to the
    optical frame, the intrinsics k (4,) project it into the source."""
    for v in range(len(edges)):
        edges[v] = (v - 0.5 - cv) / f_px
    for v in range(len(middles)):
        middles[v] = np.float32(0.5) * (edges[v + 1] + edges[v])
    for j in range(3):
        a, b = R[1, j] / f_px, R[2, j] / f_px
        H[j, 0], H[j, 1], H[j, 2] = a, b, R[0, j] - a * cu - b * cv
    for j in range(3):
        H[0, j] = k[0] * H[0, j] + k[2] * H[2, j]
        H[1, j] = k[1] * H[1, j] + k[3] * H[2, j]


@inner
def _axis(low_px, high_px, source_centre):
    """Returns (principal point, number of cells) of one axis that reaches from low_px to high_px around the principal
    point.

    The principal point has the same fraction of a pixel as that of the source, so that the cells of a level camera
    are its pixels."""
    fraction = source_centre - math.floor(source_centre)
    centre = math.ceil(-low_px - 0.5 - fraction - 1e-6) + fraction
    return centre, math.ceil(high_px - 0.5 + centre - 1e-6) + 1


@inner
def homography_area(H):
    """Returns |det(H)|. Divided by w^3 it is the area of a cell of the levelled view in source pixels (the Jacobian
    of H)."""
    return abs(determinant(H))


@inner
def outside_source(H, u, v, cols, rows):
    """True if cell (u, v) of the view lies outside of the source image of cols x rows pixels."""
    w = H[2, 0] * u + H[2, 1] * v + H[2, 2]
    if w <= 1e-6:
        return True
    x = (H[0, 0] * u + H[0, 1] * v + H[0, 2]) / w
    y = (H[1, 0] * u + H[1, 1] * v + H[1, 2]) / w
    # a tolerance of a thousandth of a pixel, so that the outermost pixels are inside in spite of rounding
    return x < -1e-3 or y < -1e-3 or x > cols - 1.0 + 1e-3 or y > rows - 1.0 + 1e-3


def pooled_geometry(g: ViewGeometry, step: int) -> ViewGeometry:
    """Returns the geometry of a view after `pool_columns`: a pooled column stands in the middle of its group."""
    to_full = np.array([[step, 0.0, 0.5 * (step - 1)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return g._replace(
        cols=-(-g.cols // step),
        cu=(g.cu - 0.5 * (step - 1)) / step,
        lateral=(g.lateral * np.float32(step)),
        H=g.H @ to_full,
    )
