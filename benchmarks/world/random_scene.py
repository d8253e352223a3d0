"""Random scenes of boxes seen from above for `random_flights`, and what a camera observes of them.

All solids stand in three layers of 2 m. The camera looks horizontally; its model has exact free ranges and planes, less
noise, a bias of the depth, and what it does not measure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core.params import Params
from core.stages.model import blind_model
from core.types import CameraInfo, FrameModel, FreeEnd, FreeProfile, Intrinsics, InvalidCause

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
RANGE_M, NEAR_M, KE_PER_M = 12.0, 0.5, 0.0015
LAYERS_M = np.array([-3.0, -1.0, 1.0, 3.0])
DIRECTIONS, RAYS = 32, 10
"""Directions of the free profile, and rays through each."""
VIEW_RAD = math.radians(80.0)
_LEAST_M = 0.02
_VEHICLES = 14
_INFO = CameraInfo("front", Intrinsics(64, 48, 45.0, 45.0, 31.5, 23.5))


def turn(angle_rad: float) -> Floats:
    """Returns R (2, 2), rotation about the vertical."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """A solid. place_m: its middle at t = 0, seen from above; half_m: half of its length and width; speed_m_s: (2,); from_s,
    to_s: when it is there; moves_s: when it moves."""

    place_m: Floats
    half_m: Floats
    yaw_rad: float
    top_m: float
    bottom_m: float
    speed_m_s: Floats
    from_s: float = -math.inf
    to_s: float = math.inf
    moves_s: tuple[float, float] = (0.0, 0.0)

    def middle(self, t_s: float) -> Floats:
        """Returns its middle (2,)."""
        moved_s = min(max(t_s, self.moves_s[0]), self.moves_s[1]) - self.moves_s[0]
        return np.asarray(self.place_m + self.speed_m_s * moved_s)

    def depth(self, points: Floats, t_s: float) -> Floats:
        """Returns (P,) how deep points (P, 2) lie inside of it, seen from above; negative: outside."""
        if not self.from_s <= t_s < self.to_s:
            return np.full(len(points), -np.inf)
        off = np.abs((points - self.middle(t_s)) @ turn(self.yaw_rad))
        return np.asarray((self.half_m - off).min(axis=1))

    def corners(self, t_s: float) -> Floats:
        """Returns (4, 2): from each corner to the next one free space is on the right."""
        unit = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
        return np.asarray((unit * self.half_m) @ turn(self.yaw_rad).T + self.middle(t_s))


def random_boxes(rng: np.random.Generator, duration_s: float) -> list[Box]:
    """Buildings, walls, posts and vehicles: some appear, disappear or move and stop."""
    boxes = []
    kinds = {"building": (1.5, 5.0), "vehicle": (1.2, 3.5), "wall": (0.15, 6.0), "post": (0.25, 0.4)}
    for _ in range(int(rng.integers(6, 14))):
        kind = str(rng.choice(list(kinds)))
        half = rng.uniform(*kinds[kind], 2) if kind != "wall" else np.array([rng.uniform(1.0, 6.0), 0.15])
        low = rng.random() < 0.3
        speed, moves, times = np.zeros(2), (0.0, 0.0), (-math.inf, math.inf)
        changes = rng.random()
        if kind in ("vehicle", "post") and changes < 0.6:
            speed = turn(rng.uniform(0.0, math.tau)) @ [rng.uniform(0.5, 8.0), 0.0]
            begin = rng.uniform(0.0, duration_s)
            moves = (begin, begin + rng.uniform(1.0, 4.0))
        elif changes < 0.8:
            begin = rng.uniform(0.0, duration_s)
            times = (begin, begin + rng.uniform(2.0, duration_s)) if rng.random() < 0.7 else (-math.inf, begin)
        boxes.append(
            Box(
                place_m=rng.uniform(-16.0, 16.0, 2),
                half_m=half,
                yaw_rad=rng.uniform(0.0, math.pi),
                top_m=-0.9 if low else -4.0,
                bottom_m=4.0,
                speed_m_s=speed,
                from_s=times[0],
                to_s=times[1],
                moves_s=moves,
            )
        )
    return boxes


def vehicles(rng: np.random.Generator, duration_s: float) -> list[Box]:
    """Vehicles that move and stop near the origin, half of which appear."""
    boxes: list[Box] = []
    while len(boxes) < _VEHICLES:
        for b in random_boxes(rng, duration_s):
            if b.half_m.min() > 1.0 and b.speed_m_s.any():
                begin = rng.uniform(0.0, 0.8 * duration_s)
                moves = (begin, begin + rng.uniform(0.3, 2.0))
                there = -math.inf if rng.random() < 0.5 else begin
                boxes.append(replace(b, place_m=0.6 * b.place_m, moves_s=moves, from_s=there))
    return boxes[:_VEHICLES]


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What one camera has before it. depth_m: (3, N) true distance along each ray and layer, inf: nothing; box, side: (3, N)
    what is there, -1: nothing; measured: (N,) rays that are not masked."""

    at_m: Floats
    heading_rad: float
    t_s: float
    depth_m: Floats
    box: NDArray[np.int64]
    side: NDArray[np.int64]
    measured: Mask

    def index(self, points: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Returns the ray to each of the points (P, 2), -1: outside of the view, and the range (P,)."""
        to = (points - self.at_m) @ turn(self.heading_rad)
        azimuth, count = np.arctan2(to[:, 1], to[:, 0]), len(self.measured) - 1
        k = np.rint((azimuth / VIEW_RAD + 0.5) * count).astype(np.int64)
        return np.where((k >= 0) & (k <= count), k, -1), np.hypot(to[:, 0], to[:, 1])


def look_at(boxes: list[Box], at_m: Floats, heading_rad: float, t_s: float, masked: tuple[float, float]) -> Look:
    """Returns the view of a camera. masked: azimuths in the view that are not measured."""
    azimuth = np.linspace(-0.5 * VIEW_RAD, 0.5 * VIEW_RAD, DIRECTIONS * RAYS + 1)
    rays = np.stack([np.cos(heading_rad + azimuth), np.sin(heading_rad + azimuth)], axis=1)
    there = [(i, b) for i, b in enumerate(boxes) if b.from_s <= t_s < b.to_s]
    depth = np.full((3, len(rays)), np.inf)
    box, side = np.full(depth.shape, -1), np.full(depth.shape, -1)
    for i, b in there:
        corners = b.corners(t_s)
        layers = np.flatnonzero((LAYERS_M[1:] > b.top_m) & (LAYERS_M[:-1] < b.bottom_m))
        for k in range(4):
            begin, along = corners[k] - at_m, corners[(k + 1) % 4] - corners[k]
            cross = rays[:, 0] * along[1] - rays[:, 1] * along[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                r = (begin[0] * along[1] - begin[1] * along[0]) / cross
                s = (begin[0] * rays[:, 1] - begin[1] * rays[:, 0]) / cross
            met = (cross > 1e-9) & (r > 0.0) & (s >= 0.0) & (s <= 1.0)
            for layer in layers:
                nearer = met & (r < depth[layer])
                depth[layer, nearer], box[layer, nearer], side[layer, nearer] = r[nearer], i, k
    measured = (azimuth < masked[0]) | (azimuth > masked[1])
    return Look(at_m, heading_rad, t_s, depth, box, side, measured)


def planes_of(look: Look, boxes: list[Box]) -> Floats:
    """Returns (N, 6): the parts of sides in view that are measured."""
    rows = []
    seen = (look.depth_m < RANGE_M) & look.measured
    for i in np.unique(look.box[seen]):
        corners = boxes[i].corners(look.t_s)
        for k in range(4):
            mine = seen & (look.box == i) & (look.side == k)
            on = np.flatnonzero(mine.any(axis=0))
            layers = np.flatnonzero(mine.any(axis=1))
            for run in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1):
                if not len(run):
                    continue
                azimuth = look.heading_rad + (run[[0, -1]] / (len(look.measured) - 1) - 0.5) * VIEW_RAD
                r = np.where(mine[:, run[[0, -1]]], look.depth_m[:, run[[0, -1]]], np.inf).min(axis=0)
                ends = look.at_m + r[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
                along = corners[(k + 1) % 4] - corners[k]
                order = np.argsort((ends - corners[k]) @ along)
                top = max(boxes[i].top_m, LAYERS_M[layers[0]])
                bottom = min(boxes[i].bottom_m, LAYERS_M[layers[-1] + 1])
                if np.hypot(*(ends[1] - ends[0])) >= _LEAST_M:
                    rows.append([*ends[order[0]], *ends[order[1]], top, bottom])
    return np.array(rows).reshape(-1, 6)


def model_of(look: Look, boxes: list[Box], rng: np.random.Generator, bias: float) -> FrameModel:
    """Returns the model in true north-aligned axes. bias: relative error of the depth."""
    planes = planes_of(look, boxes)
    for row in planes:
        to = 0.5 * (row[0:2] + row[2:4]) - look.at_m
        range_m = np.hypot(*to)
        shift = to / range_m * (bias * range_m + rng.normal(0.0, KE_PER_M * range_m**2))
        row[0:4] += np.tile(shift, 2)
    by_direction = np.stack([look.depth_m[:, d * RAYS : (d + 1) * RAYS + 1].min(axis=1) for d in range(DIRECTIONS)])
    reach = np.minimum(by_direction, RANGE_M)
    far = np.maximum(NEAR_M, reach * (1.0 + bias) + rng.normal(0.0, KE_PER_M * reach**2) - 0.05)
    end = np.where(by_direction < RANGE_M, int(FreeEnd.OBSTACLE), int(FreeEnd.MAX_RANGE))
    unmeasured = [not look.measured[d * RAYS : (d + 1) * RAYS + 1].all() for d in range(DIRECTIONS)]
    far[unmeasured], end[unmeasured] = NEAR_M, int(FreeEnd.UNKNOWN)
    edges = look.heading_rad + np.linspace(-0.5 * VIEW_RAD, 0.5 * VIEW_RAD, DIRECTIONS + 1)
    profile = FreeProfile(
        azimuth_edges_rad=edges.astype(np.float32),
        layer_edges_m=LAYERS_M.astype(np.float32),
        free_from_m=np.full(far.shape, NEAR_M, np.float32),
        free_to_m=far.astype(np.float32),
        end=end.astype(np.uint8),
    )
    n = len(planes)
    return replace(
        blind_model(_INFO, InvalidCause.NONE, Params()),
        valid=True,
        planes=planes.astype(np.float32),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.05, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
        free=profile,
        ke_per_m=KE_PER_M,
    )
