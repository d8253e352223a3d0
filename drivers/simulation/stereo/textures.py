"""Procedural surface textures: brightness as a function of a point in the world, filtered to the size of a pixel.

A texture is a sum of octaves of value noise in the three coordinates of the world, with a pattern (bricks, bars) in the
coordinates of the surface on top. An octave whose wavelength the pixel does not resolve fades out, and each octave is averaged
over the length of the pixel on a slanted surface. Otherwise its samples would alias, and the images of two cameras would differ
where their rows cross the surface at different places."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

_F = TypeVar("_F", bound=Callable[..., object])
Floats = NDArray[np.float64]
MATERIAL_ROW = 10
"""Length of the row of numbers of one material."""
FOOTPRINT_ROW = 6
"""Length of the row of numbers of a pixel on a surface: its size across the slope, m; its length along the slope, m; its mean size, for
patterns, m; unit vector along the slope (3)."""


def kernel(function: _F) -> _F:
    """The compiled form of a function, under its own type."""
    return cast(_F, njit(cache=True, nogil=True)(function))


class Pattern(IntEnum):
    """A regular pattern on a surface."""

    NONE = 0
    BRICK = 1
    VERTICAL_BARS = 2
    HORIZONTAL_BARS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """The look of a surface."""

    albedo: float  # mean reflectance 0..1
    contrast: float = 0.0  # standard deviation of the noise over the mean
    # coarse_m, fine_m: longest and shortest wavelength of the noise
    coarse_m: float = 0.5
    fine_m: float = 0.02
    persistence: float = 0.8  # amplitude of an octave over that of the next longer one
    # with period_m (along the surface, up the surface) and width_m of its lines, whose reflectance is line_albedo
    pattern: Pattern = Pattern.NONE
    period_m: tuple[float, float] = (1.0, 1.0)
    width_m: float = 0.01
    line_albedo: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.albedo <= 1.0 or not 0.0 <= self.line_albedo <= 1.0:
            raise ValueError(f"material: albedo {self.albedo:g} and line_albedo {self.line_albedo:g}, expected 0..1")
        if not 0.0 <= self.contrast <= 1.0:
            raise ValueError(f"material: contrast {self.contrast:g}, expected 0..1")
        if not 0.001 <= self.fine_m <= self.coarse_m:
            raise ValueError(
                f"material: wavelengths {self.fine_m:g}..{self.coarse_m:g} m, expected 0.001 <= fine <= coarse"
            )

    def row(self) -> Floats:
        """(MATERIAL_ROW,) for the kernels. The amplitude of the first octave gives the sum the contrast asked for."""
        octaves = 1 + math.floor(math.log2(self.coarse_m / self.fine_m) + 1e-9)
        powers = sum(self.persistence ** (2 * i) for i in range(octaves))
        first = self.contrast / (_NOISE_STD * math.sqrt(powers))
        return np.array(
            [
                self.albedo,
                first,
                self.coarse_m,
                float(octaves),
                self.persistence,
                float(self.pattern),
                *self.period_m,
                self.width_m,
                self.line_albedo,
            ]
        )


_NOISE_STD = 0.31
"""Standard deviation of one octave: uniform lattice values in -1..1 after smooth interpolation in three dimensions."""

BRICK = Material(
    albedo=0.32,
    contrast=0.18,
    coarse_m=0.3,
    fine_m=0.01,
    pattern=Pattern.BRICK,
    period_m=(0.25, 0.083),
    width_m=0.012,
    line_albedo=0.6,
)
PLASTER = Material(albedo=0.6, contrast=0.07, coarse_m=1.0, fine_m=0.008, persistence=0.95)
GRASS = Material(albedo=0.2, contrast=0.35, coarse_m=1.6, fine_m=0.0125, persistence=0.9)
GRAVEL = Material(albedo=0.35, contrast=0.3, coarse_m=0.1, fine_m=0.0125, persistence=0.9)
LEAVES = Material(albedo=0.16, contrast=0.5, coarse_m=0.6, fine_m=0.0375, persistence=1.0)
BARK = Material(albedo=0.18, contrast=0.35, coarse_m=0.2, fine_m=0.0125)
ASPHALT = Material(albedo=0.14, contrast=0.15, coarse_m=1.2, fine_m=0.0094, persistence=1.0)
CONCRETE = Material(albedo=0.45, contrast=0.08, coarse_m=2.0, fine_m=0.0156, persistence=0.85)
BLANK_PAINT = Material(albedo=0.5)
WHITE_PAINT = Material(albedo=0.85)
METAL = Material(albedo=0.3, contrast=0.05, coarse_m=0.5, fine_m=0.03)
SKIN = Material(albedo=0.45, contrast=0.08, coarse_m=0.04, fine_m=0.0025, persistence=0.9)
WOOD = Material(albedo=0.3, contrast=0.2, coarse_m=0.4, fine_m=0.0125)
BLINDS = Material(albedo=0.7, pattern=Pattern.VERTICAL_BARS, period_m=(0.127, 1.0), width_m=0.02, line_albedo=0.25)


@kernel
def lattice(ix: int, iy: int, iz: int, seed: int) -> float:
    """A fixed pseudo-random number in -1..1 of a lattice point."""
    h = np.uint64(ix) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(iy) * np.uint64(0xC2B2AE3D27D4EB4F)
    h = h ^ np.uint64(iz) * np.uint64(0x165667B19E3779F9) ^ np.uint64(seed) * np.uint64(0x27D4EB2F165667C5)
    h = (h ^ (h >> np.uint64(31))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(29))) * np.uint64(0x94D049BB133111EB)
    return float(h >> np.uint64(40)) * (2.0 / 16777215.0) - 1.0


@kernel
def value_noise(x: float, y: float, z: float, seed: int) -> float:
    """Smooth noise with features of about 1, in -1..1."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    ix, iy, iz = int(fx), int(fy), int(fz)
    tx, ty, tz = x - fx, y - fy, z - fz
    tx, ty, tz = tx * tx * (3.0 - 2.0 * tx), ty * ty * (3.0 - 2.0 * ty), tz * tz * (3.0 - 2.0 * tz)
    total = 0.0
    for dz in range(2):
        wz = tz if dz else 1.0 - tz
        for dy in range(2):
            wy = ty if dy else 1.0 - ty
            a, b = lattice(ix, iy + dy, iz + dz, seed), lattice(ix + 1, iy + dy, iz + dz, seed)
            total += wz * wy * (a + tx * (b - a))
    return total


@kernel
def octaves_of(x: float, y: float, z: float, row: Floats, footprint: Floats, seed: int) -> float:
    """The noise of a material in a pixel around a point, relative to its albedo; octaves below 2 footprints are left out.
    footprint: (FOOTPRINT_ROW,)."""
    wavelength, amplitude, total = row[2], row[1], 0.0
    across_m, length_m = footprint[0], footprint[1]
    for i in range(int(row[3])):
        visible = 0.5 * wavelength / across_m - 1.0
        if visible <= 0.0:
            break
        # a lattice step is half a wavelength; the offset keeps the lattices of the octaves apart
        scale, shift = 2.0 / wavelength, 17.31 * i
        samples = max(1, int(math.ceil(length_m * scale)))
        noise = 0.0
        for k in range(samples):
            t = ((k + 0.5) / samples - 0.5) * length_m
            px, py, pz = x + t * footprint[3], y + t * footprint[4], z + t * footprint[5]
            noise += value_noise(px * scale + shift, py * scale + shift, pz * scale, seed + i)
        total += amplitude * min(1.0, visible) * noise / samples
        wavelength *= 0.5
        amplitude *= row[4]
    return total


@kernel
def _line_share(position: float, period: float, width: float, footprint_m: float) -> float:
    """How much of a pixel lies on the lines of a grating."""
    off = abs(position / period - math.floor(position / period + 0.5)) * period
    sharp = min(1.0, max(0.0, (0.5 * width - off) / footprint_m + 0.5))
    mean = width / period
    resolved = min(1.0, max(0.0, period / footprint_m - 1.0))
    return mean + resolved * (sharp - mean)


@kernel
def reflectance(
    x: float, y: float, z: float, along: float, up: float, row: Floats, footprint: Floats, seed: int
) -> float:
    """Reflectance of a material in a pixel around a point of the world; along, up: its coordinates in the surface, metres; footprint:
    (FOOTPRINT_ROW,)."""
    albedo, footprint_m = row[0], footprint[2]
    pattern = int(row[5])
    if pattern == 1:
        course = math.floor(up / row[7])
        bed = _line_share(up, row[7], row[8], footprint_m)
        shift = 0.5 * row[6] if int(course) % 2 else 0.0
        joint = _line_share(along + shift, row[6], row[8], footprint_m)
        share = bed + joint - bed * joint
        brick = albedo * (1.0 + 0.25 * lattice(int(math.floor((along + shift) / row[6] + 0.5)), int(course), 7, seed))
        resolved = min(1.0, max(0.0, row[7] / footprint_m - 1.0))
        albedo = share * row[9] + (1.0 - share) * (albedo + resolved * (brick - albedo))
    elif pattern == 2:
        share = _line_share(along, row[6], row[8], footprint_m)
        albedo = share * row[9] + (1.0 - share) * albedo
    elif pattern == 3:
        share = _line_share(up, row[7], row[8], footprint_m)
        albedo = share * row[9] + (1.0 - share) * albedo
    if row[1] > 0.0:
        albedo *= max(0.05, 1.0 + octaves_of(x, y, z, row, footprint, seed))
    return albedo
