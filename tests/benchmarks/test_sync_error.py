"""The attitude of an exposure against the truth: a turn of 60 degrees a second, 5 ms of jitter, 50 ppm of drift."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.fidelity.sync_error import Case, _angle_deg, _measured_ns, fly, turning
from companion.pipeline.sync import AttitudeAt, Source
from core.types import AttitudeSample
from drivers.simulation.autopilot import ARDUPILOT, PX4

MS = 1_000_000


@pytest.mark.parametrize(
    ("kind", "drift_ppm", "frame_latency_s"),
    [
        (PX4, 50.0, 0.0),
        (ARDUPILOT, -50.0, 0.04),
        pytest.param(PX4, -50.0, 0.04, marks=pytest.mark.slow),
        pytest.param(ARDUPILOT, 50.0, 0.0, marks=pytest.mark.slow),
    ],
)
def test_the_median_is_within_a_millisecond_and_a_tenth_of_a_degree(
    kind: str, drift_ppm: float, frame_latency_s: float
) -> None:
    errors = fly(Case(kind=kind, drift_ppm=drift_ppm, frame_latency_s=frame_latency_s, seconds=15.0))
    assert len(errors.angle_deg) > 350
    assert errors.dropped == 0
    assert errors.known_after_s < 2.0
    assert np.median(np.abs(errors.clock_s)) <= 0.001
    assert np.median(errors.angle_deg) <= 0.1
    assert np.abs(errors.clock_s[-100:]).max() <= errors.bound_s + 0.001  # stamps are whole milliseconds


def test_what_is_measured_is_the_error() -> None:
    """A stamp and an exposure that are 5 ms wrong are seen to be so."""
    case, t_ns = Case(), 1234 * MS
    state = turning(case, t_ns)
    late = AttitudeSample(t_ns + 5 * MS, t_ns + 6 * MS, state.q_ned_frd_wxyz, state.rates_frd_rad_s)
    assert (late.t_ns - _measured_ns(case, late)) / MS == pytest.approx(5.0, abs=1e-6)
    found = AttitudeAt(state.q_ned_frd_wxyz, Source.EXACT, 0)
    assert _angle_deg(found, state) == pytest.approx(0.0, abs=1e-6)
    assert _angle_deg(found, turning(case, t_ns + 5 * MS)) == pytest.approx(0.3, abs=1e-6)
