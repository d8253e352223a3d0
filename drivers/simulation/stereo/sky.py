"""The sky: brightness as a function of direction alone, so that it lies at infinity for every camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .textures import Floats, kernel, value_noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """Sky and sun."""

    # horizon, zenith: brightness in units of a white surface in full light
    horizon: float = 0.85
    zenith: float = 0.45
    cloud_contrast: float = 0.0  # brightness of the clouds over that of the sky behind them (0: none)
    cloud_cover: float = 0.5  # 0..1
    # sun_azimuth_rad, sun_elevation_rad: where the sun is, also for the light on surfaces
    sun_azimuth_rad: float = 2.4
    sun_elevation_rad: float = 0.8
    # brightness of the veil that its light makes in the lens, at the sun (0: the sun is behind a veil and not drawn)
    glare: float = 0.0
    ambient: float = 0.45  # share of the light that comes from no direction

    def row(self) -> Floats:
        """(9,) float64 for the kernels."""
        c = math.cos(self.sun_elevation_rad)
        sun = (
            c * math.cos(self.sun_azimuth_rad),
            c * math.sin(self.sun_azimuth_rad),
            -math.sin(self.sun_elevation_rad),
        )
        return np.array(
            [self.horizon, self.zenith, self.cloud_contrast, self.cloud_cover, *sun, self.glare, self.ambient]
        )


CLEAR = Sky()
HAZY = Sky(horizon=0.95, zenith=0.85, ambient=0.7)
CLOUDED = Sky(cloud_contrast=0.35, cloud_cover=0.55, ambient=0.55)
FAINT_CLOUDS = Sky(horizon=0.9, zenith=0.75, cloud_contrast=0.04, cloud_cover=0.6, ambient=0.7)
LOW_SUN = Sky(sun_azimuth_rad=0.25, sun_elevation_rad=0.3, glare=0.9)
SKIES: dict[str, Sky] = {"clear": CLEAR, "hazy": HAZY, "clouds": CLOUDED, "faint_clouds": FAINT_CLOUDS, "sun": LOW_SUN}
_HORIZON_SCALE = 0.25


@kernel
def _clouds(dx: float, dy: float, up: float, cover: float, pixel_rad: float, seed: int) -> float:
    """How much cloud there is in a direction, 0..1. A flat layer: its features shrink towards the horizon."""
    flat = max(up, 0.02)
    x, y = dx / flat, dy / flat
    footprint = pixel_rad / (flat * flat)
    total, wavelength, amplitude = 0.0, 1.6, 0.6
    for i in range(7):
        visible = 0.5 * wavelength / footprint - 1.0
        if visible <= 0.0:
            break
        s = 2.0 / wavelength
        total += amplitude * min(1.0, visible) * value_noise(x * s + 9.1 * i, y * s + 4.7 * i, 0.5, seed + i)
        wavelength *= 0.5
        amplitude *= 0.62
    return min(1.0, max(0.0, (total + cover - 0.5) * 1.4 + 0.3))


@kernel
def sky_radiance(dx: float, dy: float, dz: float, row: Floats, pixel_rad: float, seed: int) -> float:
    """Brightness in a unit direction (ned). Below the horizon the horizon's, dimmer."""
    up = -dz
    if up <= 0.0:
        return row[0] * max(0.6, 1.0 + 4.0 * up)
    value = row[1] + (row[0] - row[1]) * math.exp(-up / _HORIZON_SCALE)
    if row[2] > 0.0:
        fade = min(1.0, up / 0.06)
        value *= 1.0 + row[2] * fade * _clouds(dx, dy, up, row[3], pixel_rad, seed)
    return value


@kernel
def glare_radiance(dx: float, dy: float, dz: float, row: Floats) -> float:
    """The veil over everything in a direction, and the sun's own disc."""
    if row[7] <= 0.0:
        return 0.0
    cosine = min(1.0, max(-1.0, dx * row[4] + dy * row[5] + dz * row[6]))
    angle = math.acos(cosine)
    veil = row[7] * (math.exp(-angle / 0.05) * 3.0 + math.exp(-angle / 0.35))
    return veil + (30.0 if angle < 0.006 else 0.0)
