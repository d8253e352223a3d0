"""Whether the space that a free-range profile claims is free of solids, over the volume of each claimed cell.

`free_truth` asks about visible true points only. Here horizontal rays run through each claimed cell (direction, layer), at
several azimuths and heights, against the solids of the scene, seen or not. A cell is wrong where a solid reaches farther
into it than max(0.3 m, 3 sigma) in range and than a pixel of the camera in width and height: what cuts off less is below its resolution.

What a profile does not claim is not judged: heights below the ground that the model found (less its tolerance), solids
lower than the least obstacle height above the true ground, and the true ground itself down to that much below its
surface. A flat roof that was taken for ground hides nothing this way: what stands above it is judged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from core.params import Params
from core.types import FrameModel, Ground
from drivers.simulation.ray_caster import CONVEX, CYLINDER, DISC, ELLIPSOID, PLANE
from drivers.simulation.scenes import Scene
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]
SLACK_M, SLACK_SIGMAS = 0.3, 3.0
"""Allowed overlap of a solid with a free cell: this distance, or this number of sigmas."""
_AZIMUTHS, _HEIGHTS = 5, 8
"""Rays through one cell: across its width, the outermost a pixel inside of its edges, and over its height."""
_FLAT = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class WrongCell:
    """A solid in claimed space. direction, layer: indices of the profile; azimuth_rad, z_m: of the ray in level_cam;
    range_m: horizontal range at which the solid begins; free_to_m: of the claim; deep_m: the difference; solid: index into scene.names, -1: the ground."""

    direction: int
    layer: int
    azimuth_rad: float
    z_m: float
    range_m: float
    free_to_m: float
    deep_m: float
    solid: int


@njit(cache=True, nogil=True)
def _clip_linear(a, b, lo, hi):
    """The part of lo..hi in which a + b r > 0."""
    if abs(b) < _FLAT:
        return (lo, hi) if a > 0.0 else (math.inf, -math.inf)
    if b > 0.0:
        return max(lo, -a / b), hi
    return lo, min(hi, -a / b)


@njit(cache=True, nogil=True)
def _clip_square(a, b, c, lo, hi):
    """The part of lo..hi in which a r^2 + 2 b r + c <= 0, a >= 0."""
    if a < _FLAT:
        return _clip_linear(-c, -2.0 * b, lo, hi)
    root = b * b - a * c
    if root < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root)
    return max(lo, (-b - root) / a), min(hi, (-b + root) / a)


@njit(cache=True, nogil=True)
def _inside(kind, q, halfspaces, o, d, lo, hi):
    """(enter, leave): the part of lo..hi in which o + r d lies inside a solid; enter > leave: none."""
    if kind == CONVEX:
        first, count = int(q[0]), int(q[1])
        for i in range(first, first + count):
            n = halfspaces[i]
            a = n[3] - (n[0] * o[0] + n[1] * o[1] + n[2] * o[2])
            lo, hi = _clip_linear(a, -(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]), lo, hi)
    elif kind == ELLIPSOID:
        a, b, c = 0.0, 0.0, -1.0
        for i in range(3):
            m = q[3 + 3 * i : 6 + 3 * i]
            along = m[0] * d[0] + m[1] * d[1] + m[2] * d[2]
            off = m[0] * (o[0] - q[0]) + m[1] * (o[1] - q[1]) + m[2] * (o[2] - q[2])
            a, b, c = a + along * along, b + along * off, c + off * off
        lo, hi = _clip_square(a, b, c, lo, hi)
    elif kind == CYLINDER:
        wx, wy, wz = q[3] - q[0], q[4] - q[1], q[5] - q[2]
        length = math.sqrt(wx * wx + wy * wy + wz * wz)
        wx, wy, wz = wx / length, wy / length, wz / length
        ox, oy, oz = o[0] - q[0], o[1] - q[1], o[2] - q[2]
        dw, ow = d[0] * wx + d[1] * wy + d[2] * wz, ox * wx + oy * wy + oz * wz
        px, py, pz = d[0] - dw * wx, d[1] - dw * wy, d[2] - dw * wz
        mx, my, mz = ox - ow * wx, oy - ow * wy, oz - ow * wz
        a, b = px * px + py * py + pz * pz, px * mx + py * my + pz * mz
        lo, hi = _clip_square(a, b, mx * mx + my * my + mz * mz - q[6] * q[6], lo, hi)
        lo, hi = _clip_linear(ow, dw, lo, hi)
        lo, hi = _clip_linear(length - ow, -dw, lo, hi)
    elif kind == DISC:
        along = q[3] * d[0] + q[4] * d[1] + q[5] * d[2]
        if abs(along) < _FLAT:
            return math.inf, -math.inf
        r = (q[3] * (q[0] - o[0]) + q[4] * (q[1] - o[1]) + q[5] * (q[2] - o[2])) / along
        x, y, z = o[0] + r * d[0] - q[0], o[1] + r * d[1] - q[1], o[2] + r * d[2] - q[2]
        if x * x + y * y + z * z > q[6] * q[6]:
            return math.inf, -math.inf
        lo, hi = max(lo, r), min(hi, r)
    else:  # a rectangle has no inside, and the ground is judged apart
        return math.inf, -math.inf
    return lo, hi


@njit(cache=True, nogil=True)
def _first_solids(kinds, rows, halfspaces, origins, directions, begins, ends, ground, least_m, range_m, which):
    """The first r of begins..ends of each ray that lies in a solid, and which one; inf and -2 where none does.

    ground: (4,) whether there is one, then z = g0 + gx x + gy y. Solids count where they stand higher than least_m above
    it, the ground itself (which: -1) where it is deeper than least_m below its surface."""
    for i in range(len(begins)):
        o, d = origins[i], directions[i]
        range_m[i], which[i] = math.inf, -2
        lo, hi = begins[i], ends[i]
        low, high = lo, hi
        if ground[0] > 0.0:
            above = ground[1] + ground[2] * o[0] + ground[3] * o[1] - o[2]
            slope = ground[2] * d[0] + ground[3] * d[1] - d[2]
            a, b = _clip_linear(-least_m - above, -slope, lo, hi)
            if a <= b:
                range_m[i], which[i] = a, -1
            low, high = _clip_linear(above - least_m, slope, lo, hi)
        if low > high:
            continue
        for s in range(len(kinds)):
            a, b = _inside(kinds[s], rows[s], halfspaces, o, d, low, high)
            if a <= b and a < range_m[i]:
                range_m[i], which[i] = a, s


def first_solids(
    scene: Scene, drawn_ground: bool, origins: Floats, directions: Floats, begins: Floats, ends: Floats, least_m: float
) -> tuple[Floats, NDArray[np.int64]]:
    """(range (N,), solid (N,)) where rays first lie in a solid between begins and ends; inf, -2: nowhere.

    origins, directions: (N, 3) in ned. least_m: obstacles lower than this above the ground do not count, see above."""
    g = scene.ground
    ground = np.array([float(drawn_ground), g.z_m, g.slope_x, g.slope_y])
    range_m, which = np.empty(len(begins)), np.empty(len(begins), np.int64)
    _first_solids(
        scene.kinds,
        scene.rows,
        scene.halfspaces,
        np.ascontiguousarray(origins),
        np.ascontiguousarray(directions),
        np.ascontiguousarray(begins),
        np.ascontiguousarray(ends),
        ground,
        least_m,
        range_m,
        which,
    )
    return range_m, which


def has_ground(scene: Scene) -> bool:
    """Whether the scene's ground is drawn, and so there at all."""
    return bool((scene.kinds == PLANE).any())


def above_ground(
    ground: Ground, azimuth_rad: Floats, z_m: Floats, begins: Floats, ends: Floats, ke_per_m: float, params: Params
) -> tuple[Floats, Floats]:
    """(begins, ends) of the part of each ray, of level_cam from the camera's axis, that lies above the model's ground and its
    tolerance; begin > end: none. By the same bound as core.stages.free_geometry.lowest_clear."""
    if not ground.seen:
        return begins, ends
    c = np.cos(azimuth_rad)
    slope = ground.slope_x * c + ground.slope_y * np.sin(azimuth_rad)
    spread = params.ground_sigmas * ke_per_m * ground.height_m
    lo, hi = begins.copy(), ends.copy()
    for offset, rise in (
        (ground.height_m - params.ground_tolerance_m - z_m, slope),
        (ground.height_m - z_m, slope - spread * c),
    ):
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -offset / rise
        lo = np.where(rise > _FLAT, np.fmax(lo, crossing), lo)
        hi = np.where(rise < -_FLAT, np.fmin(hi, crossing), hi)
        hi = np.where((np.abs(rise) <= _FLAT) & (offset <= 0.0), -np.inf, hi)
    return lo, hi


def heading_of(frame: Rendered) -> float:
    """Heading of level_cam in ned, rad."""
    R = frame.R_ned_optical @ frame.R_level_optical.T
    return math.atan2(float(R[1, 0]), float(R[0, 0]))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CellRays:
    """Horizontal rays through the claimed cells of a profile. cell: (N,) number of the cell of each ray, of `cells` in all;
    direction, layer: (N,) its indices in the profile; azimuth_rad, z_m: (N,) in level_cam; begins, ends: (N,) horizontal
    ranges of the claim; inside_to_m: (N,) up to where the ray is a pixel or more inside of its layer; origins, directions: (N, 3) in ned;
    axis: (3,) optical axis in level_cam."""

    cells: int
    cell: NDArray[np.int64]
    direction: NDArray[np.int64]
    layer: NDArray[np.int64]
    azimuth_rad: Floats
    z_m: Floats
    begins: Floats
    ends: Floats
    inside_to_m: Floats
    origins: Floats
    directions: Floats
    axis: Floats

    def optical_depth(self, rows: Any, range_m: Any) -> Any:
        """Optical depth of places at horizontal ranges along rays."""
        along = self.axis[0] * np.cos(self.azimuth_rad[rows]) + self.axis[1] * np.sin(self.azimuth_rad[rows])
        return along * range_m + self.axis[2] * self.z_m[rows]


def cell_rays(frame: Rendered, model: FrameModel) -> CellRays | None:
    """The rays through all that a model's profile claims; None: it claims nothing."""
    f = model.free
    cells = np.argwhere(f.free_to_m > f.free_from_m)
    if not model.valid or not len(cells):
        return None
    k = frame.info.intrinsics
    inner = np.linspace(0.0, 1.0, _AZIMUTHS)
    share = (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS
    each = _AZIMUTHS * _HEIGHTS
    d, layer = np.repeat(cells[:, 0], each), np.repeat(cells[:, 1], each)
    across = np.tile(np.repeat(inner, _HEIGHTS), len(cells))
    down = np.tile(share, len(cells) * _AZIMUTHS)
    edges, layers = f.azimuth_edges_rad.astype(np.float64), f.layer_edges_m.astype(np.float64)
    pixel = np.minimum(1.0 / min(k.fx, k.fy), 0.49 * (edges[d + 1] - edges[d]))
    azimuth = edges[d] + pixel + across * (edges[d + 1] - edges[d] - 2.0 * pixel)
    z = layers[layer] + down * (layers[layer + 1] - layers[layer])
    inside_to_m = np.minimum(z - layers[layer], layers[layer + 1] - z) * min(k.fx, k.fy)
    heading = heading_of(frame) + azimuth
    origins = np.tile(frame.position_ned_m, (len(z), 1))
    origins[:, 2] += z
    return CellRays(
        cells=len(cells),
        cell=np.repeat(np.arange(len(cells)), each),
        direction=d,
        layer=layer,
        azimuth_rad=azimuth,
        z_m=z,
        begins=f.free_from_m[d, layer].astype(np.float64),
        ends=f.free_to_m[d, layer].astype(np.float64),
        inside_to_m=inside_to_m,
        origins=origins,
        directions=np.stack([np.cos(heading), np.sin(heading), np.zeros(len(z))], axis=1),
        axis=frame.R_level_optical[:, 2],
    )


def wrong_cells(
    frame: Rendered, model: FrameModel, ke_per_m: float, params: Params, *, below_ground: bool = False
) -> tuple[list[WrongCell], int]:
    """(the worst ray of each wrong cell, how many cells are claimed). ke_per_m: the true noise of the frame.

    below_ground: cells are judged over their whole height, as a caller takes them who does not treat the model's ground as
    solid. The true ground itself does not count then."""
    rays = cell_rays(frame, model)
    if rays is None:
        return [], 0
    begins, ends, each = rays.begins, np.minimum(rays.ends, rays.inside_to_m), _AZIMUTHS * _HEIGHTS
    if not below_ground:
        begins, ends = above_ground(model.ground, rays.azimuth_rad, rays.z_m, begins, ends, model.ke_per_m, params)
    range_m, which = first_solids(
        frame.scene, has_ground(frame.scene), rays.origins, rays.directions, begins, ends, params.min_obstacle_height_m
    )
    with np.errstate(invalid="ignore"):
        depth = rays.optical_depth(slice(None), range_m)
        slack = np.fmax(SLACK_M, SLACK_SIGMAS * ke_per_m * np.maximum(depth, 0.0) * range_m)
        counts = np.isfinite(range_m) & ~(below_ground & (which == -1))
        deep = np.where(counts, rays.ends - slack - range_m, -np.inf).reshape(rays.cells, each)
    found = []
    for cell in np.flatnonzero(deep.max(axis=1) > 0.0):
        i = int(cell) * each + int(deep[cell].argmax())
        label = int(frame.scene.label[which[i]]) if which[i] >= 0 else -1
        found.append(
            WrongCell(
                direction=int(rays.direction[i]),
                layer=int(rays.layer[i]),
                azimuth_rad=float(rays.azimuth_rad[i]),
                z_m=float(rays.z_m[i]),
                range_m=float(range_m[i]),
                free_to_m=float(rays.ends[i]),
                deep_m=float(rays.ends[i] - range_m[i]),
                solid=label,
            )
        )
    return found, rays.cells
