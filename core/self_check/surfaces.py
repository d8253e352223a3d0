"""Large plane surfaces of one depth image, at any inclination, with their normals and how well these are known.

The mount check reads them: it needs the inclination of the ground and of walls as measured, without the bounds that the
search for the ground puts on a slope. A plane is linear in inverse depth: n . P = d gives 1/Z = w . (x, y, 1) with w = n / d
and x, y the pixel's tangents, and the noise of stereo is constant in inverse depth (sigma_Z = ke Z^2 gives sigma(1/Z) = ke).
So each patch of the image keeps the moments of a linear fit, and a surface is fitted to the sum of its patches' moments.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..frames import Rotation
from ..jit import inner, kernel
from ..types import FAR_MM, CameraInfo
from .surface_types import Surface, Surfaces

Floats = NDArray[np.float64]

PATCHES_ACROSS = 32
"""Patches in a row of the image; each is sampled at 8 x 8 pixels at most."""
SAMPLES = 8
MIN_FILLED = 0.6
"""Share of a patch's samples that must hold a measurement."""
MIN_PATCHES = 6
"""Least patches of a surface: 0.8 % of the image."""
MAX_SURFACES = 6
MAX_SEEDS = 16
"""Patches from which a surface is tried to be grown, spread over those that are left."""
FIT_ROUNDS = 4
MAX_ROUGHNESS = 3.0
"""A patch is plane when its residual is at most this many times the expected noise."""
FINAL_ROUGHNESS = 1.5
"""And in the last round of a fit: patches that hold the foot of a wall beside the ground would incline it."""
RELATIVE_ROUGHNESS = 0.01
"""And this much of the inverse depth, whatever the configured noise."""

# columns of the table of patches: moments of the fit (count, x, y, xx, xy, yy, q, xq, yq, qq), then its solution and residual
M_N, M_X, M_Y, M_XX, M_XY, M_YY, M_Q, M_XQ, M_YQ, M_QQ, W_X, W_Y, W_Z, RMS = range(14)
# columns of the table of surfaces: w, its patches, its residual over the noise, then the upper triangle of the inverse normal matrix
S_WX, S_WY, S_WZ, S_PATCHES, S_MISFIT, S_C0 = range(6)
SURFACE_COLUMNS = S_C0 + 6


@inner
def solve(m, w):
    """w: (3,) solution of the normal equations of the moments m (10 or more); False where they are singular."""
    n, sx, sy, sxx, sxy, syy = m[M_N], m[M_X], m[M_Y], m[M_XX], m[M_XY], m[M_YY]
    if n < 3.0:
        return False
    axx, axy, ayy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
    bx, by = m[M_XQ] - sx * m[M_Q] / n, m[M_YQ] - sy * m[M_Q] / n
    det = axx * ayy - axy * axy
    if not det > 1e-9 * axx * ayy:
        return False
    w[0], w[1] = (ayy * bx - axy * by) / det, (axx * by - axy * bx) / det
    w[2] = (m[M_Q] - w[0] * sx - w[1] * sy) / n
    return True


@inner
def mean_square(m, wx, wy, wz):
    """Mean squared residual of the inverse depths against w, from the moments."""
    linear = wx * m[M_XQ] + wy * m[M_YQ] + wz * m[M_Q]
    square = wx * wx * m[M_XX] + wy * wy * m[M_YY] + wz * wz * m[M_N]
    square += 2.0 * (wx * wy * m[M_XY] + wx * wz * m[M_X] + wy * wz * m[M_Y])
    return max(0.0, (m[M_QQ] - 2.0 * linear + square) / m[M_N])


@inner
def measure_patches(depth_mm, k, low_mm, high_mm, size, patches):
    """Moments, solution and residual of each patch of size x size pixels, row by row; returns the number of plane patches.

    depth_mm: (H, W) uint16; k: (4,) fx, fy, cx, cy; patches: (P, 14) float64 out, M_N = 0 where a patch is not usable."""
    across, down = depth_mm.shape[1] // size, depth_mm.shape[0] // size
    step = max(1, size // SAMPLES)
    least = MIN_FILLED * (-(-size // step)) ** 2
    good = 0
    for i in range(across * down):
        m = patches[i]
        m[:] = 0.0
        top, left = (i // across) * size, (i % across) * size
        for v in range(top + step // 2, top + size, step):
            y = (v - k[3]) / k[1]
            for u in range(left + step // 2, left + size, step):
                mm = depth_mm[v, u]
                if mm < low_mm or mm > high_mm:
                    continue
                x, q = (u - k[2]) / k[0], 1000.0 / mm
                m[M_N] += 1.0
                m[M_X] += x
                m[M_Y] += y
                m[M_XX] += x * x
                m[M_XY] += x * y
                m[M_YY] += y * y
                m[M_Q] += q
                m[M_XQ] += x * q
                m[M_YQ] += y * q
                m[M_QQ] += q * q
        if m[M_N] < least or not solve(m, m[W_X : W_Z + 1]):
            m[M_N] = 0.0
            continue
        m[RMS] = math.sqrt(mean_square(m, m[W_X], m[W_Y], m[W_Z]))
        good += 1
    return good


@inner
def allowed_rms(m, noise, times):
    """Most residual of a patch of a plane: of the noise, and of the roughness of real surfaces."""
    return times * noise + RELATIVE_ROUGHNESS * m[M_Q] / m[M_N]


@inner
def is_on(m, wx, wy, wz, noise, times):
    """Whether a patch lies on a plane."""
    return math.sqrt(mean_square(m, wx, wy, wz)) <= allowed_rms(m, noise, times)


@inner
def count_on(patches, taken, w, noise, times):
    """How many free patches lie on the plane w."""
    n = 0
    for i in range(patches.shape[0]):
        m = patches[i]
        if m[M_N] > 0.0 and taken[i] == 0:
            n += is_on(m, w[0], w[1], w[2], noise, times)
    return n


@inner
def seed_plane(patches, taken, across, i, noise, total, w):
    """The plane of a patch and its neighbour to the right, below, and between; False where they are not one plane."""
    total[:] = 0.0
    for j in (i, i + 1, i + across, i + across + 1):
        if j < patches.shape[0] and patches[j, M_N] > 0.0 and taken[j] == 0:
            for c in range(M_QQ + 1):
                total[c] += patches[j, c]
    if total[M_N] < 2.0 * patches[i, M_N] or not solve(total, w):
        return False
    return math.sqrt(mean_square(total, w[0], w[1], w[2])) <= allowed_rms(total, noise, MAX_ROUGHNESS)


@inner
def grow_surface(patches, taken, across, noise, total, w, best, surface, mark):
    """One more surface: the plane with most patches among those grown from seeds. Returns its number of patches, 0 if none.

    taken: (P,) uint8, `mark` where a patch now belongs to it."""
    free = 0
    for i in range(patches.shape[0]):
        free += patches[i, M_N] > 0.0 and taken[i] == 0
    if free < MIN_PATCHES:
        return 0
    every, at, most = max(1, free // MAX_SEEDS), 0, 0
    for i in range(patches.shape[0]):
        if patches[i, M_N] == 0.0 or taken[i] != 0:
            continue
        at += 1
        if at % every == 0 and seed_plane(patches, taken, across, i, noise, total, w):
            n = count_on(patches, taken, w, noise, MAX_ROUGHNESS)
            if n > most:
                most, best[0], best[1], best[2] = n, w[0], w[1], w[2]
    if most < MIN_PATCHES:
        return 0
    for k in range(FIT_ROUNDS):
        times = MAX_ROUGHNESS + (FINAL_ROUGHNESS - MAX_ROUGHNESS) * k / (FIT_ROUNDS - 1)
        total[:] = 0.0
        for i in range(patches.shape[0]):
            m = patches[i]
            if m[M_N] > 0.0 and taken[i] == 0 and is_on(m, best[0], best[1], best[2], noise, times):
                for c in range(M_QQ + 1):
                    total[c] += m[c]
        if not solve(total, best):
            return 0
    n = 0
    for i in range(patches.shape[0]):
        m = patches[i]
        if m[M_N] > 0.0 and taken[i] == 0 and is_on(m, best[0], best[1], best[2], noise, FINAL_ROUGHNESS):
            taken[i] = mark
            n += 1
    surface[S_WX], surface[S_WY], surface[S_WZ], surface[S_PATCHES] = best[0], best[1], best[2], n
    surface[S_MISFIT] = math.sqrt(mean_square(total, best[0], best[1], best[2])) / noise
    return n if _inverse(total, surface) and n >= MIN_PATCHES else 0


@inner
def _inverse(m, surface):
    """Writes the inverse of the normal matrix of moments m: xx, xy, xz, yy, yz, zz; False where it is singular."""
    a, b, c, d, e, f = m[M_XX], m[M_XY], m[M_X], m[M_YY], m[M_Y], m[M_N]
    det = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    if not det > 0.0:
        return False
    surface[S_C0], surface[S_C0 + 1], surface[S_C0 + 2] = (
        (d * f - e * e) / det,
        (c * e - b * f) / det,
        (b * e - c * d) / det,
    )
    surface[S_C0 + 3], surface[S_C0 + 4], surface[S_C0 + 5] = (
        (a * f - c * c) / det,
        (b * c - a * e) / det,
        (a * d - b * b) / det,
    )
    return True


@kernel
def search_surfaces(depth_mm, k, low_mm, high_mm, size, ke, surfaces):
    """Fills surfaces (MAX_SURFACES, SURFACE_COLUMNS) by falling size; returns (surfaces, patches (P, 14), noise used)."""
    count = (depth_mm.shape[1] // size) * (depth_mm.shape[0] // size)
    patches = np.empty((count, RMS + 1), np.float64)
    measure_patches(depth_mm, k, low_mm, high_mm, size, patches)
    # the noise is that of the smoother half of the patches where it is more than the camera is said to have
    rms = np.sort(patches[patches[:, M_N] > 0.0, RMS])
    noise = max(ke, rms[len(rms) // 4]) if len(rms) > 0 else ke
    for i in range(count):
        m = patches[i]
        if m[M_N] > 0.0 and m[RMS] > allowed_rms(m, noise, MAX_ROUGHNESS):
            m[M_N] = -m[M_N]  # measured, and no plane
    taken, total = np.zeros(count, np.uint8), np.empty(M_QQ + 1, np.float64)
    w, best = np.empty(3, np.float64), np.empty(3, np.float64)
    found = 0
    across = depth_mm.shape[1] // size
    for _ in range(MAX_SURFACES):
        if grow_surface(patches, taken, across, noise, total, w, best, surfaces[found], found + 1) == 0:
            break
        found += 1
    return found, patches, noise


def find_surfaces(depth_mm: NDArray[np.uint16], info: CameraInfo, R_level_optical: Rotation, ke: float) -> Surfaces:
    """The largest plane surfaces of a depth image (H, W) uint16 mm, in level_cam as R_level_optical (3, 3) has it."""
    k = info.intrinsics
    size = max(4, k.width // PATCHES_ACROSS)
    low_mm = max(1, round(1000.0 * info.min_range_m))
    high_mm = min(FAR_MM - 1, round(1000.0 * info.max_range_m))
    image = np.ascontiguousarray(depth_mm).view()
    image.flags.writeable = False  # one compiled kernel for frames that may be written and for those that may not
    R, table = np.asarray(R_level_optical, np.float64), np.zeros((MAX_SURFACES, SURFACE_COLUMNS), np.float64)
    count, patches, noise = search_surfaces(image, np.array([k.fx, k.fy, k.cx, k.cy]), low_mm, high_mm, size, ke, table)
    planes = tuple(_surface(row, R, noise, len(patches)) for row in table[:count])
    m = patches[patches[:, M_N] != 0.0]
    n = np.abs(m[:, M_N])
    rays = np.stack([m[:, M_X], m[:, M_Y], n], axis=1) / m[:, M_Q, None]
    return Surfaces(planes, len(m) / max(1, len(patches)), rays @ R.T, float(noise))


def _surface(row: Floats, R: Rotation, noise: float, patches: int) -> Surface:
    w = row[S_WX : S_WZ + 1]
    length = math.sqrt(float(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]))
    x, y, z = (float(R[i, 0] * w[0] + R[i, 1] * w[1] + R[i, 2] * w[2]) / length for i in range(3))
    a, b, c, d, e, f = row[S_C0:].tolist()
    # the worst direction's variance bounds that of any inclination
    sd = noise * math.sqrt(max(0.0, a + d + f + 2.0 * max(abs(b), abs(c), abs(e)))) / length
    return Surface((x, y, z), 1.0 / length, float(row[S_PATCHES]) / max(1, patches), sd, float(row[S_MISFIT]))
