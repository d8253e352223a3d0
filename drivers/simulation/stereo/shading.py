"""The brightness of each ray of an image: the surface it meets in its light, or the sky, through fog."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.types import Intrinsics

from ..ray_caster import CONVEX, CYLINDER, DISC, ELLIPSOID, PLANE, cast_rays
from ..scenes import Scene
from .sky import Sky, glare_radiance, sky_radiance
from .textures import FOOTPRINT_ROW, MATERIAL_ROW, Floats, Material, kernel, octaves_of, reflectance

PROJECTOR_ROW = 5
_LEAST_FACING = 1.0 / 128.0
"""Sine of the angle between ray and surface, below which a pixel is not taken to be longer on the surface: half a degree."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Projector:
    """A dot projector beside the cameras."""

    offset_m: float  # along the baseline from the left camera
    # its brightness on a white surface at 1 m, in units of the scene's light; it falls with the square of the distance
    strength: float
    pitch_rad: float = 0.008  # angle between dots


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """What lies between surfaces and camera."""

    sky: Sky
    fog_per_m: float = 0.0  # extinction
    seed: int = 0  # of textures and clouds
    projector: Projector | None = None


@kernel
def _normal(kind: int, q: Floats, halfspaces: Floats, x: float, y: float, z: float, out: Floats) -> None:
    """Unit normal of a solid at a point of its surface (ned) -> out (3,)."""
    out[0], out[1], out[2] = 0.0, 0.0, -1.0
    if kind == PLANE:
        out[0], out[1], out[2] = q[0], q[1], q[2]
    elif kind == CONVEX:
        best = math.inf
        for i in range(int(q[0]), int(q[0]) + int(q[1])):
            n = halfspaces[i]
            off = abs(n[0] * x + n[1] * y + n[2] * z - n[3])
            if off < best:
                best = off
                out[0], out[1], out[2] = n[0], n[1], n[2]
    elif kind == ELLIPSOID:
        px, py, pz = x - q[0], y - q[1], z - q[2]
        out[0], out[1], out[2] = 0.0, 0.0, 0.0
        for i in range(3):
            m = q[3 + 3 * i] * px + q[4 + 3 * i] * py + q[5 + 3 * i] * pz
            for j in range(3):
                out[j] += m * q[3 + 3 * i + j]
    elif kind == CYLINDER:
        wx, wy, wz = q[3] - q[0], q[4] - q[1], q[5] - q[2]
        length2 = wx * wx + wy * wy + wz * wz
        t = ((x - q[0]) * wx + (y - q[1]) * wy + (z - q[2]) * wz) / length2
        out[0], out[1], out[2] = x - q[0] - t * wx, y - q[1] - t * wy, z - q[2] - t * wz
    elif kind == DISC:
        out[0], out[1], out[2] = q[3], q[4], q[5]
    norm = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    if norm > 0.0:
        for j in range(3):
            out[j] /= norm


@kernel
def _dots(x: float, y: float, z: float, projector: Floats, footprint_m: float, dots: Floats) -> float:
    """Brightness of the projected dots at a point (ned) on a white surface."""
    px, py, pz = x - projector[0], y - projector[1], z - projector[2]
    r = math.sqrt(px * px + py * py + pz * pz)
    value = octaves_of(px / r, py / r, pz / r, dots, np.array([footprint_m / r, 0.0, 0.0, 0.0, 0.0, 0.0]), 991)
    return projector[3] / (r * r) * max(0.0, 1.0 + 2.0 * value)


@kernel
def _footprint(dx: float, dy: float, dz: float, n: Floats, size_m: float, out: Floats) -> None:
    """A pixel of size_m square to its ray, on a surface of unit normal n (3,) -> out (FOOTPRINT_ROW,). dx, dy, dz: unit vector of the
    ray."""
    cosine = dx * n[0] + dy * n[1] + dz * n[2]
    sine, facing = math.sqrt(max(1e-12, 1.0 - cosine * cosine)), abs(cosine)
    out[0], out[1] = size_m, size_m / max(facing, _LEAST_FACING)
    out[2] = size_m / math.sqrt(max(facing, 0.25))
    out[3], out[4], out[5] = (dx - cosine * n[0]) / sine, (dy - cosine * n[1]) / sine, (dz - cosine * n[2]) / sine


class _Rays(NamedTuple):
    """Hits of the rays of a view."""

    z: Floats  # (H, W) depth
    which: NDArray[np.int32]  # (H, W) index of the solid
    k: Floats  # fx, fy, cx, cy
    R_ned_optical: Floats
    origin_m: Floats  # in ned


class _Solids(NamedTuple):
    """Solids of a scene."""

    kinds: NDArray[np.int32]
    rows: Floats
    halfspaces: Floats
    material_of: NDArray[np.int32]  # (S,) row of `materials`
    materials: Floats


class _Lighting(NamedTuple):
    """The light of a scene, for kernels."""

    sky: Floats  # its row
    fog_per_m: float
    seed: int
    # projector, dots: row of the projector and of its dots
    projector: Floats
    dots: Floats
    glare: bool  # whether it is rendered


@kernel
def _shade(rays: _Rays, solids: _Solids, light: _Lighting, out: NDArray[np.float32]) -> None:
    """Brightness of each ray -> out (H, W)."""
    z, which, k, R, origin = rays.z, rays.which, rays.k, rays.R_ned_optical, rays.origin_m
    kinds, rows, material_of, materials = solids.kinds, solids.rows, solids.material_of, solids.materials
    sky, fog_per_m, seed, projector = light.sky, light.fog_per_m, light.seed, light.projector
    n, footprint = np.empty(3), np.empty(FOOTPRINT_ROW)
    pixel = 1.0 / k[0]
    fog = sky[0]
    for v in range(z.shape[0]):
        ry = (v - k[3]) / k[1]
        for u in range(z.shape[1]):
            rx = (u - k[2]) / k[0]
            dx, dy = R[0, 0] * rx + R[0, 1] * ry + R[0, 2], R[1, 0] * rx + R[1, 1] * ry + R[1, 2]
            dz = R[2, 0] * rx + R[2, 1] * ry + R[2, 2]
            norm = math.sqrt(dx * dx + dy * dy + dz * dz)
            s = which[v, u]
            if s < 0:
                value = sky_radiance(dx / norm, dy / norm, dz / norm, sky, pixel, seed)
                if fog_per_m > 0.0:
                    value = fog
            else:
                depth = z[v, u]
                x, y, h = origin[0] + depth * dx, origin[1] + depth * dy, origin[2] + depth * dz
                _normal(kinds[s], rows[s], solids.halfspaces, x, y, h, n)
                _footprint(dx / norm, dy / norm, dz / norm, n, depth * pixel, footprint)
                flat = math.sqrt(n[0] * n[0] + n[1] * n[1])
                along, up = (n[0] * y - n[1] * x, -h) if flat > 0.3 else (x, y)
                if flat > 0.3:
                    along /= flat
                m = materials[material_of[s]]
                shift = 3.7 * s if kinds[s] == DISC else 0.0
                albedo = reflectance(x + shift, y, h, along, up, m, footprint, seed + 31 * material_of[s])
                lit = n[0] * sky[4] + n[1] * sky[5] + n[2] * sky[6]
                # a thin leaf is as bright from both sides
                lit = abs(lit) if kinds[s] == DISC else max(0.0, lit)
                if kinds[s] == PLANE:
                    lit = abs(sky[6])
                value = albedo * (sky[8] + (1.0 - sky[8]) * lit)
                if projector[3] > 0.0:
                    value += albedo * _dots(x, y, h, projector, footprint[2], light.dots)
                if fog_per_m > 0.0:
                    clear = math.exp(-fog_per_m * depth * norm)
                    value = clear * value + (1.0 - clear) * fog
            if light.glare:
                value += glare_radiance(dx / norm, dy / norm, dz / norm, sky)
            out[v, u] = value


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surfaces:
    """The solids of a scene with a material each."""

    scene: Scene
    material_of: NDArray[np.int32]  # (S,) int32 index into materials
    materials: tuple[Material, ...]

    def without(self, gone: NDArray[np.bool_]) -> Surfaces:
        """The same without some of the solids; gone: (S,)."""
        keep, s = ~gone, self.scene
        scene = Scene(
            name=s.name,
            kinds=s.kinds[keep],
            rows=s.rows[keep],
            corners=s.corners[keep],
            halfspaces=s.halfspaces,
            label=s.label[keep],
            names=s.names,
            ground=s.ground,
            openings=s.openings,
            structured=s.structured,
        )
        return Surfaces(scene=scene, material_of=self.material_of[keep], materials=self.materials)


def radiance(
    surfaces: Surfaces,
    intrinsics: Intrinsics,
    R_ned_optical: Floats,
    position_ned_m: Floats,
    light: Light,
    projector_ned_m: Floats | None = None,
    *,
    glare: bool = True,
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """(brightness (H, W) float32, index of the solid (H, W) int32 or -1) of the view of a camera.

    R_ned_optical may be a rotation with a reflection. projector_ned_m: (3,) where the light's projector is."""
    s, k = surfaces.scene, intrinsics
    R = np.ascontiguousarray(R_ned_optical, np.float64)
    origin = np.ascontiguousarray(position_ned_m, np.float64)
    z, which = cast_rays(s.kinds, s.rows, s.corners, s.halfspaces, k, R, origin)
    materials = np.array([m.row() for m in surfaces.materials]).reshape(-1, MATERIAL_ROW)
    projector = np.zeros(PROJECTOR_ROW)
    dots = Material(albedo=1.0, contrast=0.6, coarse_m=0.01, fine_m=0.01).row()
    if light.projector is not None and projector_ned_m is not None:
        projector[:3], projector[3] = projector_ned_m, light.projector.strength
        pitch = light.projector.pitch_rad
        dots = Material(albedo=1.0, contrast=0.6, coarse_m=pitch, fine_m=pitch).row()
    out = np.empty(z.shape, np.float32)
    rays = _Rays(z, which, np.array([k.fx, k.fy, k.cx, k.cy]), R, origin)
    material_of = np.ascontiguousarray(surfaces.material_of, np.int32)
    solids = _Solids(np.array(s.kinds), np.array(s.rows), np.array(s.halfspaces), material_of, materials)
    glare = glare and light.sky.glare > 0.0
    _shade(rays, solids, _Lighting(light.sky.row(), light.fog_per_m, light.seed, projector, dots, glare), out)
    return out, which
