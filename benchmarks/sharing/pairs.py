"""How well the frames of two vehicles are aligned, apart for pairs whose views overlap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.sharing.flights import FrameError, Part
from benchmarks.sharing.vehicle import Outcome
from benchmarks.world.truth import seen_by, to_ned

Floats = NDArray[np.float64]
LEAST_OVERLAP = 0.25
"""Share of the obstacle points observed by the sender that the receiver has observed, too, from which views overlap."""
_FRAMES, _PIXELS = 6, 24
"""Steps of the frames and pixels whose points are compared."""
SAME_M = 0.1
"""Planes that differ by more have changed since they were sent."""
ASTRAY_M = 0.5
"""A plane is where the sender has one, apart from what its planes move by while they grow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """The frame of a sender as a receiver has it in the end.

    Attributes:
        overlap: share of the sender's obstacle points that the receiver has observed.
        aligned: whether it is aligned by planes.
        place_m: error at the middle of the common points; nan: not aligned.
        yaw_deg: error of its yaw.
        told_m: 2 sigma of its place, which the margins contain.
        of_margin: greatest distance by which the alignment displaces an end of a plane, over the margin of the plane.
        astray: share of the published planes with a sample farther than their margin and ASTRAY_M from all planes of the
            sender's own world, at their exact place."""

    overlap: float
    aligned: bool
    place_m: float = math.nan
    yaw_deg: float = math.nan
    told_m: float = math.nan
    of_margin: float = math.nan
    astray: float = math.nan


def pairs_of(parts: Sequence[Part], outcomes: Sequence[Outcome]) -> list[Pair]:
    """All pairs of receiver and sender."""
    points = [_observed(part) for part in parts]
    return [
        _pair(parts, outcomes, receiver, sender, points[sender])
        for receiver in range(len(parts))
        for sender in range(len(parts))
        if receiver != sender
    ]


def _observed(part: Part) -> Floats:
    """(P, 3) obstacle points, true ned, that the vehicle has observed."""
    some = np.s_[::_PIXELS, ::_PIXELS]
    found = [to_ned(r, r.truth.points_level_cam_m[some][r.truth.obstacle()[some]]) for r in part.rendered[::_FRAMES]]
    points = np.concatenate(found)
    return points[seen_by(points, part.rendered)]


def _pair(parts: Sequence[Part], outcomes: Sequence[Outcome], receiver: int, sender: int, points: Floats) -> Pair:
    common = points[seen_by(points, parts[receiver].rendered)]
    overlap = len(common) / max(1, len(points))
    shared = outcomes[receiver].shared
    assert shared is not None
    status = next((n for n in shared.neighbours if n.vehicle == sender + 1), None)
    rows = np.flatnonzero((shared.sender == sender + 1) & (shared.aligned == 1))
    if status is None or not len(rows):
        return Pair(overlap=overlap, aligned=False)
    published = rows
    slots = {int(slot): k for k, slot in enumerate(outcomes[sender].own_ids)}
    rows = np.array([row for row in rows if int(shared.ids[row]) in slots], np.intp)
    own = outcomes[sender].own[[slots[int(shared.ids[row])] for row in rows]]
    true = carried(own, parts[sender].error, parts[receiver].error)
    R, t = _rigid(_ends(true), _ends(shared.planes[rows].astype(np.float64)))
    middle = common if len(common) else points
    at = parts[receiver].error.local(middle.mean(axis=0)[None])[0, :2]
    ends = _ends(true)
    moved_m = np.hypot(*(ends @ R.T + t - ends).T)
    return Pair(
        overlap=overlap,
        aligned=True,
        place_m=float(np.hypot(*(R @ at + t - at))),
        yaw_deg=abs(math.degrees(math.atan2(R[1, 0], R[0, 0]))),
        told_m=2.0 * status.sigma_m,
        of_margin=float((moved_m / np.tile(shared.margin_m[rows], 2)).max()),
        astray=astray(
            shared.planes[published].astype(np.float64),
            shared.margin_m[published].astype(np.float64),
            carried(outcomes[sender].own, parts[sender].error, parts[receiver].error),
        ),
    )


def astray(planes: Floats, margins_m: Floats, own: Floats) -> float:
    """Share of planes (N, 6) with margins (N,) that have a sample farther than the margin and ASTRAY_M, horizontally, from all
    planes (M, 6) of their owner in the same frame."""
    share = np.linspace(0.0, 1.0, 5)[:, None]
    along, found = own[:, 2:4] - own[:, 0:2], 0
    for plane, margin_m in zip(planes, margins_m, strict=True):
        points = plane[0:2] + share * (plane[2:4] - plane[0:2])
        off = points[:, None] - own[None, :, 0:2]
        t = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.0)
        gap = off - t[:, :, None] * along
        found += bool(np.hypot(gap[:, :, 0], gap[:, :, 1]).min(axis=1).max() > margin_m + ASTRAY_M)
    return found / max(1, len(planes))


def _ends(box: Floats) -> Floats:
    return np.concatenate([box[:, 0:2], box[:, 2:4]])


def _rigid(begin: Floats, to: Floats) -> tuple[Floats, Floats]:
    """(R, t) with to = R begin + t of most points (N, 2); those that do not fit have changed since they were sent."""
    R, t = np.eye(2), np.median(to - begin, axis=0)
    for limit_m in (2.0, 0.5, SAME_M, SAME_M):
        apart_m = np.hypot(*(begin @ R.T + t - to).T)
        some = apart_m <= max(limit_m, float(np.percentile(apart_m, 30)))
        a, b = begin[some] - begin[some].mean(axis=0), to[some] - to[some].mean(axis=0)
        yaw = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
        c, s = math.cos(yaw), math.sin(yaw)
        R = np.array([[c, -s], [s, c]])
        t = to[some].mean(axis=0) - R @ begin[some].mean(axis=0)
    return R, t


def carried(box: Floats, begin: FrameError, to: FrameError) -> Floats:
    """Planes of one local frame in another one, exactly."""
    true = begin.true_boxes(box)
    ends = [to.local(np.column_stack([true[:, k : k + 2], true[:, 4]]))[:, :2] for k in (0, 2)]
    return np.column_stack([*ends, true[:, 4:]])
