"""Made-up flights past walls, for tests of the merged world: what a camera sees of upright rectangles, in ned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from core.params import Params
from core.stages.model import blind_model
from core.types import CameraInfo, FreeEnd, FreeProfile, Intrinsics, InvalidCause
from core.world.world import Observation

INFO = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5))
NS = 1_000_000_000
RANGE_M = 20.0
LAYERS = np.array([-3.0, -1.0, 1.0, 3.0], np.float32)
DIRECTIONS = 36


def seen(
    walls: np.ndarray, at: tuple[float, float], heading: float, t_ns: int, *, noise: np.random.Generator | None = None,
    sigma_m: float = 0.03, reset_counter: int = 0, z: float = 0.0, ke: float = 0.001, flags: int = 0, view_deg: float = 80.0,
) -> Observation:  # fmt: skip
    """What a camera at (x, y, z) sees of walls (N, 6): ax, ay, bx, by, top, bottom; free space on the right of a -> b.

    A profile of three layers of 2 m; walls taller than those block them. Each wall's visible part is one plane."""
    half = math.radians(view_deg / 2)
    edges = np.linspace(heading - half, heading + half, DIRECTIONS + 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    reach = np.full(DIRECTIONS, RANGE_M)
    planes = []
    hit = _rays(at, middle, walls)
    for k, wall in enumerate(walls):
        mine = np.isfinite(hit[:, k]) & (hit[:, k] < RANGE_M) & (hit[:, k] <= hit.min(axis=1) + 1e-9)
        for run in _runs(mine):
            ends = [_on(at, edges[run[0]], wall), _on(at, edges[run[-1] + 1], wall)]
            planes.append([*ends[0], *ends[1], wall[4], wall[5]])
    either_side = np.concatenate([walls, walls[:, [2, 3, 0, 1, 4, 5]]])
    within = np.linspace(edges[:-1], edges[1:], 9)  # nine rays in each direction
    nearest = _rays(at, within.ravel(), either_side).min(axis=1, initial=math.inf).reshape(within.shape)
    reach = np.minimum(reach, nearest.min(axis=0))
    if noise is not None and planes:
        shift = noise.normal(0.0, sigma_m, (len(planes), 2))
        planes = [
            [p[0] + s[0], p[1] + s[1], p[2] + s[0], p[3] + s[1], p[4], p[5]] for p, s in zip(planes, shift, strict=True)
        ]
    n = len(planes)
    end = np.where(reach < RANGE_M, int(FreeEnd.OBSTACLE), int(FreeEnd.MAX_RANGE)).astype(np.uint8)
    profile = FreeProfile(
        azimuth_edges_rad=edges.astype(np.float32),
        layer_edges_m=LAYERS + np.float32(z),
        free_from_m=np.full((DIRECTIONS, 3), 0.5, np.float32),
        free_to_m=np.repeat((reach - 0.05)[:, None], 3, axis=1).astype(np.float32),
        end=np.repeat(end[:, None], 3, axis=1),
    )
    model = replace(
        blind_model(INFO, InvalidCause.NONE, Params()),
        valid=True,
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.full(n, flags, np.uint8),
        cluster=np.zeros(n, np.int32),
        free=profile,
        ke_per_m=ke,
    )
    return Observation(model=model, place_m=(at[0], at[1], z), t_ns=t_ns, reset_counter=reset_counter)


def blind(t_ns: int) -> Observation:
    """An invalid frame."""
    return Observation(
        model=blind_model(INFO, InvalidCause.NO_MEASUREMENT, Params()), place_m=(0.0, 0.0, 0.0), t_ns=t_ns
    )


def wall(ax: float, ay: float, bx: float, by: float, top: float = -4.0, bottom: float = 4.0) -> list[float]:
    return [ax, ay, bx, by, top, bottom]


def house(x: float, y: float, side: float = 6.0) -> np.ndarray:
    """Four walls, free space outside."""
    h = side / 2
    corner = [(x - h, y - h), (x - h, y + h), (x + h, y + h), (x + h, y - h)]
    return np.array([wall(*corner[k], *corner[(k + 1) % 4]) for k in range(4)])


def _rays(at: tuple[float, float], azimuth: np.ndarray, walls: np.ndarray) -> np.ndarray:
    """Distances (rays, walls) along rays at which they meet the free side of walls (N, 6), inf: never."""
    dx, dy = np.cos(azimuth)[:, None], np.sin(azimuth)[:, None]
    ex, ey = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    fx, fy = walls[:, 0] - at[0], walls[:, 1] - at[1]
    cross = dx * ey - dy * ex
    meets = cross > 1e-12  # otherwise it comes from behind, or runs along
    divisor = np.where(meets, cross, 1.0)
    r, s = (fx * ey - fy * ex) / divisor, (fx * dy - fy * dx) / divisor
    return np.where(meets & (r > 0) & (s >= 0.0) & (s <= 1.0), r, math.inf)


def _on(at: tuple[float, float], azimuth: float, w: np.ndarray) -> tuple[float, float]:
    """Where a ray meets the line of a wall, kept between its ends."""
    dx, dy = math.cos(azimuth), math.sin(azimuth)
    ex, ey = w[2] - w[0], w[3] - w[1]
    cross = dx * ey - dy * ex
    s = ((w[0] - at[0]) * dy - (w[1] - at[1]) * dx) / cross if abs(cross) > 1e-9 else 0.0
    s = min(1.0, max(0.0, s))
    return w[0] + s * ex, w[1] + s * ey


def _runs(on: np.ndarray) -> list[np.ndarray]:
    k = np.flatnonzero(on)
    return [r for r in np.split(k, np.flatnonzero(np.diff(k) > 1) + 1) if len(r)]
