"""Still cameras and flights: what is found again, how long ids last, phantoms and missed rays, false movers."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.fidelity.metrics import judge, rays_of
from benchmarks.fidelity.stability import Seen, covered, found_again, in_image
from core.tracking.snapshot import TrackSnapshot
from core.tracking.tracker import Tracker
from drivers.simulation.flights import FlightPlan

from .sequences import Exposure, Pose, exposures, to_level_cam, to_ned, tracking_frame, true_pose

Floats = NDArray[np.float64]
REACH_M = 0.1
SAME_M = 0.3
STEADY_HITS = 4
"""Observations after which a track is steady."""
SCORED_EVERY = 4
"""Frames between two that are judged against the truth."""


@dataclass(slots=True)
class Figures:
    """Of one way of tracking, each a list with a value for each frame or pair of frames."""

    again: list[float] = field(default_factory=list)
    same_id: list[float] = field(default_factory=list)
    same_steady_id: list[float] = field(default_factory=list)
    planes: list[int] = field(default_factory=list)
    missed: list[float] = field(default_factory=list)
    phantom: list[float] = field(default_factory=list)
    open_stopped: list[float] = field(default_factory=list)
    movers: int = 0
    frames: int = 0


def run(plan: FlightPlan, frames: int, ke_per_m: float, poses: dict[str, Pose | None], warm: int) -> dict[str, Figures]:
    """Figures of the frame's model ("frame") and of a tracker for each of `poses`. warm: frames before the first pair that
    counts."""
    trackers = {name: Tracker() for name in poses}
    figures = {name: Figures() for name in ("frame", *poses)}
    before: dict[str, tuple[Seen, NDArray[np.int64]]] = {}
    steady: dict[str, NDArray[np.bool_]] = {}
    for e in exposures(plan, frames, ke_per_m):
        shown: dict[str, tuple[Floats, NDArray[np.int64]]] = {}
        ned = tracking_frame(e, true_pose)
        shown["frame"] = ned.model.planes.astype(np.float64), np.zeros(0, np.int64)
        for name, pose in poses.items():
            snapshot: TrackSnapshot = trackers[name].observe(tracking_frame(e, pose))
            shown[name] = to_ned(snapshot.planes, e, pose), snapshot.ids
            steady_before, steady[name] = steady.get(name), snapshot.hits >= STEADY_HITS
            if e.k > warm and steady_before is not None:
                now = seen_of(shown[name][0], e)
                figures[name].same_steady_id.append(same_id(*chosen(before[name], steady_before), now, snapshot.ids))
            figures[name].movers += len(snapshot.objects)
            figures[name].frames += 1
        for name, (planes, ids) in shown.items():
            f, seen = figures[name], seen_of(planes, e)
            if e.k > warm:
                first, first_ids = before[name]
                f.again.append(found_again(first, seen, REACH_M).by_area)
                f.planes.append(len(planes))
                if len(ids):
                    f.same_id.append(same_id(first, first_ids, seen, ids))
            before[name] = seen, ids
        if e.k > warm and e.k % SCORED_EVERY == 0:
            score(e, shown, figures, ke_per_m)
    return figures


def seen_of(planes: Floats, e: Exposure) -> Seen:
    """The planes of an exposure."""
    return Seen(planes=planes, info=e.info, R_ned_optical=e.R_ned_optical, position_m=e.position_m)


def chosen(frame: tuple[Seen, NDArray[np.int64]], which: NDArray[np.bool_]) -> tuple[Seen, NDArray[np.int64]]:
    """Some tracks of a frame."""
    seen, ids = frame
    return dataclasses.replace(seen, planes=seen.planes[which]), ids[which]


def score(
    e: Exposure, shown: dict[str, tuple[Floats, NDArray[np.int64]]], figures: dict[str, Figures], ke: float
) -> None:
    """Judges all models of an exposure against the truth."""
    rays = rays_of(e.rendered, ke, blind_left_px=16)
    for name, (planes, _) in shown.items():
        verdict = judge(e.rendered, rays, to_level_cam(planes, e))
        f, obstacle, open_ = figures[name], rays.obstacle, rays.open
        f.missed.append(float(verdict.missed[obstacle].mean()))
        f.phantom.append(float(verdict.phantom[obstacle].mean()))
        f.open_stopped.append(float(verdict.phantom[open_].mean()) if open_.any() else math.nan)


def same_id(first: Seen, ids: NDArray[np.int64], following: Seen, next_ids: NDArray[np.int64]) -> float:
    """Share (by area) of a frame's tracks whose place has the same id in the next one, of what is in its image and has a
    track within SAME_M there."""
    same = total = 0.0
    for k, plane in enumerate(first.planes):
        points, area, _ = covered(plane[None])
        asked = in_image(points, following)
        if not asked.any():
            continue
        best = nearest(points[asked], following.planes)
        near = best[:, 0] <= SAME_M
        own = np.flatnonzero(next_ids == ids[k])
        mine = near if len(own) == 0 else near & (best[:, 0] >= 0.0)
        total += float(area[asked][mine].sum())
        if len(own):
            off = nearest(points[asked], following.planes[own])[:, 0]
            same += float(area[asked][near & (off <= SAME_M)].sum())
    return same / total if total > 0.0 else math.nan


def nearest(points: Floats, planes: Floats) -> Floats:
    """(P, 1) distance of each point to the nearest plane."""
    from benchmarks.fidelity.metrics import distances

    return distances(points, planes)[:, None]
