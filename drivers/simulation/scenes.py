"""Scenes of solids with known truth, in ned (x north, y east, z down, ground at z = 0), and the builder that
makes them.

The named scenes (drivers.simulation.scene_library) are meant to be looked at from near the origin, northwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from core.types import readonly

from .ray_caster import CONVEX, CYLINDER, DISC, ELLIPSOID, PLANE, ROW

Floats = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """The ground z = z_m + slope_x * x + slope_y * y (ned). Heights are taken above it even where it is not
    drawn."""

    z_m: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0


@dataclass(frozen=True, slots=True)
class Opening:
    """A rectangular hole in a wall: its lower corners a and b (ned x, y), top and bottom z, metres."""

    a_m: tuple[float, float]
    b_m: tuple[float, float]
    top_m: float
    bottom_m: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scene:
    """Solids for drivers.simulation.ray_caster with what they are called."""

    name: str
    kinds: NDArray[np.int32]  # (S,) int32
    rows: Floats  # (S, 12) float64
    corners: Floats  # (S, 8, 3) float64
    halfspaces: Floats  # (M, 4) float64
    label: NDArray[np.int32]  # (S,) int32 index into names, -1 for the ground
    names: tuple[str, ...]
    ground: GroundTruth
    openings: tuple[Opening, ...] = ()
    structured: bool = True  # its obstacles have planar faces
    # (S, 3) float64 of each solid in ned, or (0, 3): nothing moves; the other arrays are those at time 0, see
    # `movers.moved`
    velocity_m_s: Floats = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        put, count = object.__setattr__, len(self.kinds)
        put(self, "kinds", readonly(self.kinds, np.int32, (None,), "kinds"))
        put(self, "rows", readonly(self.rows, np.float64, (count, ROW), "rows"))
        put(self, "corners", readonly(self.corners, np.float64, (count, 8, 3), "corners"))
        put(self, "halfspaces", readonly(self.halfspaces, np.float64, (None, 4), "halfspaces"))
        put(self, "label", readonly(self.label, np.int32, (count,), "label"))
        moving = count if len(self.velocity_m_s) else 0
        put(self, "velocity_m_s", readonly(self.velocity_m_s, np.float64, (moving, 3), "velocity_m_s"))


def _corners(low: Floats, high: Floats, axes: Floats, origin: Floats) -> Floats:
    """(8, 3) corners of the box low..high along the rows of `axes` from `origin`; bit i of the index is axis
    i."""
    bits = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.asarray(origin + np.where(bits == 1, high, low) @ axes)


def _yaw_axes(yaw_rad: float) -> Floats:
    """Rows: forward, right, down of something with this heading."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(slots=True)
class SceneBuilder:
    """Collects solids; each call adds one named thing, with the velocity that `velocity_m_s` (ned) has then. Angles are headings in rad (clockwise from north, seen
    from above), sizes are full lengths in metres, heights are above z = 0 and positive."""

    name: str
    structured: bool = True
    ground_truth: GroundTruth = GroundTruth()
    openings: list[Opening] = field(default_factory=list)
    velocity_m_s: Point = (0.0, 0.0, 0.0)
    _velocities: list[Point] = field(default_factory=list)
    _kinds: list[int] = field(default_factory=list)
    _rows: list[Floats] = field(default_factory=list)
    _corners: list[Floats] = field(default_factory=list)
    _halfspaces: list[Floats] = field(default_factory=list)
    _labels: list[int] = field(default_factory=list)
    _names: list[str] = field(default_factory=list)

    def build(self) -> Scene:
        """The scene so far."""
        return Scene(
            name=self.name,
            kinds=np.array(self._kinds, np.int32),
            rows=np.array(self._rows, np.float64).reshape(-1, ROW),
            corners=np.array(self._corners, np.float64).reshape(-1, 8, 3),
            halfspaces=np.array(self._halfspaces, np.float64).reshape(-1, 4),
            label=np.array(self._labels, np.int32),
            names=tuple(self._names),
            ground=self.ground_truth,
            openings=tuple(self.openings),
            structured=self.structured,
            velocity_m_s=np.array(self._velocities if any(map(any, self._velocities)) else []).reshape(-1, 3),
        )

    def _add(self, kind: int, row: list[float], corners: Floats, label: int) -> None:
        self._kinds.append(kind)
        self._rows.append(np.array(row + [0.0] * (ROW - len(row))))
        self._corners.append(corners)
        self._labels.append(label)
        self._velocities.append(self.velocity_m_s)

    def label(self, name: str) -> int:
        """The number of a name, new or known."""
        if name not in self._names:
            self._names.append(name)
        return self._names.index(name)

    def ground(self, slope_x: float = 0.0, slope_y: float = 0.0) -> None:
        """Draws the ground plane z = slope_x x + slope_y y."""
        self.ground_truth = GroundTruth(0.0, slope_x, slope_y)
        self._add(PLANE, [-slope_x, -slope_y, 1.0, 0.0], np.zeros((8, 3)), -1)

    def convex(self, name: str, points: Floats, yaw_rad: float = 0.0) -> None:
        """The convex hull of points (P, 3) in ned; yaw_rad: a direction in which its bounding box is
        tight."""
        equations = ConvexHull(points).equations  # n.p + offset <= 0, one row a triangle
        faces = np.unique(np.round(equations, 9), axis=0)
        axes = _yaw_axes(yaw_rad)
        local = points @ axes.T
        corners = _corners(local.min(axis=0), local.max(axis=0), axes, np.zeros(3))
        row = [float(len(self._halfspaces)), float(len(faces))]
        self._halfspaces.extend(np.concatenate([face[:3], [-face[3]]]) for face in faces)
        self._add(CONVEX, row, corners, self.label(name))

    def box(
        self,
        name: str,
        x: float,
        y: float,
        length: float,
        width: float,
        height: float,
        yaw: float = 0.0,
        base: float = 0.0,
    ) -> None:
        """A box centred over (x, y): `length` along its heading, `width` across, from `base` to base +
        height."""
        axes = _yaw_axes(yaw)
        half = np.array([length / 2, width / 2, height / 2])
        self.convex(name, _corners(-half, half, axes, np.array([x, y, -base - height / 2])), yaw)

    def wall(
        self,
        name: str,
        a: tuple[float, float],
        b: tuple[float, float],
        height: float,
        holes: tuple[tuple[float, float, float, float], ...] = (),
        thickness: float = 0.25,
        base: float = 0.0,
    ) -> None:
        """A wall with its face on the line a -> b and its body to the left of it (free space on the right,
        seen from above). holes: (start along the wall, sill height, width, height) of each rectangular
        opening, not overlapping along the wall."""
        (ax, ay), (bx, by) = a, b
        yaw, length = math.atan2(by - ay, bx - ax), math.hypot(bx - ax, by - ay)
        c, s = math.cos(yaw), math.sin(yaw)

        def piece(start: float, end: float, low: float, high: float) -> None:
            if end - start > 1e-9 and high - low > 1e-9:
                along, across = (start + end) / 2, thickness / 2
                x, y = ax + along * c + across * s, ay + along * s - across * c
                self.box(name, x, y, end - start, thickness, high - low, yaw, low)

        done = 0.0
        for start, sill, width, tall in sorted(holes):
            piece(done, start, base, base + height)
            piece(start, start + width, base, sill)
            piece(start, start + width, sill + tall, base + height)
            done = start + width
            ends = [(ax + along * c, ay + along * s) for along in (start, done)]
            self.openings.append(Opening(ends[0], ends[1], -sill - tall, -sill))
        piece(done, length, base, base + height)

    def gable(
        self,
        name: str,
        x: float,
        y: float,
        length: float,
        width: float,
        eaves: float,
        ridge: float,
        yaw: float = 0.0,
    ) -> None:
        """A house with a saddle roof: the ridge runs along its heading at height `ridge`."""
        low, high = np.array([-length / 2, -width / 2, -eaves]), np.array([length / 2, width / 2, 0.0])
        body = _corners(low, high, np.eye(3), np.zeros(3))
        top = np.array([[-length / 2, 0.0, -ridge], [length / 2, 0.0, -ridge]])
        self.convex(name, np.vstack([body, top]) @ _yaw_axes(yaw) + [x, y, 0.0], yaw)

    def ramp(self, name: str, x: float, y: float, length: float, width: float, height: float) -> None:
        """A wedge that rises from 0 to `height` northwards."""
        low, high = np.array([-length / 2, -width / 2, -height]), np.array([length / 2, width / 2, 0.0])
        points = _corners(low, high, np.eye(3), np.zeros(3))
        points = points[~((points[:, 0] < 0) & (points[:, 2] < 0))]
        self.convex(name, points + np.array([x, y, 0.0]))

    def trapezoid(
        self, name: str, x: float, y: float, bottom: float, top: float, height: float, yaw: float = 0.0
    ) -> None:
        """A square frustum with the side lengths `bottom` and `top`."""
        square = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
        low, high = (
            np.column_stack([bottom * square, np.zeros(4)]),
            np.column_stack([top * square, np.full(4, -height)]),
        )
        self.convex(name, np.vstack([low, high]) @ _yaw_axes(yaw) + [x, y, 0.0], yaw)

    def cylinder(self, name: str, a: Point, b: Point, radius: float) -> None:
        """A capped cylinder about the axis a -> b (ned): poles, trunks, wires."""
        start, end = np.array(a), np.array(b)
        along = end - start
        side = np.cross(along, [1.0, 0.0, 0.0] if abs(along[0]) < abs(along[1]) else [0.0, 1.0, 0.0])
        side /= np.linalg.norm(side)
        third = np.cross(along, side) / np.linalg.norm(along)
        low, high = np.array([0.0, -radius, -radius]), np.array([1.0, radius, radius])
        corners = _corners(low, high, np.array([along, side, third]), start)
        self._add(CYLINDER, [*a, *b, radius], corners, self.label(name))

    def pole(self, name: str, x: float, y: float, diameter: float, height: float) -> None:
        """A vertical cylinder that stands on z = 0."""
        self.cylinder(name, (x, y, 0.0), (x, y, -height), diameter / 2)

    def person(self, name: str, x: float, y: float) -> None:
        """A standing person of 1.75 m: a trunk of 0.5 x 0.3 m and a head."""
        height = 1.75
        self.ellipsoid(name, (x, y, -0.43 * height), (0.16, 0.25, 0.43 * height))
        self.sphere(name, x, y, 0.92 * height, 0.08 * height)

    def sphere(self, name: str, x: float, y: float, height: float, radius: float) -> None:
        """A sphere with its centre at `height`."""
        self.ellipsoid(name, (x, y, -height), (radius, radius, radius))

    def ellipsoid(self, name: str, centre: Point, radii: Point, yaw: float = 0.0) -> None:
        """An ellipsoid with half-axes `radii` along its heading, across it and down."""
        axes, r = _yaw_axes(yaw), np.array(radii)
        matrix = axes / r[:, None]
        self._add(ELLIPSOID, [*centre, *matrix.ravel()], _corners(-r, r, axes, np.array(centre)), self.label(name))

    def disc(self, name: str, centre: Point, normal: Point, radius: float) -> None:
        """A round flat leaf, seen from both sides."""
        n = np.array(normal) / math.sqrt(sum(c * c for c in normal))
        side = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        side /= np.linalg.norm(side)
        axes = np.array([side, np.cross(n, side), n])
        r = np.array([radius, radius, 1e-6])
        self._add(DISC, [*centre, *n, radius], _corners(-r, r, axes, np.array(centre)), self.label(name))

    def tree(
        self,
        name: str,
        x: float,
        y: float,
        height: float,
        crown: float,
        leaves: int,
        rng: np.random.Generator,
    ) -> None:
        """A trunk and a crown of round leaves in an ellipsoid, between which rays pass.

        crown: its horizontal radius; the crown takes the upper 60 % of the height. Leaves of 7-16 cm
        radius."""
        self.cylinder(name, (x, y, 0.0), (x, y, -0.75 * height), 0.035 * height)
        centre, radii = np.array([x, y, -0.68 * height]), np.array([crown, crown, 0.32 * height])
        direction = rng.standard_normal((leaves, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        at = centre + radii * direction * np.cbrt(rng.uniform(0.2, 1.0, (leaves, 1)))
        normals, sizes = rng.standard_normal((leaves, 3)), rng.uniform(0.07, 0.16, leaves)
        for p, n, r in zip(at, normals, sizes, strict=True):
            self.disc(name, (p[0], p[1], p[2]), (n[0], n[1], n[2]), float(r))

    def stone(self, name: str, x: float, y: float, size: float, rng: np.random.Generator) -> None:
        """An irregular convex clump about `size` wide, half sunk into the ground."""
        direction = rng.standard_normal((24, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        radii = size / 2 * rng.uniform(0.8, 1.2, 3) * [1.0, 1.0, 1.3]
        points = direction * radii * rng.uniform(0.75, 1.1, (24, 1)) + [x, y, -0.25 * size]
        self.convex(name, points)
