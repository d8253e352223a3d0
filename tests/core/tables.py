"""Tables of strips and planes made by hand, and the way from strips to planes without a picture."""

from __future__ import annotations

import numpy as np

from core.params import Params
from core.stages import clusters, support
from core.stages import planes as pl
from core.stages import segments as tracks
from core.stages import strips as s
from core.stages.openings import OpeningMasks
from core.stages.settings import view_settings
from core.types import Prism

from .columns import F, view

CLOSED = OpeningMasks(
    np.zeros((12, 40, 40), np.uint8), 0.5 * 1.42 ** (np.arange(1, 12) - 0.5), F / 4, F / 4, 20.0, 20.0
)
"""No opening anywhere, in cells of four columns and rows about the axis."""


class Strips:
    """A table of strips at forward distances, in a level view of `cols` columns and 100 rows (F = 100 px)."""

    def __init__(self, cols: int = 60, sigma_px: float = 0.02) -> None:
        self.view = view(cols=cols)
        self.cols, self.sigma_px = cols, sigma_px
        self.rows: list[tuple[float, ...]] = []

    def add(
        self,
        u: int,
        top: int,
        bottom: int,
        x_m: float,
        support_px: int = 20,
        near_m: float | None = None,
        kind: int = s.SMOOTH,
    ) -> None:
        """Strips must come in order of their columns."""
        d = F / x_m
        near = d if near_m is None else F / near_m
        row = (u, top, bottom, support_px * s.PX, kind, -1, -1, 0, 0, d, near, self.sigma_px, 0.0, 0.0, 0.0, 0.0)
        self.rows.append(row)

    def build(self) -> Strips:
        """Makes the arrays; rows in order of columns and from top to bottom."""
        n = self.n = len(self.rows)
        self.strips = np.array(self.rows, s.STRIP)
        self.columns = np.zeros(self.cols + 1, np.int32)
        support.index_columns(self.strips, n, self.cols, self.columns)
        support.sort_columns(self.strips, self.cols, self.columns)
        self.put()
        return self

    def put(self) -> None:
        """Places in metres."""
        clusters.place_strips(self.strips, self.n, self.view)

    @property
    def place(self) -> np.ndarray:
        """(N, 4) float32 x, y, top, bottom."""
        return np.stack([self.strips[name] for name in ("x_m", "y_m", "top_m", "bottom_m")], axis=1)

    @property
    def list(self) -> s.StripList:
        return s.StripList(self.strips, self.n, self.columns)

    def cluster(self, ws: float = 2.0, hs: float = 1.0) -> int:
        """join_near; returns the number of clusters."""
        return clusters.join_near(self.strips, self.n, ws, hs)

    def track(
        self,
        hs: float = 1.0,
        line_m: float = 0.12,
        link: int = 4,
        masks: OpeningMasks = CLOSED,
    ) -> int:
        """grow; returns the number of tracks, which are in `tracks`."""
        p = Params(height_step_m=hs, line_tolerance_m=line_m, link_gap_px=link)
        self.tracks = np.zeros(self.n + 1, tracks.TRACK)
        settings = view_settings(self.view, 0.001, p)[0]
        return tracks.grow(self.strips, self.view, self.columns, settings, masks, self.tracks)

    @property
    def cluster_of(self) -> np.ndarray:
        return self.strips["cluster"]

    @property
    def track_of(self) -> np.ndarray:
        return self.strips["track"]


def moments_of(record: np.ndarray) -> np.ndarray:
    """(6,) moments of a record: w, t, s, tt, ts, ss."""
    return np.array([float(record[f"sum_{name}"]) for name in ("w", "t", "s", "tt", "ts", "ss")])


def line_through(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """(A, B) with A x + B y = 1 through two points."""
    A, B = np.linalg.solve(np.array([a, b], float), [1.0, 1.0])
    return float(A), float(B)


def plane_table(*rows: tuple[float, ...], room: int = 8) -> np.ndarray:
    """(N + room,) PLANE of rectangles (a_x, a_y, b_x, b_y, top, bottom), all of cluster 0."""
    planes = np.zeros(len(rows) + room, pl.PLANE)
    for plane, (ax, ay, bx, by, top, bottom) in zip(planes, rows, strict=False):
        plane.a, plane.b = line_through((ax, ay), (bx, by))
        plane.t0, plane.t1 = ay / ax, by / bx
        plane.top_m, plane.bottom_m, plane.front_m = top, bottom, -0.28
        plane.support = 1000
        plane.sum_w, plane.sum_t, plane.sum_s = 1e6, 0.0, 1e6 / ax
        plane.sum_tt, plane.sum_ts, plane.sum_ss = 1.0, 0.0, 1e6
    return planes


def ends(plane: np.ndarray) -> tuple[float, float, float, float]:
    """(a_x, a_y, b_x, b_y) of a record of PLANE."""
    x0, x1 = (1.0 / (plane["a"] + plane["b"] * t) for t in (plane["t0"], plane["t1"]))
    return x0, x0 * plane["t0"], x1, x1 * plane["t1"]


def some_prisms(count: int) -> list[Prism]:
    """Prisms of one to six edges, open and closed, the same ones always."""
    rng = np.random.default_rng(count)
    made = []
    for _ in range(count):
        edges, closed = int(rng.integers(1, 7)), bool(rng.integers(0, 2))
        made.append(
            Prism(
                cluster=int(rng.integers(0, 300)),
                top_m=float(-rng.uniform(1.0, 9.0)),
                bottom_m=float(rng.uniform(-0.5, 2.0)),
                closed=closed,
                margin_m=float(rng.uniform(0.0, 0.5)),
                plane=rng.integers(0, 200, edges, np.int32),
                vertices_m=rng.uniform(-20.0, 20.0, (edges + (not closed), 2)).astype(np.float32),
            )
        )
    return made
