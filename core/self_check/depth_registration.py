"""Rigid motion between two depth images of one camera, by direct alignment of their inverse depth.

Both images are reduced to a small grid of mean inverse depth. Each cell of the first grid is moved by the estimated
motion and compared with the second grid; Gauss-Newton steps with Cauchy weights minimise the differences. Rotation
and translation are separated by the depth: the rotational flow does not depend on it, the translational flow is
proportional to the inverse depth. Directions that the scene does not determine (the heading above an empty plain)
keep the guess, as the information matrix shows.

Model: a point with ray r = (x, y, 1) and inverse depth d in the first camera lies along q = R r + d t in the second,
with the inverse depth d / q_z. The noise of the inverse depth is constant (sigma_Z = ke Z^2). The interpolation
between cells is uncertain by a share of their difference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from ..types import CameraInfo

Floats = NDArray[np.float64]

GRID_COLUMNS = 80
"""Approximate number of columns of the reduced image; cells are square."""
STEPS_COARSE, STEPS_FINE = 3, 2
"""Gauss-Newton steps on the grid of half the resolution, and on the full one."""
NOISE_FACTOR = 1.5
"""Noise of the mean of a cell over that of independent pixels: neighbouring pixels of a matched image share errors."""
TRANSLATION_PRIOR_M = 0.5
"""Standard deviation of the translation between two images, about 0."""
EDGE_SHARE = 0.1
"""Uncertainty of the interpolation as a share of the difference between neighbouring cells."""
CAUCHY = 2.5
"""Residuals of more standard deviations lose most of their weight: moving objects, and surfaces that were hidden
before."""
LEAST_CELLS = 100
"""Least number of compared cells for a measurement."""


class InverseDepthGrid(NamedTuple):
    """A depth image reduced to square cells of mean inverse depth."""

    cells: Floats  # (rows, columns) 1/m, NaN where not measured
    lens: tuple[float, float, float, float]  # fx, fy, cx, cy in cells
    sigma_per_m: float  # noise of a cell, 1/m


class Pyramid(NamedTuple):
    """A depth image at two resolutions: `half` has half as many rows and columns as `fine`."""

    fine: InverseDepthGrid
    half: InverseDepthGrid


@kernel
def reduce_depth(depth_mm, cell_px, nearest_mm, farthest_mm, out):
    """Computes the mean inverse depth of each cell (rows, columns) in 1/m; NaN where less than half of the samples
    are measured.

    Every second pixel of every second row is a sample."""
    rows, columns = out.shape
    half = (cell_px + 1) // 2
    least = half * half // 2
    total, count = np.empty(columns), np.empty(columns, np.int64)
    for r in range(rows):
        for c in range(columns):
            total[c] = 0.0
            count[c] = 0
        for v in range(r * cell_px, (r + 1) * cell_px, 2):
            for c in range(columns):
                for u in range(c * cell_px, (c + 1) * cell_px, 2):
                    z = depth_mm[v, u]
                    if nearest_mm <= z <= farthest_mm:
                        total[c] += 1000.0 / z
                        count[c] += 1
        for c in range(columns):
            out[r, c] = total[c] / count[c] if count[c] > least else np.nan


@inner
def halve(fine, out):
    """Computes the grid of half the resolution: the mean of 2 x 2 cells, NaN where one is NaN."""
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[r, c] = 0.25 * (
                fine[2 * r, 2 * c] + fine[2 * r, 2 * c + 1] + fine[2 * r + 1, 2 * c] + fine[2 * r + 1, 2 * c + 1]
            )


@inner
def _interpolate(cells, u, v):
    """Returns the value between four cells, bilinear, and its derivatives along columns and rows."""
    c, r = int(u), int(v)
    a, b = u - c, v - r
    s00, s01, s10, s11 = cells[r, c], cells[r, c + 1], cells[r + 1, c], cells[r + 1, c + 1]
    top, bottom, left, right = s01 - s00, s11 - s10, s10 - s00, s11 - s01
    value = s00 + a * top + b * left + a * b * (bottom - top)
    return value, top + b * (bottom - top), left + a * (right - left)


@inner
def _add_row(J, weight, e, H, g):
    """Adds one residual e with the derivative J (6,) to the lower triangle of H (6, 6), and to g (6,)."""
    for i in range(6):
        wj = weight * J[i]
        g[i] += wj * e
        for j in range(i + 1):
            H[i, j] += wj * J[j]


@kernel
def _accumulate(first, second, R, t, H, g):
    """Computes the normal equations of one Gauss-Newton step; returns the number of cells compared.

    Args:
        first, second: InverseDepthGrid of both images.
        R: (3, 3) present rotation.
        t: (3,) present translation.
        H: (6, 6) out, for rotation and translation, where the rotation is applied on the left of R.
        g: (6,) out."""
    rows, columns = first.cells.shape
    fx, fy, cx, cy = first.lens
    J = np.empty(6)
    g[:] = 0.0
    H[:] = 0.0
    cells = 0
    shrink, edge = 1.0 / (CAUCHY * CAUCHY), EDGE_SHARE * EDGE_SHARE
    for r in range(rows):
        y = (r - cy) / fy
        for c in range(columns):
            d = first.cells[r, c]
            if not d > 0.0:
                continue
            x = (c - cx) / fx
            qx = R[0, 0] * x + R[0, 1] * y + R[0, 2] + d * t[0]
            qy = R[1, 0] * x + R[1, 1] * y + R[1, 2] + d * t[1]
            qz = R[2, 0] * x + R[2, 1] * y + R[2, 2] + d * t[2]
            if qz < 0.1:
                continue
            iz = 1.0 / qz
            px, py = qx * iz, qy * iz
            u, v = px * fx + cx, py * fy + cy
            if not (0.0 <= u < columns - 1 and 0.0 <= v < rows - 1):
                continue
            inverse, du, dv = _interpolate(second.cells, u, v)
            e = inverse - d * iz
            if not e * e >= 0.0:  # a neighbour is not measured
                continue
            w = 1.0 / (first.sigma_per_m * first.sigma_per_m + edge * (du * du + dv * dv) + shrink * e * e)
            gx, gy = du * fx * iz, dv * fy * iz
            # derivative of e by q, then by the rotation (q x) and the translation (d)
            ez = d * iz * iz - gx * px - gy * py
            J[0] = gy * -qz + ez * qy
            J[1] = gx * qz - ez * qx
            J[2] = gy * qx - gx * qy
            J[3], J[4], J[5] = gx * d, gy * d, ez * d
            _add_row(J, w, e, H, g)
            cells += 1
    for i in range(6):
        for j in range(i):
            H[j, i] = H[i, j]
    return cells


@inner
def _turn(R, v, out):
    """Computes out = exp(v) R, where v (3,) is a rotation vector."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    k = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-9 else 0.5
    for j in range(3):
        x, y, z = R[0, j], R[1, j], R[2, j]
        ax, ay, az = v[1] * z - v[2] * y, v[2] * x - v[0] * z, v[0] * y - v[1] * x
        bx, by, bz = v[1] * az - v[2] * ay, v[2] * ax - v[0] * az, v[0] * ay - v[1] * ax
        out[0, j], out[1, j], out[2, j] = x + s * ax + k * bx, y + s * ay + k * by, z + s * az + k * bz


@kernel
def _align(first, second, R, t, steps, H):
    """Improves R (3, 3) and t (3,) in place, so that `first` fits `second`; returns the number of cells compared.

    H: (6, 6) out, information of the last step. The result is 0, and R and t are not changed, if too few cells are
    compared."""
    g, turned = np.empty(6), np.empty((3, 3))
    prior = 1.0 / (TRANSLATION_PRIOR_M * TRANSLATION_PRIOR_M)
    cells, least = 0, LEAST_CELLS * first.cells.size // 4800
    for _ in range(steps):
        cells = _accumulate(first, second, R, t, H, g)
        if cells < least:
            return 0
        for i in range(3):
            H[3 + i, 3 + i] += prior
            g[3 + i] += t[i] * prior
        for i in range(6):  # regularisation: a direction that the scene does not determine keeps its value
            H[i, i] += 1e-6 * H[i, i] + 1e-3
        step = np.linalg.solve(H, -g)
        _turn(R, step[:3], turned)
        R[:, :] = turned
        t += step[3:]
    return cells


@kernel
def _align_pyramid(first, second, R, t, H):
    """Aligns from coarse to fine; returns True if the motion could be measured.

    first, second: Pyramid. R (3, 3) and t (3,): the guess, improved in place. H: (6, 6) out, information of rotation
    (1/rad^2) and translation (1/m^2)."""
    if _align(first.half, second.half, R, t, STEPS_COARSE, H) == 0:
        return False
    return _align(first.fine, second.fine, R, t, STEPS_FINE, H) > 0


def depth_pyramid(depth_mm: NDArray[np.uint16], info: CameraInfo) -> Pyramid:
    """Returns the grids of a depth image (H, W) uint16 mm. Depths outside of the camera's range are not measured."""
    k = info.intrinsics
    cell = max(2, round(k.width / GRID_COLUMNS))
    fine = np.empty((k.height // cell // 2 * 2, k.width // cell // 2 * 2))
    half = np.empty((fine.shape[0] // 2, fine.shape[1] // 2))
    reduce_depth(depth_mm, cell, info.least_mm, round(1000.0 * info.max_range_m), fine)
    halve(fine, half)
    middle = float((cell + 1) // 2 - 1)  # mean offset of the pixels 0, 2, 4 ... of a cell
    fx, fy, cx, cy = k.fx / cell, k.fy / cell, (k.cx - middle) / cell, (k.cy - middle) / cell
    sigma = NOISE_FACTOR * info.ke_per_m / ((cell + 1) // 2)
    of_half = fx / 2, fy / 2, (cx - 0.5) / 2, (cy - 0.5) / 2
    return Pyramid(InverseDepthGrid(fine, (fx, fy, cx, cy), sigma), InverseDepthGrid(half, of_half, sigma))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion p_second = R p_first + t in optical axes."""

    rotation_rad: Floats  # (3,) rotation vector of R
    rotation_sd_rad: Floats  # (3,) its standard deviation by the depth noise
    # (3,) t if the rotation is the guess, which is more accurate than the images: otherwise t would compensate the
    # error of the rotation
    given_rotation_m: Floats


def motion_between(
    first: Pyramid,
    second: Pyramid,
    R_second_first: Floats,
    t_second_first_m: Floats | None = None,
    rounds: int = 1,
) -> Motion | None:
    """Returns the rigid motion between two images; None if too little is measured in both.

    The motion is measured in both directions and averaged: the errors of interpolation depend on which image is
    interpolated, and would otherwise bias the result. The prior of the translation is 0 with a standard deviation of
    TRANSLATION_PRIOR_M, whatever the guess: if the scene does not determine the translation, the result is too short.

    Args:
        first, second: grids of the two images.
        R_second_first: (3, 3) the guess.
        t_second_first_m: (3,) the guess; None: 0.
        rounds: number of repetitions of all steps, each from the result before."""
    forward, information = R_second_first.copy(), np.empty((2, 6, 6))
    backward = np.ascontiguousarray(R_second_first.T)
    t_forward = np.zeros(3) if t_second_first_m is None else t_second_first_m.copy()
    t_backward = -backward @ t_forward
    for R, t, a, b, out in (
        (forward, t_forward, first, second, information[0]),
        (backward, t_backward, second, first, information[1]),
    ):
        for _ in range(rounds):
            if not _align_pyramid(a, b, R, t, out):
                return None
    variances = np.array([np.diag(np.linalg.inv(H))[:3] for H in information])
    if not (np.all(variances > 0.0) and np.all(np.isfinite(variances))):
        return None
    rotation = 0.5 * (rotation_vector(forward) - rotation_vector(backward))
    given_forward = t_forward + _translation_change(information[0], forward @ R_second_first.T)
    given_backward = t_backward + _translation_change(information[1], backward @ R_second_first)
    return Motion(
        rotation,
        np.sqrt(variances.max(axis=0)),
        0.5 * (given_forward - R_second_first @ given_backward),
    )


def _translation_change(H: Floats, R_estimate_guess: Floats) -> Floats:
    """Returns the change of the translation (3,), m, if the rotation returns to its guess. H: (6, 6) of `_align_pyramid`."""
    return np.asarray(np.linalg.solve(H[3:, 3:], H[3:, :3] @ rotation_vector(R_estimate_guess)))


def rotation_vector(R: Floats) -> Floats:
    """Returns the rotation vector (3,) of a rotation (3, 3) by less than a quarter turn."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    sine = math.sqrt(float(axis @ axis))
    return axis if sine < 1e-9 else np.asarray(axis * (math.asin(min(1.0, sine)) / sine))
