"""Faults of the autopilot and of the link, end to end: the obstacle output and its timing.

With one kind of autopilot; with both, on real links without the processes: tests/companion/autopilot/test_fault_table.py."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.autopilot.simulate_autopilot import simulated
from drivers.simulation.autopilot import ARDUPILOT
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from tests.waiting import PATIENCE_S, until

from ..live_service import NS, Live, attitude_error_deg
from .test_service_avoids import CONFIG, AvoidingService
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


def test_noise_on_the_line_does_not_keep_obstacles_from_the_autopilot(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles)
    assert avoiding.steadily()
    autopilot = avoiding.health.since(0)[-1].autopilot
    assert autopilot.autopilot == "ArduPilot"
    assert autopilot.counts["noise_bytes"] > 0
    frame = avoiding.prisms.wait(lambda m: m.valid, PATIENCE_S)
    assert attitude_error_deg(frame, avoiding.live.flight()) < 1.0


def test_an_attitude_that_is_repeated_leaves_nothing_clear(avoiding: AvoidingService) -> None:
    """The heading is carried on for 0.3 s; what comes late on the line may be a second old. The other faults of the attitude, on
    real links with both kinds of autopilot: test_fault_table.py."""
    assert until(avoiding.has_obstacles)
    assert until(avoiding.has_read_the_margin)  # which places the wall
    avoiding.line.change(lambda a: setattr(a.profile, "repeats_attitude", lambda _: True))
    begun_ns = time.monotonic_ns()
    try:
        assert until(lambda: time.monotonic_ns() > begun_ns + 3 * NS)
        late = [
            avoiding.ahead(values)
            for t, values in avoiding.decisions()
            if begun_ns + round(1.5 * NS) < t < begun_ns + 3 * NS
        ]
        assert late
        assert [values for values in late if not values <= {WALL_CM}] == []
        assert until(lambda: any(t.startswith("OA: front blind: ") for t in avoiding.texts()))
        avoiding.health.wait(lambda h: "attitude_repeated" in {d.code for d in h.diagnostics}, PATIENCE_S)
    finally:
        avoiding.line.change(lambda a: setattr(a.profile, "repeats_attitude", lambda _: False))
    assert until(avoiding.has_obstacles)
