"""Several draws of the noise of each scene: what tracks miss and invent, beside the model of each frame alone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.fidelity.case import frames_of, true_rays
from benchmarks.fidelity.metrics import Rays, judge
from benchmarks.fidelity.result import Case
from core.extractor import Extractor
from core.tracking.snapshot import TrackingFrame
from core.tracking.tracker import Tracker
from core.types import ExtractorState
from drivers.simulation.source import Rendered

from .sequences import HZ, NS

DRAWS = 10
MISSED_LIMIT, PHANTOM_LIMIT = 0.0005, 0.005
"""Shares of the obstacles' rays above which a case is counted."""


@dataclass(frozen=True, slots=True)
class Shares:
    """Of the obstacles' rays of one frame, 0..1; NaN: there are none."""

    missed: float
    phantom: float


@dataclass(frozen=True, slots=True)
class CaseDraws:
    """One case: for each draw the shares of the frame's own model and of the tracks after it."""

    case: Case
    frame: tuple[Shares, ...]
    tracks: tuple[Shares, ...]

    @property
    def worse(self) -> int:
        """Draws in which the tracks miss more than the frame's own model."""
        return sum(t.missed > f.missed for f, t in zip(self.frame, self.tracks, strict=True))


@dataclass(frozen=True, slots=True)
class Summary:
    """Of one way over all cases.

    Attributes:
        missed, phantom: mean over the frames.
        worst_missed, worst_phantom: (share, name) of the case with the greatest mean.
        cases_missed, cases_phantom: cases whose mean is above MISSED_LIMIT, and above PHANTOM_LIMIT."""

    missed: float
    phantom: float
    worst_missed: tuple[float, str]
    worst_phantom: tuple[float, str]
    cases_missed: int
    cases_phantom: int


def draws_of(cases: Iterable[Case], draws: int = DRAWS) -> Iterator[CaseDraws]:
    """Yields the figures of each case, a still camera before a still scene."""
    extractor = Extractor()
    for case in cases:
        yield _case_draws(case, frames_of(case, draws), extractor)


def _case_draws(case: Case, frames: list[Rendered], extractor: Extractor) -> CaseDraws:
    tracker, state, alone, tracked = Tracker(), ExtractorState(), [], []
    for k, frame in enumerate(frames):
        model, state = extractor.extract(frame.depth_mm, frame.info, frame.R_level_optical, state=state)
        shown = tracker.observe(
            TrackingFrame(model=model, camera_m=(0.0, 0.0, 0.0), t_ns=1 + round(k * NS / HZ), positioned=True)
        )
        rays = true_rays(case, frame, extractor.params.min_obstacle_height_m)
        alone.append(_shares(frame, rays, model.planes.astype(np.float64)))
        tracked.append(_shares(frame, rays, shown.planes.astype(np.float64)))
    return CaseDraws(case, tuple(alone), tuple(tracked))


def _shares(frame: Rendered, rays: Rays, planes: np.ndarray) -> Shares:
    if not rays.obstacle.any():
        return Shares(math.nan, math.nan)
    verdict = judge(frame, rays, planes)
    return Shares(float(verdict.missed[rays.obstacle].mean()), float(verdict.phantom[rays.obstacle].mean()))


def summary(found: list[CaseDraws], tracks: bool) -> Summary:
    """The figures of one way; cases without an obstacle do not count."""
    missed, phantom = [], []
    for one in found:
        shares = one.tracks if tracks else one.frame
        if not math.isnan(shares[0].missed):
            missed.append((float(np.mean([s.missed for s in shares])), one.case.name))
            phantom.append((float(np.mean([s.phantom for s in shares])), one.case.name))
    return Summary(
        missed=float(np.mean([share for share, _ in missed])),
        phantom=float(np.mean([share for share, _ in phantom])),
        worst_missed=max(missed),
        worst_phantom=max(phantom),
        cases_missed=sum(share > MISSED_LIMIT for share, _ in missed),
        cases_phantom=sum(share > PHANTOM_LIMIT for share, _ in phantom),
    )
