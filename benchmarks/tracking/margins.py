"""Coverage of the margins by range: the share of true obstacle points that no plane, less its margin, leaves in front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.case import FAULTS
from benchmarks.fidelity.coverage import is_covered
from benchmarks.fidelity.metrics import rays_of, stops
from benchmarks.fidelity.plots import label
from benchmarks.paper.plots import SERIES, figure
from core.tracking.tracker import Tracker
from drivers.simulation.flights import FlightPlan

from .sequences import Exposure, Floats, exposures, to_level_cam, to_ned, tracking_frame, true_pose

EDGES_M = np.arange(0.0, 21.0, 2.0)
SHARES = (0.0, 0.5, 1.0)
"""Of the margin: what it is needed for."""
NOISES = {"white": "white", "blobs": "all"}
"""Name -> benchmarks.fidelity.case.FAULTS."""
MODELS = ("frame", "tracks")
SCORED_EVERY = 4
GOAL = 0.95
_NEAR_M = 2.0


@dataclass(slots=True)
class Counts:
    """points: (bins,) true obstacle points by range; covered: (shares, bins) of them with these shares of the margins;
    met: (bins,) of them whose ray meets a plane at most _NEAR_M off; margin_m: (bins,) sum of the margins of these planes;
    short_m: (bins,) sum of how far those planes less their margins lie in front of the points."""

    points: Floats
    covered: Floats
    met: Floats
    margin_m: Floats
    short_m: Floats

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.points + other.points,
            self.covered + other.covered,
            self.met + other.met,
            self.margin_m + other.margin_m,
            self.short_m + other.short_m,
        )

    def merged(self, first_m: float, last_m: float) -> Counts:
        """One bin of the ranges first_m to last_m."""
        use = (EDGES_M[:-1] >= first_m) & (EDGES_M[1:] <= last_m)
        return Counts(
            self.points[use].sum(keepdims=True),
            self.covered[:, use].sum(axis=1, keepdims=True),
            self.met[use].sum(keepdims=True),
            self.margin_m[use].sum(keepdims=True),
            self.short_m[use].sum(keepdims=True),
        )


def empty() -> Counts:
    """Nothing counted."""
    n = len(EDGES_M) - 1
    return Counts(np.zeros(n), np.zeros((len(SHARES), n)), np.zeros(n), np.zeros(n), np.zeros(n))


def run(plan: FlightPlan, frames: int, ke_per_m: float, noise: str, warm: int) -> dict[str, Counts]:
    """The counts of a flight for each of MODELS, from frame `warm` on."""
    tracker, found = Tracker(), {name: empty() for name in MODELS}
    for e in exposures(plan, frames, ke_per_m, sensor=FAULTS[NOISES[noise]]):
        snapshot = tracker.observe(tracking_frame(e, true_pose))
        if e.k < warm or e.k % SCORED_EVERY:
            continue
        tracks = to_level_cam(to_ned(snapshot.planes, e, true_pose), e)
        found["frame"] += counts(e, e.model.planes.astype(np.float64), e.model.margin_m.astype(np.float64), ke_per_m)
        found["tracks"] += counts(e, tracks, snapshot.margin_m.astype(np.float64), ke_per_m)
    return found


def counts(e: Exposure, planes: Floats, margins_m: Floats, ke_per_m: float) -> Counts:
    """The counts of one model of an exposure; planes (N, 6) in level_cam."""
    rays = rays_of(e.rendered, ke_per_m, blind_left_px=16)
    range_m = rays.range_m[rays.obstacle]
    bins = np.minimum(np.digitize(range_m, EDGES_M) - 1, len(EDGES_M) - 2)

    def binned(weights: NDArray[np.float64] | NDArray[np.bool_]) -> Floats:
        return np.bincount(bins, weights.astype(np.float64), minlength=len(EDGES_M) - 1).astype(np.float64)

    covered = [binned(is_covered(e.rendered, rays, planes, share * margins_m)) for share in SHARES]
    depth, which = stops(planes, e.info.intrinsics, e.rendered.R_level_optical)
    stop_m = (depth * rays.per_depth)[rays.obstacle]
    met = np.abs(stop_m - range_m) <= _NEAR_M
    margin = np.zeros(len(range_m))
    margin[met] = margins_m[which[rays.obstacle][met]]
    short = np.where(met, range_m - np.where(met, stop_m, 0.0) + margin, 0.0)
    return Counts(binned(np.ones(len(range_m))), np.array(covered), binned(met), binned(margin), binned(short))


def draw(found: dict[tuple[str, float], dict[str, Counts]], path: Path) -> None:
    """Coverage over range: a panel for each (noise, ke), a line for each model, dashed without the margin."""
    keys: Sequence[tuple[str, float]] = list(found)
    middle = 0.5 * (EDGES_M[1:] + EDGES_M[:-1])
    with figure(path, 1, len(keys), 3.4 * len(keys), 3.6) as axes:
        for ax, (noise, ke) in zip(axes[0], keys, strict=True):
            for color, (name, c) in zip(SERIES, found[noise, ke].items(), strict=False):
                use = c.points > 0
                for share, style in ((1.0, "o-"), (0.0, "--")):
                    values = 100.0 * c.covered[SHARES.index(share)][use] / c.points[use]
                    text = name if share else f"{name}, without margin"
                    ax.plot(middle[use], values, style, color=color, markersize=3, label=text)
            ax.axhline(100.0 * GOAL, color="black", linewidth=0.8)
            ax.set_ylim(50.0, 101.0)
            label(ax, f"{noise}, ke {ke:g}", "range, m", "points covered, %", "lower left")
