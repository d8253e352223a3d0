"""The service as a process sends obstacles to a simulated autopilot over UDP: content and timing, also while blind.

In the flight `window` an obstacle is in view in every frame."""

from __future__ import annotations

import itertools
import os
import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink
from drivers.simulation.firmware_parameters import PARAMETERS
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import NS, Live, flown

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "window"
width_px = 160
fps = 15.0
device = "{cable}"

[autopilot]
address = "udpin:127.0.0.1:{port}"

[avoid]
send = true
remember_s = 0.0

[record]
record = "off"

[supervision]
restart_s = 1.5
first_backoff_s = 0.1
longest_backoff_s = 0.5
"""
BAD: dict[str, dict[str, float]] = {PX4: {"CP_DIST": -1.0}, ARDUPILOT: {"PRX1_TYPE": 0}}
FRONT = [*range(66, 72), *range(7)]
OF_PX4 = pytest.mark.parametrize("avoiding", [PX4], indirect=True)
OF_ARDUPILOT = pytest.mark.parametrize("avoiding", [ARDUPILOT], indirect=True)
"""For what depends on the process and not on the kind of autopilot. Both kinds, on real links without the processes:
test_fault_table.py; without a line: test_failsafe.py, test_feedback_check.py."""


class AvoidingService:
    """A service and the obstacle messages that its autopilot received."""

    def __init__(self, live: Live, line: AutopilotLink, kind: str) -> None:
        self.live, self.line, self.kind = live, line, kind
        self.prisms, self.health = live.subscribe("prisms", pb.PrismsFrame), live.subscribe("health", pb.Health)

    def messages(self) -> list[tuple[int, list[int]]]:
        """(monotonic ns, values) of every OBSTACLE_DISTANCE received so far."""

        def pairs(a: object) -> list[tuple[int, list[int]]]:
            messages = self.line.autopilot.of_kind("OBSTACLE_DISTANCE")
            return [
                (t, list(m.distances)) for t, m in zip(self.line.autopilot.obstacle_times_ns, messages, strict=True)
            ]

        found: list[tuple[int, list[int]]] = self.line.change(pairs)
        return found

    def decisions(self) -> list[tuple[int, list[int]]]:
        """The same with the instant at which the service decided on each, which a busy computer does not delay."""
        messages = self.line.change(lambda a: list(a.of_kind("OBSTACLE_DISTANCE")))
        return [(1000 * m.time_usec, list(m.distances)) for m in messages]

    def ahead(self, values: list[int]) -> set[int]:
        """The values of the sectors ahead."""
        return {values[i] for i in FRONT}

    def steadily(self, count: int = 20) -> bool:
        """Whether `count` consecutive messages arrive from now on at more than 10 Hz and with no gap of 0.5 s, which both
        firmwares treat as silence. A busy machine may need some attempts."""
        begun_ns = time.monotonic_ns()

        def row() -> bool:
            times = [t for t, _ in self.messages() if t > begun_ns]
            rows = (times[i : i + count] for i in range(len(times) - count + 1))
            return any(
                r[-1] - r[0] < (count - 1) * NS // 10 and max(b - a for a, b in pairwise(r)) < NS // 2 for r in rows
            )

        return until(row)

    def correct_parameters(self) -> None:
        """Gives the autopilot the parameters with which it brakes."""
        self.line.change(lambda a: a.parameters.update(PARAMETERS[self.kind]))

    def wait_until_no_fault(self) -> None:
        """Waits until the service has read the corrected parameters and reports no fault."""
        self.correct_parameters()
        self.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)

    def texts(self) -> list[str]:
        return [m.text for m in self.line.change(lambda a: a.of_kind("STATUSTEXT"))]

    def has_obstacles(self) -> bool:
        """Whether the newest message has an obstacle ahead that is not of a failsafe policy."""

        def newest(autopilot: SimulatedAutopilot) -> list[int]:
            found = (m for m in reversed(autopilot.received) if m.get_type() == "OBSTACLE_DISTANCE")
            return next((list(m.distances) for m in found), [])

        values = self.line.change(newest)
        return bool(values) and any(values[i] not in (65535, 266, 302) for i in FRONT)

    def has_read_the_margin(self) -> bool:
        """Whether the parameter that places the wall was read; it is in the state folder then."""
        file = self.live.folder / "state" / "autopilot.json"
        return file.exists() and ("CP_DIST" if self.kind == PX4 else "AVOID_MARGIN") in file.read_text()


@pytest.fixture(scope="module", params=[PX4, ARDUPILOT])
def avoiding(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, renders: Path
) -> Iterator[AvoidingService]:
    """Starts with a wrong parameter."""
    live = Live(tmp_path_factory.mktemp("avoid"), CONFIG, renders, quick=True)
    with flown(live, request.param) as line:
        line.change(lambda a: a.parameters.update(PARAMETERS[request.param] | BAD[request.param]))
        avoiding = AvoidingService(live, line, request.param)
        try:
            live.start()
            yield avoiding
            assert line.change(lambda a: a.of_kind("ONBOARD_COMPUTER_STATUS")) == []  # not configured
            if live.process is not None and live.process.poll() is None:
                assert live.stop() == 0
        finally:
            live.close()


def test_a_parameter_that_keeps_the_autopilot_from_braking_is_reported(avoiding: AvoidingService) -> None:
    text = "CP_DIST = -1" if avoiding.kind == PX4 else "PRX1_TYPE = 0"
    avoiding.line.change(lambda a: a.parameters.update(BAD[avoiding.kind]))
    avoiding.health.wait(lambda h: any(text in t for t in h.troubles), PATIENCE_S)
    avoiding.correct_parameters()


@OF_PX4
def test_obstacles_are_sent_at_ten_hertz_and_more(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles)
    assert avoiding.steadily()
    message = avoiding.line.change(lambda a: a.of_kind("OBSTACLE_DISTANCE"))[-1]
    assert (message.increment, message.increment_f, message.angle_offset, message.frame) == (5, 5.0, 0.0, 12)
    assert message.get_srcSystem() == avoiding.line.autopilot.profile.system_id


@OF_PX4
def test_a_stopped_camera_is_sent_as_the_wall_within_the_time_limit(avoiding: AvoidingService) -> None:
    """With ArduPilot: test_service_conflicts.py."""
    assert until(avoiding.has_obstacles)
    avoiding.wait_until_no_fault()
    os.kill(avoiding.live.camera_pids()["front"], signal.SIGSTOP)  # it sends nothing, and its end is not reported
    stopped_ns = time.monotonic_ns()
    assert until(lambda: avoiding.messages()[-1][0] > stopped_ns + NS)
    newest_ns = max(m.t_exposure_ns for m in avoiding.prisms.since(0) if m.valid and m.t_exposure_ns < stopped_ns)
    blind = [
        (t, avoiding.ahead(values))
        for t, values in avoiding.decisions()
        if newest_ns + 400_000_000 < t < newest_ns + 14 * NS // 10  # the camera is started again after 1.5 s
    ]
    assert blind
    wrong = [(round((t - newest_ns) / 1e6), values) for t, values in blind if not values <= {302}]
    assert not wrong, wrong[:3]
    assert until(avoiding.has_obstacles)
    assert until(lambda: any(t.startswith("OA: front blind: ") for t in avoiding.texts()))


def test_a_blind_camera_stops_messages_to_px4_after_two_seconds_and_sends_ardupilot_a_wall(
    avoiding: AvoidingService,
) -> None:
    assert until(avoiding.has_obstacles)
    avoiding.wait_until_no_fault()
    assert until(avoiding.has_read_the_margin)  # which places the wall
    avoiding.live.cable.unlink()
    begun_ns = time.monotonic_ns()

    def is_silent() -> bool:
        decided_ns, values = avoiding.decisions()[-1]
        return avoiding.ahead(values) == {302} and time.monotonic_ns() > decided_ns + NS

    def late() -> list[set[int]]:
        return [avoiding.ahead(values) for t, values in avoiding.decisions() if t > begun_ns + 4 * NS]

    try:
        if avoiding.kind == PX4:
            assert until(is_silent)
            assert avoiding.decisions()[-1][0] < begun_ns + 5 * NS
        else:
            assert until(lambda: len(late()) > 5)
            assert all(values == {266} for values in late())
    finally:
        avoiding.live.cable.touch()
    assert until(avoiding.has_obstacles)


@OF_PX4
def test_the_age_of_sent_obstacles_is_measured_and_px4s_delay_checked_with_it(avoiding: AvoidingService) -> None:
    def stage(h: pb.Health) -> pb.Latency | None:
        return next((x for x in h.latencies if x.stage == "exposure_to_autopilot"), None)

    latency = stage(avoiding.health.wait(lambda h: stage(h) is not None, PATIENCE_S))
    assert latency is not None
    assert 1.0 < latency.p50_ms <= latency.p95_ms <= latency.p99_ms
    avoiding.line.change(lambda a: a.parameters.update({"CP_DELAY": 0.0}))
    try:
        avoiding.health.wait(lambda h: any("PX4 brakes too late: CP_DELAY = 0 s" in t for t in h.troubles), PATIENCE_S)
    finally:
        avoiding.correct_parameters()


@OF_ARDUPILOT
def test_an_autopilot_that_uses_no_obstacles_is_reported(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles)
    avoiding.line.change(lambda a: setattr(a, "ignores_obstacles", True))
    try:
        avoiding.health.wait(lambda h: any("does not use the obstacles" in t for t in h.troubles), PATIENCE_S)
    finally:
        avoiding.line.change(lambda a: setattr(a, "ignores_obstacles", False))
    avoiding.health.wait(lambda h: not any("does not use the obstacles" in t for t in h.troubles), PATIENCE_S)


def test_a_service_stopped_in_flight_reports_it_and_sends_nothing_clear(avoiding: AvoidingService) -> None:
    """From the signal to the last message, just before the process ends, all directions ahead are blind. Ends the service."""
    line, px4 = avoiding.line, avoiding.kind == PX4
    assert until(avoiding.has_obstacles)
    assert until(avoiding.has_read_the_margin)  # which places the wall
    avoiding.wait_until_no_fault()
    line.change(lambda a: setattr(a.profile, "armed", True))
    line.change(lambda a: setattr(a.profile, "custom_mode", 3 << 16 if px4 else 5))
    received = len(line.change(lambda a: a.of_kind("HEARTBEAT")))
    assert until(lambda: len(line.change(lambda a: a.of_kind("HEARTBEAT"))) > received + 1)  # the mode was received
    assert until(lambda: line.change(lambda a: a.of_kind("HEARTBEAT"))[-1].system_status == 4)
    stopped_ns = time.monotonic_ns()
    assert avoiding.live.stop() == 0
    allowed = {302, 65535} if px4 else {266}  # PX4's wall stands for two seconds
    after = [(t, avoiding.ahead(values)) for t, values in avoiding.messages() if t > stopped_ns]
    clear = list(itertools.takewhile(lambda values: not values <= allowed, (values for _, values in after)))
    assert len(clear) < 15  # less than a second's: the signal is noticed within a tick
    assert len(after) > len(clear)
    assert all(values <= allowed for _, values in after[len(clear) :])
    kinds = [m.get_type() for m in line.change(lambda a: list(a.received))]
    last = len(kinds) - kinds[::-1].index("OBSTACLE_DISTANCE")
    assert kinds[last:].count("HEARTBEAT") <= 1  # they are sent to the end: a heartbeat is sent once a second
    if not px4:  # which stops meanwhile
        assert after[-1][0] - stopped_ns > 2.5 * NS
    text = "OA: stopped, Position mode stands" if px4 else "OA: stopped, vehicle does not brake"
    assert avoiding.texts().count(text) == 1
    assert line.change(lambda a: a.of_kind("HEARTBEAT"))[-1].system_status in (4, 5)
