"""Large plane surfaces of one depth image at any inclination, with their normals and the accuracy of these.

The mount check uses them: it needs the inclination of ground and walls as measured, without the bounds that the
ground search puts on a slope. A plane is linear in inverse depth: n . P = d gives 1/Z = w . (x, y, 1), with w = n / d
and the pixel's tangents x, y. The noise of stereo is constant in inverse depth (sigma_Z = ke Z^2 gives sigma(1/Z) =
ke). Each patch of the image therefore keeps the moments of a linear fit, and a surface is fitted to the sum of the
moments of its patches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, inner_inline, kernel, record
from ..types import FAR_MM, CameraInfo
from .surface_types import Surface, Surfaces

PATCHES_ACROSS = 32
"""Patches per row of the image."""
SAMPLES = 8
"""Greatest number of samples of a patch along each side."""
MIN_FILLED = 0.6
"""Least share of a patch's samples that are measured."""
MIN_PATCHES = 6
"""Least number of patches of a surface, 0.8 % of the image."""
MAX_SURFACES = 6
MAX_SEEDS = 16
"""Number of patches, spread over those left, from which a surface is tried."""
FIT_ROUNDS = 4
MAX_ROUGHNESS = 3.0
"""Greatest residual of a plane patch, over the expected noise."""
FINAL_ROUGHNESS = 1.5
"""The same in the last round of a fit: patches with the foot of a wall beside the ground would incline it."""
RELATIVE_ROUGHNESS = 0.01
"""Share of the inverse depth that is added to that residual, whatever the configured noise."""

MOMENTS = ("n", "x", "y", "xx", "xy", "yy", "q", "xq", "yq", "qq")
PATCH = record(*((name, np.float64) for name in (*MOMENTS, "w_x", "w_y", "w_z", "rms")))
"""A patch of the image. n to qq: moments of its samples (n: their number, 0: not usable, negative: not a plane),
where x and y are tangents and q the inverse depth. w: solution of the fit. rms: its residual, 1/m."""
SURFACE = record(
    *((name, np.float64) for name in ("w_x", "w_y", "w_z", "patches", "misfit", "spread")),
    *((name, np.float64) for name in ("c_xx", "c_xy", "c_xz", "c_yy", "c_yz", "c_zz")),
)
"""A surface: w, its number of patches, its residual over the noise, the standard deviation of its inverse depth
without this residual, and the inverse of the normal matrix of the fit."""


@inner
def clear_moments(m):
    """Sets the moments of a record of PATCH to 0."""
    m.n, m.x, m.y, m.xx, m.xy, m.yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    m.q, m.xq, m.yq, m.qq = 0.0, 0.0, 0.0, 0.0


@inner
def add_moments(total, m):
    """Adds the moments of one record of PATCH to another."""
    total.n += m.n
    total.x += m.x
    total.y += m.y
    total.xx += m.xx
    total.xy += m.xy
    total.yy += m.yy
    total.q += m.q
    total.xq += m.xq
    total.yq += m.yq
    total.qq += m.qq


@inner
def solve(m):
    """Solves the normal equations of a record of PATCH for its w; returns False if they are singular."""
    if m.n < 3.0:
        return False
    axx, axy, ayy = m.xx - m.x * m.x / m.n, m.xy - m.x * m.y / m.n, m.yy - m.y * m.y / m.n
    bx, by = m.xq - m.x * m.q / m.n, m.yq - m.y * m.q / m.n
    det = axx * ayy - axy * axy
    if not det > 1e-9 * axx * ayy:
        return False
    m.w_x, m.w_y = (ayy * bx - axy * by) / det, (axx * by - axy * bx) / det
    m.w_z = (m.q - m.w_x * m.x - m.w_y * m.y) / m.n
    return True


@inner
def mean_square(m, plane):
    """Returns the mean squared residual of the inverse depths of a record of PATCH for w of another record, from the
    moments."""
    wx, wy, wz = plane.w_x, plane.w_y, plane.w_z
    linear = wx * m.xq + wy * m.yq + wz * m.q
    square = wx * wx * m.xx + wy * wy * m.yy + wz * wz * m.n
    square += 2.0 * (wx * wy * m.xy + wx * wz * m.x + wy * wz * m.y)
    return max(0.0, (m.qq - 2.0 * linear + square) / m.n)


@inner
def measure_patches(depth_mm, k, low_mm, high_mm, size, patches):
    """Computes moments, solution and residual of each patch of size x size pixels; returns the number of usable
    patches.

    Args:
        depth_mm: (H, W) uint16.
        k: (4,) fx, fy, cx, cy.
        low_mm, high_mm: depths that count as measured.
        size: side of a patch.
        patches: (P,) PATCH out, row by row; n = 0 where a patch is not usable."""
    across, down = depth_mm.shape[1] // size, depth_mm.shape[0] // size
    step = max(1, size // SAMPLES)
    least = MIN_FILLED * (-(-size // step)) ** 2
    good = 0
    for i in range(across * down):
        m = patches[i]
        clear_moments(m)
        m.w_x, m.w_y, m.w_z, m.rms = 0.0, 0.0, 0.0, 0.0
        top, left = (i // across) * size, (i % across) * size
        for v in range(top + step // 2, top + size, step):
            y = (v - k[3]) / k[1]
            for u in range(left + step // 2, left + size, step):
                mm = depth_mm[v, u]
                if mm < low_mm or mm > high_mm:
                    continue
                x, q = (u - k[2]) / k[0], 1000.0 / mm
                m.n += 1.0
                m.x += x
                m.y += y
                m.xx += x * x
                m.xy += x * y
                m.yy += y * y
                m.q += q
                m.xq += x * q
                m.yq += y * q
                m.qq += q * q
        if m.n < least or not solve(m):
            m.n = 0.0
            continue
        m.rms = math.sqrt(mean_square(m, m))
        good += 1
    return good


@inner
def allowed_rms(m, noise, times):
    """Returns the greatest residual of a patch of a plane: `times` the noise, and the roughness of real surfaces."""
    return times * noise + RELATIVE_ROUGHNESS * m.q / m.n


@inner
def is_on(m, plane, noise, times):
    """True if a patch lies on the plane w of another record."""
    return math.sqrt(mean_square(m, plane)) <= allowed_rms(m, noise, times)


@inner_inline
def is_free(m, taken):
    """True if a patch is plane and belongs to no surface."""
    return m.n > 0.0 and taken == 0


@inner
def count_on(patches, taken, plane, noise):
    """Returns the number of free patches on a plane."""
    n = 0
    for i in range(patches.shape[0]):
        if is_free(patches[i], taken[i]):
            n += is_on(patches[i], plane, noise, MAX_ROUGHNESS)
    return n


@inner
def seed_plane(patches, taken, across, i, noise, total):
    """Fits a plane to a patch and its neighbours to the right and below into `total`; returns False if they are not
    one plane."""
    clear_moments(total)
    for j in (i, i + 1, i + across, i + across + 1):
        if j < patches.shape[0] and is_free(patches[j], taken[j]):
            add_moments(total, patches[j])
    if total.n < 2.0 * patches[i].n or not solve(total):
        return False
    return math.sqrt(mean_square(total, total)) <= allowed_rms(total, noise, MAX_ROUGHNESS)


@inner
def best_seed(patches, taken, across, noise, total, best):
    """Finds the seed whose plane contains most patches; returns their number. best: its w. total, best: records of
    PATCH."""
    free, at, most = 0, 0, 0
    for i in range(patches.shape[0]):
        free += is_free(patches[i], taken[i])
    if free < MIN_PATCHES:
        return 0
    every = max(1, free // MAX_SEEDS)
    for i in range(patches.shape[0]):
        if patches[i].n == 0.0 or taken[i] != 0:
            continue
        at += 1
        if at % every == 0 and seed_plane(patches, taken, across, i, noise, total):
            n = count_on(patches, taken, total, noise)
            if n > most:
                most, best.w_x, best.w_y, best.w_z = n, total.w_x, total.w_y, total.w_z
    return most


@inner
def grow_surface(patches, taken, across, noise, scratch, surface, mark):
    """Finds one more surface, the plane with most patches of those grown from seeds; returns its number of patches,
    0: none.

    Args:
        patches: (P,) PATCH.
        taken: (P,) uint8, in and out, `mark` where a patch belongs to it.
        across: patches per row.
        noise: of inverse depth.
        scratch: (2,) PATCH.
        surface: a record of SURFACE, out.
        mark: number of the surface."""
    total, best = scratch[0], scratch[1]
    if best_seed(patches, taken, across, noise, total, best) < MIN_PATCHES:
        return 0
    for k in range(FIT_ROUNDS):
        times = MAX_ROUGHNESS + (FINAL_ROUGHNESS - MAX_ROUGHNESS) * k / (FIT_ROUNDS - 1)
        clear_moments(total)
        for i in range(patches.shape[0]):
            if is_free(patches[i], taken[i]) and is_on(patches[i], best, noise, times):
                add_moments(total, patches[i])
        if not solve(total):
            return 0
        best.w_x, best.w_y, best.w_z = total.w_x, total.w_y, total.w_z
    n = 0
    for i in range(patches.shape[0]):
        if is_free(patches[i], taken[i]) and is_on(patches[i], best, noise, FINAL_ROUGHNESS):
            taken[i] = mark
            n += 1
    surface.w_x, surface.w_y, surface.w_z, surface.patches = best.w_x, best.w_y, best.w_z, n
    rest, mean = mean_square(total, best), total.q / total.n
    surface.misfit = math.sqrt(rest) / noise
    surface.spread = math.sqrt(max(0.0, total.qq / total.n - mean * mean - rest))
    return n if _inverse(total, surface) and n >= MIN_PATCHES else 0


@inner
def _inverse(m, surface):
    """Writes the inverse of the normal matrix of moments to a record of SURFACE; returns False if it is singular."""
    a, b, c, d, e, f = m.xx, m.xy, m.x, m.yy, m.y, m.n
    det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    if not det > 0.0:
        return False
    surface.c_xx, surface.c_xy, surface.c_xz = (d * f - e * e) / det, (c * e - b * f) / det, (b * e - c * d) / det
    surface.c_yy, surface.c_yz, surface.c_zz = (a * f - c * c) / det, (b * c - a * e) / det, (a * d - b * b) / det
    return True


@kernel
def search_surfaces(depth_mm, k, low_mm, high_mm, size, ke, surfaces, patches):
    """Fills surfaces (MAX_SURFACES,) SURFACE, the largest first, and patches (P,) PATCH; returns (surfaces, noise
    used)."""
    count = patches.shape[0]
    good = measure_patches(depth_mm, k, low_mm, high_mm, size, patches)
    # The noise is the lower quartile of the patches' residuals, at least the configured noise of the camera.
    rms, found = np.empty(good), 0
    for i in range(count):
        if patches[i].n > 0.0:
            rms[found] = patches[i].rms
            found += 1
    rms.sort()
    noise = max(ke, rms[good // 4]) if good > 0 else ke
    for i in range(count):
        m = patches[i]
        if m.n > 0.0 and m.rms > allowed_rms(m, noise, MAX_ROUGHNESS):
            m.n = -m.n  # measured, but not a plane
    taken, scratch = np.zeros(count, np.uint8), np.zeros(2, PATCH)
    found = 0
    across = depth_mm.shape[1] // size
    for _ in range(MAX_SURFACES):
        if grow_surface(patches, taken, across, noise, scratch, surfaces[found], found + 1) == 0:
            break
        found += 1
    return found, noise


def find_surfaces(depth_mm: NDArray[np.uint16], info: CameraInfo, R_level_optical: Rotation, ke: float) -> Surfaces:
    """Returns the largest plane surfaces of a depth image (H, W) uint16 mm in level_cam. R_level_optical: (3, 3)."""
    k = info.intrinsics
    size = max(4, k.width // PATCHES_ACROSS)
    low_mm = info.least_mm
    high_mm = min(FAR_MM - 1, round(1000.0 * info.max_range_m))
    image = np.ascontiguousarray(depth_mm).view()
    image.flags.writeable = False  # read-only, so that one compiled kernel serves all frames
    R, table = np.asarray(R_level_optical, np.float64), np.zeros(MAX_SURFACES, SURFACE)
    patches = np.zeros((image.shape[1] // size) * (image.shape[0] // size), PATCH)
    count, noise = search_surfaces(image, np.array([k.fx, k.fy, k.cx, k.cy]), low_mm, high_mm, size, ke, table, patches)
    planes = tuple(_surface(row, R, noise, len(patches)) for row in table[:count])
    m = patches[patches["n"] != 0.0]
    rays = np.stack([m["x"], m["y"], np.abs(m["n"])], axis=1) / m["q"][:, None]
    return Surfaces(planes, len(m) / max(1, len(patches)), rays @ R.T, float(noise), info.ke_per_m)


def _surface(row: Any, R: Rotation, noise: float, patches: int) -> Surface:
    w = row.w_x, row.w_y, row.w_z
    length = math.sqrt(float(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]))
    x, y, z = (float(R[i, 0] * w[0] + R[i, 1] * w[1] + R[i, 2] * w[2]) / length for i in range(3))
    # the variance of the worst direction is an upper bound for any inclination
    crosswise = max(abs(row.c_xy), abs(row.c_xz), abs(row.c_yz))
    sd = noise * math.sqrt(max(0.0, float(row.c_xx + row.c_yy + row.c_zz + 2.0 * crosswise))) / length
    return Surface(
        (x, y, z), 1.0 / length, float(row.patches) / max(1, patches), sd, float(row.misfit), float(row.spread)
    )
