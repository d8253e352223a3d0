"""Events of a fleet's tables: blindness, missing frames, near passes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from companion.batch.events import FlightEvents, FrameSummary
from companion.batch.frame_rows import nearest_plane_m

from ..fleet import NS
from ..small_recordings import easy_model

pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")


def summary(t_s: float, valid: bool = True, distance_m: float | None = None) -> FrameSummary:
    return FrameSummary(
        camera="front",
        t_ns=round(t_s * NS),
        file=0,
        valid=valid,
        cause="" if valid else "no_measurement",
        armed=True,
        distance_m=distance_m,
    )


def events_of(frames: list[FrameSummary], gap_s: float = 0.3) -> list[tuple[Any, ...]]:
    events = FlightEvents(near_m=2.0)
    events.gap_s = gap_s
    found = [row for frame in frames for row in events.frame(frame)] + list(events.end())
    return [(r["kind"], r["t_ns"] / NS, r["end_ns"] and r["end_ns"] / NS, r["cause"], r["distance_m"]) for r in found]


def test_blind_frames_are_one_event_until_the_next_valid_frame() -> None:
    frames = [summary(0.0), summary(0.1, valid=False), summary(0.2, valid=False), summary(0.3)]
    assert events_of(frames) == [("blind", 0.1, 0.3, "no_measurement", None), ("recovered", 0.3, 0.3, "", None)]


def test_blindness_may_last_to_the_end_of_the_log() -> None:
    assert events_of([summary(0.0), summary(0.1, valid=False)]) == [("blind", 0.1, None, "no_measurement", None)]


def test_missing_frames_are_blind_from_the_newest_frame_on() -> None:
    found = events_of([summary(0.0), summary(0.1), summary(0.6)])
    assert found == [("blind", 0.1, 0.6, "no_frame", None), ("recovered", 0.6, 0.6, "", None)]
    found = events_of([summary(0.1), summary(0.6, valid=False), summary(0.7)])
    assert found == [("blind", 0.1, 0.7, "no_frame", None), ("recovered", 0.7, 0.7, "", None)]
    assert events_of([summary(0.1), summary(9.0)], gap_s=float("inf")) == []


def test_a_near_pass_has_its_smallest_distance_and_continues_through_blindness() -> None:
    distances = [2.5, 1.9, 1.2, None, 1.5, 2.1]
    frames = [summary(0.1 * i, valid=i != 3, distance_m=d) for i, d in enumerate(distances)]
    near = [e for e in events_of(frames) if e[0] == "near_pass"]
    assert near == [("near_pass", 0.1, 0.5, "", 1.2)]


def test_the_nearest_plane_is_measured_in_space() -> None:
    model = easy_model(4.0, 1.0)  # planes 1.5 m above to 0.5 m below the origin, 4 m ahead
    assert nearest_plane_m(model, np.zeros(3)) == pytest.approx(4.0)
    assert nearest_plane_m(model, np.array([1.0, 0.0, 4.5])) == pytest.approx(5.0)
    assert nearest_plane_m(easy_model(4.0, 1.0, valid=False), np.zeros(3)) is None
