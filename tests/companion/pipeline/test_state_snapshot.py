"""A log begins in mid-flight with the state of the pipeline: the frames after it are the same bit for bit, also where the
autopilot's estimate has jumped or drifts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
import pytest

from companion.pipeline.encode import prisms_bytes
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.pipeline.state import PipelineState
from companion.pipeline.state_messages import state_from_message, state_message
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, PoseSample
from drivers.base import Event
from tests.nightly import first

from ..small_recordings import INFO, MS, START_NS, EasyExtractor, frame

DRIFT_DEG_S, DRIFT_M_S = 3.4, 0.25
"""A heading and a position that creep away: each step is within the limits, and their sum within 3 s is not."""
RATE_MS = 5


def events(seed: int, seconds: float = 9.0) -> list[Event]:
    """200 attitudes and positions a second, of which some are late or missing, with jumps; frames at 20 Hz."""
    rng = np.random.default_rng(seed)
    jump_ms, gap_ms = rng.integers(2000, 4000), rng.integers(4500, 5500)
    found: list[Event] = []
    for t_ms in range(0, round(1000 * seconds), RATE_MS):
        t_ns, t_s = START_NS + t_ms * MS, t_ms / 1000.0
        if not gap_ms <= t_ms < gap_ms + 400:
            jumped = 1.0 if t_ms >= jump_ms else 0.0
            yaw_rad = 0.7 * jumped + math.radians(DRIFT_DEG_S) * t_s + math.radians(0.02) * rng.normal()
            at_m = (8.0 * jumped + DRIFT_M_S * t_s, 0.0, -3.0)
            q = quaternion_from_euler(0.02, -0.05, yaw_rad)
            found.append(AttitudeSample(t_ns, t_ns + MS, q, (0.0, 0.0, 0.0)))
            found.append(PoseSample(t_ns, t_ns + MS, at_m, (0.0, 0.0, 0.0)))
        if t_ms % 50 == 10:
            found.append(frame(t_ms // 50, t_ns - 3 * MS, arrival_ns=t_ns + MS))
    for k in range(10, len(found), 37):  # late samples
        found[k], found[k - 7] = found[k - 7], found[k]
    return found


def outcome(pipeline: Pipeline, some: Sequence[Event]) -> list[tuple[object, ...]]:
    """What each frame gives: the message, and what is not in it and later parts of the service depend on."""
    results = [o for event in some for o in pipeline.handle(event) if isinstance(o, PrismsResult)]
    return [
        (prisms_bytes(r), dataclasses.astuple(r.attitude) if r.attitude else (), r.pose and r.pose.section.jump_ns)
        for r in results
    ]


def pipeline(state: PipelineState | None = None) -> Pipeline:
    return Pipeline((INFO,), EasyExtractor, state=state)


@pytest.mark.parametrize("seed", first(1, range(4)))
def test_frames_after_a_snapshot_are_the_same(seed: int) -> None:
    flight, whole = events(seed), pipeline()
    cuts = [0, *range(500, len(flight), 431), len(flight)]
    parts, states = [], []
    for begin, end in pairwise(cuts):
        parts.append(outcome(whole, flight[begin:end]))
        states.append(state_from_message(state_message(whole.state())))
        assert states[-1] == whole.state()
    for n, cut in enumerate(cuts[1:-1]):
        assert outcome(pipeline(states[n]), flight[cut:]) == list(chain.from_iterable(parts[n + 1 :])), cut


def test_the_flight_jumps_and_drifts() -> None:
    """Otherwise the test above would show nothing: detected in the stored samples alone, jumps are others."""
    flight = events(0)
    first = pipeline()
    cut = len(flight) // 2
    outcome(first, flight[:cut])
    alone = dataclasses.replace(first.state(), headings=None, sections=None)
    assert outcome(pipeline(alone), flight[cut:]) != outcome(first, flight[cut:])


def test_a_state_of_before_these_fields_is_read() -> None:
    first = pipeline()
    outcome(first, events(1)[:900])
    message = state_message(first.state())
    message.ClearField("headings")
    message.ClearField("sections")
    state = state_from_message(message)
    assert (state.headings, state.sections) == (None, None)
    assert state.attitudes == first.state().attitudes
    outcome(pipeline(state), events(1)[900:])
