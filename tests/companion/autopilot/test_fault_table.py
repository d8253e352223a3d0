"""Each fault of the chain over a real link: the output to the autopilot from 0.4 s after the newest good exposure on.

Link, clock, synchronisation, pipeline, frozen-frame detection and sender are those of the service; frames and their
obstacles are made up: a clear field, which must never be sent by a blind service. The table of all faults, with the
tests of the service as a process, is in docs/research/autopilot-measurements.md."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import drivers.mavlink.conflicts as conflicts
from companion.autopilot.line import line_of
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.cameras.frozen_frames import FrozenFrameDetector
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.mavlink.address import parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.simulation.autopilot import ARDUPILOT, AUTOPILOT_IDS, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, Faults, PtyEnd, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile, hovering
from drivers.simulation.flight_path import VehicleState
from tests.ports import free_port
from tests.waiting import until

from ..report_chain import CAMERA, CLEAR, Sees

pytestmark = pytest.mark.process

NS = 1_000_000_000
AVOID = AvoidParams(radius_m=0.3, max_distance_m=12.0, avoid_margin_m=2.5, remember_s=0.0)
CLEAR_CM, WALL_CM, PX4_WALL_CM = 1201, 266, 252
FRAME_S = 0.05
NOISE = Faults(jitter_s=0.003, noise_share=0.1, double_share=0.05)


class Flown:
    """A companion without its processes, whose camera takes a frame whenever `fly` comes round."""

    def __init__(self, address: str, line: AutopilotLink, kind: str) -> None:
        self.line, self.kind = line, kind
        self.waiting: deque[AttitudeSample | PoseSample] = deque()
        self.cause = ""
        session = MavlinkSession(on_message=lambda message, t_ns: self.obstacle_output.message(message, t_ns))
        self.link = MavlinkLink(parse_address(address), session, self._samples)
        self.obstacle_output = ObstacleOutput(
            AVOID,
            CameraUse(cameras=("front",), timeout_s=0.3, frame_fault=lambda camera: self.cause),
            line_of(session, self.link),
        )
        self.obstacle_output.announce(CAMERA)
        self._pipeline = Pipeline((CAMERA,), lambda info: Sees(CLEAR))
        self._frozen_detector = FrozenFrameDetector(4)
        self._dice = np.random.default_rng(1)
        self._image = self._dice.integers(1000, 9000, (48, 64), np.uint16)
        self.frames = self.good_ns = self.judged_ns = 0
        self.delivers, self.repeats = True, False

    def _samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        self.waiting.extend(samples)
        self.obstacle_output.samples(samples)

    def fly(self, seconds: float) -> None:
        """Frames at 20 Hz, exposed now."""
        end_ns = time.monotonic_ns() + round(seconds * NS)
        while (now_ns := time.monotonic_ns()) < end_ns:
            self.obstacle_output.tick(now_ns)
            if self.delivers:
                self._see(now_ns)
            time.sleep(FRAME_S)

    def _see(self, now_ns: int) -> None:
        self.frames += 1
        if not self.repeats:
            self._image = self._dice.integers(1000, 9000, (48, 64), np.uint16)
        while self.waiting:
            self._pipeline.handle(self.waiting.popleft())
        frame = DepthFrame(
            camera="front", sequence=self.frames, t_exposure_ns=now_ns, t_arrival_ns=now_ns, depth_mm=self._image
        )
        before, self.cause = self.cause, self._frozen_detector.check(frame)
        self.judged_ns = self.judged_ns if before or not self.cause else time.monotonic_ns()
        if self._frozen_detector.repeats:
            return
        for output in self._pipeline.handle(frame):
            if isinstance(output, PrismsResult):
                self.obstacle_output.result(output)
                if output.valid and not self.cause and not self.repeats:
                    self.good_ns = now_ns

    def sent_reports(self, since_ns: int = 0) -> list[tuple[int, list[int]]]:
        """(decided, values) of each message received: the instant of the decision is in it."""
        messages = self.line.change(lambda a: list(a.of_kind("OBSTACLE_DISTANCE")))
        return [(1000 * m.time_usec, list(m.distances)) for m in messages if 1000 * m.time_usec >= since_ns]

    def sees(self) -> bool:
        """Whether it reports the sectors ahead as clear."""
        sent_reports = self.sent_reports()
        return bool(sent_reports) and sent_reports[-1][1][0] == CLEAR_CM

    def comes_to_see(self) -> bool:
        """Flies until it does."""

        def look() -> bool:
            self.fly(0.2)
            return self.sees()

        return until(look)


LINES = [(PX4, "udp"), (ARDUPILOT, "pty")]


@pytest.fixture(scope="module", autouse=True)
def _conflicts_are_soon_over() -> Iterator[None]:
    """3 s after their last message in place of 10: the output is checked until it is clear again."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conflicts, "RECENT_NS", 3 * NS)
        yield


@contextmanager
def connected(kind: str, way: str) -> Iterator[Flown]:
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, boot_at_ns=time.monotonic_ns() - 30 * NS))
    autopilot.parameters = {"AVOID_MARGIN": 2.5} if kind == ARDUPILOT else {"CP_DIST": 2.5}
    end = UdpEnd("127.0.0.1", port := free_port()) if way == "udp" else PtyEnd()
    address = f"serial:{end.device}" if isinstance(end, PtyEnd) else f"udpin:127.0.0.1:{port}"
    with AutopilotLink(autopilot, end, NOISE) as line:
        flown = Flown(address, line, kind)
        flown.link.open()
        flown.obstacle_output.open()
        try:
            assert flown.comes_to_see()
            # the policy depends on a parameter, which counts after a second
            assert until(lambda: flown.fly(0.2) is None and flown.obstacle_output.values.parameters.values())
            yield flown
        finally:
            flown.obstacle_output.close()
            flown.link.close()


@pytest.fixture(scope="module", params=LINES, ids=[f"{kind}-{way}" for kind, way in LINES])
def flown(request: pytest.FixtureRequest) -> Iterator[Flown]:
    with connected(*request.param) as flown:
        yield flown


def nan(t_ns: int) -> VehicleState:
    return replace(hovering(t_ns), euler_rad=(math.nan, 0.0, 0.0))


Act = Callable[[Flown], Any]


def profile(name: str, value: Any) -> Act:
    return lambda flown: flown.line.change(lambda a: setattr(a.profile, name, value))


FAULTS: dict[str, tuple[Act, Act]] = {
    "the camera dies": (lambda f: setattr(f, "delivers", False), lambda f: setattr(f, "delivers", True)),
    "the image is frozen": (lambda f: setattr(f, "repeats", True), lambda f: setattr(f, "repeats", False)),
    "no attitude": (profile("hides_attitude", lambda _: True), profile("hides_attitude", lambda _: False)),
    "an attitude is repeated": (
        profile("repeats_attitude", lambda _: True),
        profile("repeats_attitude", lambda _: False),
    ),
    "an attitude of no numbers": (profile("motion", nan), profile("motion", hovering)),
    "the autopilot's clock starts anew and stands": (profile("drift", -1.0), profile("drift", 0.0)),
}
"""What breaks, and what mends it."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_blind_service_sends_nothing_clear_from_0_4_s_on(flown: Flown, fault: str) -> None:
    assert flown.comes_to_see()
    breaks, mends = FAULTS[fault]
    breaks(flown)
    broken_ns = time.monotonic_ns()
    try:
        flown.fly(0.9)
        # what ages is the newest frame, or the newest attitude: none that is good is newer than the fault
        deadline_ns = min(flown.good_ns, broken_ns) + 400_000_000
        if fault == "the image is frozen":  # a busy machine needs longer for four frames
            deadline_ns = max(deadline_ns, flown.judged_ns)
        assert until(lambda: flown.sent_reports(deadline_ns) or flown.fly(0.1))
        late = flown.sent_reports(deadline_ns)
        allowed = {PX4_WALL_CM} if flown.kind == PX4 else {WALL_CM}
        assert {values[i] for _, values in late for i in (71, 0, 1)} == allowed, late[0]
    finally:
        mends(flown)
    assert flown.comes_to_see()


def test_an_armed_autopilot_without_heartbeats_still_receives_obstacles(flown: Flown) -> None:
    """The line may work one way only: ArduPilot would fly on if the wall ceased; PX4 stands in silence."""
    profile("armed", True)(flown)
    assert until(lambda: getattr(flown.link.status().vehicle, "armed", False))
    flown.line.change(lambda a: setattr(a, "sends_nothing", True))
    mute_ns = time.monotonic_ns()
    try:
        flown.fly(4.5)
        if flown.kind == ARDUPILOT:
            assert until(lambda: flown.sent_reports(mute_ns + 4 * NS) or flown.fly(0.1))
        else:
            assert flown.sent_reports(mute_ns + 4 * NS) == []
        late = flown.sent_reports(mute_ns + 5 * NS // 10)
        allowed = {PX4_WALL_CM} if flown.kind == PX4 else {WALL_CM}
        assert {values[i] for _, values in late for i in (71, 0, 1)} == allowed
    finally:
        flown.line.change(lambda a: setattr(a, "sends_nothing", False))
        profile("armed", False)(flown)
    assert flown.comes_to_see()


def packed(message: Any, component: int) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, 1, component)))


def other_senders(flown: Flown) -> list[bytes]:
    """A second companion that reports clear sectors, attitudes of another component, answers to a TIMESYNC request that was not sent."""
    clear = dialect.MAVLink_obstacle_distance_message(0, 4, [CLEAR_CM] * 72, 5, 20, 1200, 5.0, 0.0, 12)
    attitude = dialect.MAVLink_attitude_message(1, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0)
    beat = dialect.MAVLink_heartbeat_message(2, AUTOPILOT_IDS[flown.kind], 0, 0, 4, 3)
    answer = dialect.MAVLink_timesync_message(10**15, 10**12)
    return [packed(clear, 197), packed(attitude, 100), packed(beat, 100), packed(answer, 1)]


def test_other_senders_do_not_make_a_blind_service_send_clear(flown: Flown) -> None:
    """As a router brings them, in between the autopilot's own words."""
    cause = other_senders(flown)
    flown.delivers = False
    died_ns = flown.good_ns
    try:
        for _ in range(6):
            flown.line.change(lambda a: [a.relay(data) for data in cause])
            flown.fly(0.2)
        late = flown.sent_reports(died_ns + 400_000_000)
        assert late
        assert {values[i] for _, values in late for i in (71, 0, 1)} == (
            {PX4_WALL_CM} if flown.kind == PX4 else {WALL_CM}
        )
        strange = flown.link.status().conflicts
        assert "component 197 sends obstacles too" in strange["two companions"]
    finally:
        flown.delivers = True
    assert flown.comes_to_see()


def test_a_forged_kind_of_autopilot_brings_the_wall_and_no_silence(flown: Flown) -> None:
    """Heartbeats of the autopilot's identity with another kind: the messages are safe for both kinds."""
    forged = AUTOPILOT_IDS[ARDUPILOT if flown.kind == PX4 else PX4]
    beat = packed(dialect.MAVLink_heartbeat_message(2, forged, 0, 0, 4, 3), 1)
    flown.delivers = False
    died_ns = flown.good_ns
    try:
        for _ in range(14):
            flown.line.change(lambda a: a.relay(beat))
            flown.fly(0.2)
        # PX4's policy would be silent by then
        assert until(lambda: flown.sent_reports(died_ns + round(2.3 * NS)) or flown.fly(0.1))
        assert all(values[0] < 1200 for _, values in flown.sent_reports(died_ns + NS))
    finally:
        flown.delivers = True
    assert flown.comes_to_see()
    # the kind counts again with the first heartbeat after that
    assert until(lambda: flown.fly(0.2) is None and getattr(flown.link.status().vehicle, "autopilot", "") == flown.kind)
