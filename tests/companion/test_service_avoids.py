"""The service as a process sends obstacles to a simulated autopilot over UDP: content and timing, also while blind."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from drivers.simulation.autopilot import ARDUPILOT, PX4
from drivers.simulation.autopilot_link import AutopilotLink
from osape_client.proto import osape_v1_pb2 as pb

from .live import NS, Live, flown, until

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 30.0
device = "{cable}"

[autopilot]
address = "udpin:127.0.0.1:{port}"

[avoid]
send = true
remember_s = 0.0

[record]
record = "off"
"""
PARAMETERS = {
    # CP_DELAY: more than what a busy machine adds to the age of obstacles, which would be a diagnostic
    PX4: {"CP_DIST": 3.0, "CP_DELAY": 1.0, "CP_GO_NO_DATA": 0, "MPC_POS_MODE": 4},
    ARDUPILOT: {
        "PRX1_TYPE": 2, "AVOID_ENABLE": 7, "AVOID_MARGIN": 2.5, "AVOID_BEHAVE": 1, "AVOID_BACKUP_SPD": 0, "OA_TYPE": 0,
    },
}  # fmt: skip
FRONT = [*range(66, 72), *range(7)]


class AvoidingService:
    """A service, and the obstacle messages that its autopilot received."""

    def __init__(self, live: Live, line: AutopilotLink, kind: str) -> None:
        self.live, self.line, self.kind = live, line, kind
        self.prisms, self.health = live.ear("prisms", pb.PrismsFrame), live.ear("health", pb.Health)

    def messages(self) -> list[tuple[int, list[int]]]:
        """(arrival, values) of every OBSTACLE_DISTANCE so far."""

        def those(a: object) -> list[tuple[int, list[int]]]:
            messages = self.line.autopilot.of_kind("OBSTACLE_DISTANCE")
            return [
                (t, list(m.distances)) for t, m in zip(self.line.autopilot.obstacle_times_ns, messages, strict=True)
            ]

        found: list[tuple[int, list[int]]] = self.line.change(those)
        return found

    def steadily(self, count: int = 40) -> bool:
        """Whether so many messages in a row come from now on at more than 10 Hz, none half a second after the one before it,
        when both readers call it silence. A busy machine may need some attempts."""
        begun_ns = time.monotonic_ns()

        def row() -> bool:
            times = [t for t, _ in self.messages() if t > begun_ns]
            rows = (times[i : i + count] for i in range(len(times) - count + 1))
            return any(
                r[-1] - r[0] < (count - 1) * NS // 10 and max(b - a for a, b in pairwise(r)) < NS // 2 for r in rows
            )

        return until(row, 60.0)

    def texts(self) -> list[str]:
        return [m.text for m in self.line.change(lambda a: a.of_kind("STATUSTEXT"))]

    def sees(self) -> bool:
        """Whether the newest message has an obstacle ahead that is not of a failsafe policy."""
        avoiding = self.messages()
        return bool(avoiding) and any(v not in (65535, 266, 302) for v in (avoiding[-1][1][i] for i in FRONT))

    def has_read_the_margin(self) -> bool:
        """Whether the parameter that places the wall was read; it is in the state folder then."""
        file = self.live.folder / "state" / "autopilot.json"
        return file.exists() and ("CP_DIST" if self.kind == PX4 else "AVOID_MARGIN") in file.read_text()


@pytest.fixture(scope="module", params=[PX4, ARDUPILOT])
def avoiding(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, renders: Path
) -> Iterator[AvoidingService]:
    live = Live(tmp_path_factory.mktemp("avoid"), CONFIG, renders)
    with flown(live, request.param) as line:
        line.change(lambda a: a.parameters.update(PARAMETERS[request.param]))
        avoiding = AvoidingService(live, line, request.param)
        try:
            live.start()
            yield avoiding
            assert live.stop() == 0
        finally:
            live.close()


def test_obstacles_are_sent_at_ten_hertz_and_more(avoiding: AvoidingService) -> None:
    assert until(avoiding.sees)
    assert avoiding.steadily()
    message = avoiding.line.change(lambda a: a.of_kind("OBSTACLE_DISTANCE"))[-1]
    assert (message.increment, message.increment_f, message.angle_offset, message.frame) == (5, 5.0, 0.0, 12)
    assert message.get_srcSystem() == avoiding.line.autopilot.profile.system_id


def test_parameters_are_read_and_what_they_keep_from_braking_is_reported(avoiding: AvoidingService) -> None:
    avoiding.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, 30.0)
    bad = {"CP_DIST": -1.0} if avoiding.kind == PX4 else {"PRX1_TYPE": 0}
    avoiding.line.change(lambda a: a.parameters.update(bad))
    word = "CP_DIST = -1" if avoiding.kind == PX4 else "PRX1_TYPE = 0"
    try:
        avoiding.health.wait(lambda h: any(word in t for t in h.troubles), 40.0)
    finally:
        avoiding.line.change(lambda a: a.parameters.update(PARAMETERS[avoiding.kind]))


def test_a_dead_camera_is_blind_on_the_wire_in_time(avoiding: AvoidingService) -> None:
    assert until(avoiding.sees)
    avoiding.health.wait(
        lambda h: not any("CP_DIST" in t for t in h.troubles), 30.0
    )  # read again after the test before
    os.kill(avoiding.live.camera_pids()["front"], signal.SIGSTOP)  # it sends nothing, and its end is not reported
    stopped_ns = time.monotonic_ns()
    assert until(lambda: avoiding.messages()[-1][0] > stopped_ns + NS, 3.0)
    newest_ns = max(m.t_exposure_ns for m in avoiding.prisms.since(0) if m.valid and m.t_exposure_ns < stopped_ns)
    blind = [
        (t, [values[i] for i in FRONT])
        for t, values in avoiding.messages()
        if newest_ns + 400_000_000 < t < stopped_ns + NS
    ]
    assert blind
    allowed = {302} if avoiding.kind == PX4 else {266}
    wrong = [(round((t - newest_ns) / 1e6), values) for t, values in blind if not set(values) <= allowed]
    assert not wrong, wrong[:3]
    assert until(avoiding.sees, 15.0)
    assert until(lambda: any(t.startswith("OA: front blind: ") for t in avoiding.texts()), 30.0)


def test_px4_hears_nothing_after_two_blind_seconds_and_ardupilot_a_wall_for_good(avoiding: AvoidingService) -> None:
    assert until(avoiding.sees)
    avoiding.live.cable.unlink()
    try:
        begun_ns = time.monotonic_ns()
        assert until(lambda: time.monotonic_ns() > begun_ns + 6 * NS, 10.0)
        late = [values for t, values in avoiding.messages() if t > begun_ns + 5 * NS]
        if avoiding.kind == PX4:
            assert late == []
        else:
            assert len(late) > 5
            assert all(values[i] == 266 for values in late for i in FRONT)
    finally:
        avoiding.live.cable.touch()
    assert until(avoiding.sees, 20.0)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_service_that_is_stopped_in_flight_says_so_and_leaves_nothing_clear(
    kind: str, tmp_path: Path, renders: Path
) -> None:
    """Blind from the signal to the last message, which goes out just before the process ends."""
    margin = "send = true\navoid_margin_m = 2.5"  # the same wall whether AVOID_MARGIN was read by then or not
    live = Live(tmp_path, CONFIG.replace("send = true", margin), renders)
    with flown(live, kind) as line:
        line.change(lambda a: a.parameters.update(PARAMETERS[kind]))
        line.change(lambda a: setattr(a.profile, "armed", True))
        line.change(lambda a: setattr(a.profile, "custom_mode", 3 << 16 if kind == PX4 else 5))
        avoiding = AvoidingService(live, line, kind)
        try:
            live.start()
            assert until(avoiding.sees, 60.0)
            avoiding.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, 30.0)
            assert until(lambda: line.change(lambda a: a.of_kind("HEARTBEAT"))[-1].system_status == 4, 30.0)
            stopped_ns = time.monotonic_ns()
            assert live.stop() == 0
            ended_ns = time.monotonic_ns()
        finally:
            live.close()
        allowed = {302, 65535} if kind == PX4 else {266}  # CP_DIST is read by then, or not
        after = [(t, {values[i] for i in FRONT}) for t, values in avoiding.messages() if t > stopped_ns]
        blind = [t for t, values in after if values <= allowed]
        assert blind
        assert blind[0] - stopped_ns < NS  # the signal is noticed within a tick
        assert all(values <= allowed for t, values in after if t >= blind[0])
        assert ended_ns - after[-1][0] < NS  # up to the end
        if kind == ARDUPILOT:  # which stops meanwhile
            assert after[-1][0] - stopped_ns > 2.5 * NS
        word = "OA: stopped, Position mode stands" if kind == PX4 else "OA: stopped, vehicle does not brake"
        assert avoiding.texts().count(word) == 1
        assert line.change(lambda a: a.of_kind("HEARTBEAT"))[-1].system_status in (4, 5)


def test_an_autopilot_that_takes_no_obstacles_is_named(avoiding: AvoidingService) -> None:
    assert until(avoiding.sees)
    if avoiding.kind == PX4:
        avoiding.line.change(lambda a: setattr(a.profile, "armed", True))
        avoiding.line.change(lambda a: setattr(a.profile, "custom_mode", 3 << 16))
    avoiding.line.change(lambda a: setattr(a, "deaf", True))
    try:
        avoiding.health.wait(lambda h: any("does not use our obstacles" in t for t in h.troubles), 90.0)
        # PX4 is sent an obstacle in one of eight messages of this flight: most stand at the edge of the view
    finally:
        avoiding.line.change(lambda a: setattr(a, "deaf", False))
    avoiding.health.wait(lambda h: not any("does not use our obstacles" in t for t in h.troubles), 15.0)
