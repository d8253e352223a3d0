"""Figures of one view and of many, of either source of depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks import markdown
from benchmarks.fidelity.metrics import distances, judge, rays_of
from benchmarks.open_air.directions import judge_directions
from benchmarks.open_air.open_claims import claims_of
from benchmarks.open_air.outlines import OutlineCounts, outline_counts
from benchmarks.open_air.views import Seen
from core.params import Params

POINTS = 20_000
"""Of the measured obstacle points of a view at most so many are compared with the model."""
STEP_M, STEP_PX = 0.5, 5
NEAR_SKY_MM = 10_000
OUTLINE_RANGES_M = ((2.0, 6.0), (6.0, 8.0), (8.0, 10.0), (10.0, 20.0))


@dataclass(slots=True)
class JointFigures:
    """Sums over views. A model that is not valid says nothing: only its view, its directions and its obstacle rays count.

    directions: truly free ones; opened: called free or open; closed: by any plane within 10 m; false_stops: by one that is not
    there. obstacle: obstacle rays; measured: those with a depth at their pixel; missed, phantom: of the measured and of all, as
    in benchmarks/fidelity/metrics.py; inside: measured ones away from depth steps. open_rays: those that end in the ground or the
    sky; open_phantom: of them stopped where nothing is; open_early: stopped more than max(0.5 m, 2 sigma) before the ground, or at
    all before the sky. pixels, sky: all, and those of the sky; measured_px, sky_near: of them with a depth, and with one below 10 m.
    errors_m: distances of measured obstacle points from the model."""

    views: int = 0
    invalid: int = 0
    directions: int = 0
    opened: int = 0
    closed: int = 0
    false_stops: int = 0
    obstacle: int = 0
    measured: int = 0
    missed: int = 0
    inside: int = 0
    missed_inside: int = 0
    judged: int = 0
    phantom: int = 0
    open_rays: int = 0
    open_phantom: int = 0
    open_early: int = 0
    wrong_free: int = 0
    wrong_open: int = 0
    planes: int = 0
    pixels: int = 0
    measured_px: int = 0
    sky: int = 0
    sky_near: int = 0
    errors_m: list[NDArray[np.float64]] = field(default_factory=list)
    outlines: list[OutlineCounts] = field(default_factory=list)

    def add(self, other: JointFigures) -> None:
        """The sums of other views."""
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(other, f.name))

    def sums(self) -> dict[str, int]:
        """All counts by name."""
        return {f.name: value for f in fields(self) if isinstance(value := getattr(self, f.name), int)}

    def row(self) -> dict[str, float]:
        """Shares in percent, metres, counts; nan: nothing of the kind."""

        def percent(part: int, whole: int) -> float:
            return 100.0 * part / whole if whole else math.nan

        outline = sum(o.pixels for o in self.outlines)
        errors = np.concatenate(self.errors_m) if self.errors_m else np.zeros(0)
        return {
            "views": self.views,
            "invalid": self.invalid,
            "false_stops": percent(self.false_stops, self.directions),
            "closed": percent(self.closed, self.directions),
            "opened": percent(self.opened, self.directions),
            "unmeasured": percent(self.obstacle - self.measured, self.obstacle),
            "missed": percent(self.missed, self.judged),
            "missed_inside": percent(self.missed_inside, self.inside),
            "phantom": percent(self.phantom, self.judged),
            "open_phantom": percent(self.open_phantom, self.open_rays),
            "open_early": percent(self.open_early, self.open_rays),
            "mean_m": float(errors.mean()) if len(errors) else math.nan,
            "p95_m": float(np.percentile(errors, 95)) if len(errors) else math.nan,
            "wrong_free": self.wrong_free,
            "wrong_open": self.wrong_open,
            "planes": self.planes / max(1, self.views),
            "measured": percent(self.measured_px, self.pixels),
            "sky_near": percent(self.sky_near, self.sky),
            "outline_px": percent(sum(o.measured for o in self.outlines), outline),
            "outline": percent(sum(o.kept for o in self.outlines), outline),
        }


def beside_steps(range_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(H, W) within STEP_PX of a step of the true range of more than STEP_M, or of the sky: where a window of the matcher lies on
    two things. range_m: inf for the sky."""
    r = np.where(np.isfinite(range_m), range_m, 1e6)
    step = np.zeros(r.shape, np.uint8)
    step[:, 1:] |= np.abs(np.diff(r, axis=1)) > STEP_M
    step[1:] |= np.abs(np.diff(r, axis=0)) > STEP_M
    return np.asarray(cv2.dilate(step, np.ones((2 * STEP_PX + 1, 2 * STEP_PX + 1), np.uint8)) > 0)


def figures_of(seen: Seen) -> JointFigures:
    """The figures of one view."""
    frame, model, left, right = seen.frame, seen.model, seen.unmatched_left_px, seen.unmatched_right_px
    directions = judge_directions(frame, model, left)
    claims = claims_of(frame, model, left, Params(), right)
    rays = rays_of(frame, frame.info.ke_per_m, blind_left_px=left)
    sky = ~np.isfinite(frame.truth.depth_m)
    sky[:, :left] = False
    found = JointFigures(
        views=1,
        invalid=int(not model.valid),
        directions=int(directions.truly_free.sum()),
        opened=claims.opened,
        closed=int((directions.truly_free & directions.closed).sum()),
        false_stops=directions.false_stops,
        obstacle=int(rays.obstacle.sum()),
        measured=int((rays.obstacle & rays.measured).sum()),
        wrong_free=claims.wrong_free,
        wrong_open=len(claims.wrong_open),
        planes=len(model.planes),
        pixels=frame.depth_mm.size,
        measured_px=int(rays.measured.sum()),
        sky=int(sky.sum()),
        sky_near=int((sky & rays.measured & (frame.depth_mm < NEAR_SKY_MM)).sum()),
    )
    if not model.valid:
        return found
    planes = model.planes.astype(np.float64)
    verdict = judge(frame, rays, planes)
    judged = rays.obstacle & rays.measured
    inside = judged & ~beside_steps(rays.range_m)
    points = frame.truth.points_level_cam_m[judged]
    found.judged, found.inside, found.open_rays = int(judged.sum()), int(inside.sum()), int(rays.open.sum())
    found.missed = int((verdict.missed & judged).sum())
    found.missed_inside = int((verdict.missed & inside).sum())
    found.phantom = int((verdict.phantom & judged).sum())
    found.open_phantom = int((verdict.phantom & rays.open).sum())
    found.open_early = int(verdict.open_stopped_early.sum())
    if len(points) and len(planes):
        found.errors_m = [distances(points[:: math.ceil(len(points) / POINTS)], planes)]
    found.outlines = outline_counts(frame, seen.scene.blank, rays, verdict.stop_m, left)
    return found


COLUMNS = {
    "views": ("views", 0),
    "invalid": ("invalid", 0),
    "false_stops": ("false stops %", 2),
    "closed": ("closed %", 1),
    "opened": ("free or open %", 1),
    "unmeasured": ("unmeasured %", 1),
    "missed": ("missed %", 2),
    "missed_inside": ("missed inside %", 2),
    "phantom": ("phantom %", 2),
    "open_phantom": ("open rays phantom %", 2),
    "open_early": ("open rays stopped %", 2),
    "mean_m": ("error m", 2),
    "p95_m": ("p95 m", 2),
    "wrong_free": ("wrong free", 0),
    "wrong_open": ("wrong open", 0),
    "planes": ("planes", 1),
    "measured": ("measured %", 1),
    "sky_near": ("sky < 10 m %", 2),
    "outline_px": ("outline px %", 1),
    "outline": ("outline %", 1),
}
"""Title and digits of each figure."""
BOTH_SOURCES = tuple(COLUMNS)[:15]


def table(rows: dict[str, JointFigures], first: str, columns: Sequence[str] = BOTH_SOURCES) -> str:
    """Markdown of rows by name. columns: of COLUMNS."""

    def cells(figures: JointFigures) -> list[str]:
        found = figures.row()
        return ["" if math.isnan(found[key]) else f"{found[key]:.{COLUMNS[key][1]}f}" for key in columns]

    titles = [first, *(COLUMNS[key][0] for key in columns)]
    return markdown.table(titles, [[name, *cells(figures)] for name, figures in rows.items()])


def outline_table(rows: dict[str, JointFigures]) -> str:
    """Markdown: share of the outlines of blank things that the model stops at the right place, by their range."""

    def cells(figures: JointFigures) -> list[str]:
        found = []
        for low, high in OUTLINE_RANGES_M:
            here = [o for o in figures.outlines if low <= o.range_m < high]
            pixels, kept = sum(o.pixels for o in here), sum(o.kept for o in here)
            found.append(f"{100.0 * kept / pixels:.1f}" if pixels else "")
        return found

    titles = ["camera, source", *(f"{low:g} to {high:g} m" for low, high in OUTLINE_RANGES_M)]
    return markdown.table(titles, [[name, *cells(figures)] for name, figures in rows.items()])
