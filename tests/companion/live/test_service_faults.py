"""Faults of the autopilot and of the link, end to end: the obstacle output and its timing.

With one kind of autopilot; with both, on real links without the processes: tests/companion/autopilot/test_fault_table.py."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from companion.autopilot.simulate_autopilot import simulated
from drivers.simulation.autopilot import ARDUPILOT, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from drivers.simulation.flight_path import VehicleState
from tests.waiting import until

from ..live_service import NS, Live
from .test_service_avoids import CONFIG, FRONT, AvoidingService
from .test_service_conflicts import WALL_CM

pytestmark = [pytest.mark.process, pytest.mark.realtime]


@pytest.fixture(scope="module")
def avoiding(tmp_path_factory: pytest.TempPathFactory, renders: Path) -> Iterator[AvoidingService]:
    """On a serial line with noise, late and doubled messages."""
    end = PtyEnd()
    sections = CONFIG.replace("udpin:127.0.0.1:{port}", f"serial:{end.device}:921600")
    live = Live(tmp_path_factory.mktemp("faults"), sections, renders, quick=True)
    autopilot = simulated(live.flight(), ARDUPILOT)
    autopilot.profile.boot_at_ns = time.monotonic_ns() - 30 * NS
    autopilot.parameters = dict(PARAMETERS[ARDUPILOT])
    faults = Faults(jitter_s=0.005, noise_share=0.1, double_share=0.05, late_share=0.01)
    with AutopilotLink(autopilot, end, faults) as line:
        avoiding = AvoidingService(live, line, ARDUPILOT)
        try:
            live.start()
            assert until(avoiding.has_obstacles)
            yield avoiding
            assert live.stop() == 0
        finally:
            live.close()


def nan(state: VehicleState) -> VehicleState:
    return replace(state, euler_rad=(math.nan, 0.0, 0.0))


def loses_attitude(autopilot: SimulatedAutopilot) -> None:
    autopilot.profile.hides_attitude = lambda _: True


def repeats_attitude(autopilot: SimulatedAutopilot) -> None:
    autopilot.profile.repeats_attitude = lambda _: True


def sends_nan(autopilot: SimulatedAutopilot) -> None:
    motion = autopilot.profile.motion
    autopilot.profile.motion = lambda t_ns: nan(motion(t_ns))


def test_noise_on_the_line_does_not_keep_obstacles_from_the_autopilot(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles)
    assert avoiding.steadily()
    assert avoiding.health.since(0)[-1].autopilot.counts["noise_bytes"] > 0


@pytest.mark.parametrize("fault", [loses_attitude, repeats_attitude, sends_nan])
def test_without_an_attitude_that_is_one_nothing_is_clear(avoiding: AvoidingService, fault: object) -> None:
    """The heading is carried on for 0.3 s; what comes late on the line may be a second old."""
    assert until(avoiding.has_obstacles)
    before = avoiding.line.change(lambda a: (a.profile.hides_attitude, a.profile.motion))
    avoiding.line.change(fault)
    begun_ns = time.monotonic_ns()
    try:
        assert until(lambda: time.monotonic_ns() > begun_ns + 3 * NS)
        late = [
            (t, [values[i] for i in FRONT])
            for t, values in avoiding.decisions()
            if begun_ns + round(1.5 * NS) < t < begun_ns + 3 * NS
        ]
        assert late
        assert [values for _, values in late if not set(values) <= {WALL_CM}] == []
        assert until(lambda: any(t.startswith("OA: front blind: ") for t in avoiding.texts()))
        codes = {d.code for d in avoiding.health.since(0)[-1].diagnostics}
        assert ("attitude_repeated" in codes) is (fault is repeats_attitude)
    finally:
        avoiding.line.change(lambda a: setattr(a.profile, "repeats_attitude", lambda _: False))
        avoiding.line.change(lambda a: setattr(a.profile, "hides_attitude", before[0]))
        avoiding.line.change(lambda a: setattr(a.profile, "motion", before[1]))
    assert until(avoiding.has_obstacles)
