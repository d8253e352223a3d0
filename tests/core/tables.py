"""Tables of strips and planes made by hand, and the way from strips to planes without a picture."""

from __future__ import annotations

import numpy as np

from core.params import Params
from core.stages import clusters, support
from core.stages import planes as pl
from core.stages import segments as tracks
from core.stages import strips as s
from core.stages.plane_stages import plane_tables
from core.stages.strip_stages import strip_tables
from core.types import Prism

from .columns import F, view

SCRATCH = strip_tables(100, 100)
"""Kept from table to table, as from frame to frame: what one leaves in it must not matter to the next."""

CLOSED = (
    np.zeros((12, 40, 40), np.uint8),
    np.array([F / 4, F / 4, 20.0, 20.0, *(0.5 * 1.42 ** (np.arange(1, 12) - 0.5))]),
)
"""Masks and frame of openings.py: no opening anywhere, in cells of four columns and rows about the axis."""


class Strips:
    """A table of strips at forward distances, in a level view of `cols` columns and 100 rows (F = 100 px)."""

    def __init__(self, cols: int = 60, sigma_px: float = 0.02) -> None:
        self.view = view(cols=cols)
        self.cols, self.sigma_px = cols, sigma_px
        self.rows: list[tuple[list[int], list[float]]] = []

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
        self.rows.append(([u, top, bottom, support_px * s.PX, kind, -1, -1, 0, 0], [d, near, self.sigma_px]))

    def build(self) -> Strips:
        """Makes the arrays; rows in order of columns and from top to bottom."""
        n = self.n = len(self.rows)
        self.ints = np.array([r[0] for r in self.rows], np.int32).reshape(n, 9)
        self.floats = np.array([r[1] for r in self.rows], np.float32).reshape(n, 3)
        self.columns = np.zeros(self.cols + 1, np.int32)
        support.index_columns(self.ints, n, self.cols, self.columns)
        support.sort_columns(self.ints, self.floats, self.cols, self.columns)
        self.place = np.zeros((n, 4), np.float32)
        self.put()
        return self

    def put(self) -> None:
        """Places in metres."""
        g = self.view
        clusters.place_strips(self.ints, self.floats, self.n, g.f_px, g.cu, g.lateral, g.tan_edge, self.place)

    def cluster(self, ws: float = 2.0, hs: float = 1.0) -> int:
        """join_near; returns the number of clusters."""
        return clusters.join_near(self.ints, self.place, self.n, ws, hs, *SCRATCH[6:12])

    def track(
        self,
        hs: float = 1.0,
        line_m: float = 0.12,
        link: int = 4,
        rough_px: float = 1.2,
        masks: tuple[np.ndarray, np.ndarray] = CLOSED,
    ) -> int:
        """grow; returns the number of tracks, tables in `moments` and `tracks`."""
        p, g = Params(), self.view
        _, _, self.moments, _, _, self.tracks, *scratch = plane_tables(self.n, 1)[:9]
        return tracks.grow(
            self.ints, self.floats, self.place, g.cols, self.columns, g.f_px, g.cu, g.lateral, hs, line_m, p.line_sigmas,
            p.link_slope_px, rough_px, link, p.roughness_m, p.track_jump, p.track_jump_sigmas, p.opening_edge_px, *masks,
            self.moments, self.tracks, *scratch,
        )  # fmt: skip

    @property
    def cluster_of(self) -> np.ndarray:
        return self.ints[:, s.CLUSTER]

    @property
    def track_of(self) -> np.ndarray:
        return self.ints[:, s.TRACK]


def line_through(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """(A, B) with A x + B y = 1 through two points."""
    A, B = np.linalg.solve(np.array([a, b], float), [1.0, 1.0])
    return float(A), float(B)


def plane_table(*rows: tuple[float, ...], room: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(planes, ints, moments) of rectangles (a_x, a_y, b_x, b_y, top, bottom), all of cluster 0."""
    n = len(rows)
    width = 1 + max(v for k, v in vars(pl).items() if k in ("FRONT", "MIDDLE"))
    planes, ints, moments = np.zeros((n + room, width)), np.zeros((n + room, 9), np.int32), np.zeros((n + room, 6))
    for k, (ax, ay, bx, by, top, bottom) in enumerate(rows):
        planes[k, pl.A], planes[k, pl.B] = line_through((ax, ay), (bx, by))
        planes[k, pl.T0], planes[k, pl.T1] = ay / ax, by / bx
        planes[k, pl.Z0], planes[k, pl.Z1], planes[k, pl.FRONT] = top, bottom, -0.28
        ints[k, pl.P_SUPPORT] = 1000
        moments[k] = (1e6, 0.0, 1e6 / ax, 1.0, 0.0, 1e6)
    return planes, ints, moments


def ends(plane: np.ndarray) -> tuple[float, float, float, float]:
    """(a_x, a_y, b_x, b_y) of one row of a table of planes."""
    x0, x1 = (1.0 / (plane[pl.A] + plane[pl.B] * t) for t in (plane[pl.T0], plane[pl.T1]))
    return x0, x0 * plane[pl.T0], x1, x1 * plane[pl.T1]


def some_prisms(count: int) -> list[Prism]:
    """Prisms of one to six edges, open and closed, the same ones always."""
    rng = np.random.default_rng(count)
    made = []
    for _ in range(count):
        edges, closed = int(rng.integers(1, 7)), bool(rng.integers(0, 2))
        made.append(
            Prism(
                cluster=int(rng.integers(0, 300)), top_m=float(-rng.uniform(1.0, 9.0)), bottom_m=float(rng.uniform(-0.5, 2.0)),
                closed=closed, margin_m=float(rng.uniform(0.0, 0.5)), plane=rng.integers(0, 200, edges, np.int32),
                vertices_m=rng.uniform(-20.0, 20.0, (edges + (not closed), 2)).astype(np.float32),
            )
        )  # fmt: skip
    return made
