"""The service as a process with one camera and an autopilot over UDP: faults are reported in time and repaired.

In all tests no frame may be valid that was levelled with a wrong attitude: the fixture checks every frame."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.config.service import AutopilotConfig
from drivers.simulation.autopilot_link import AutopilotLink
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import NS, Live, attitude_error_deg, flown

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 15.0
device = "{cable}"

[autopilot]
address = "udpin:127.0.0.1:{port}"
computer_status = true

[record]
record = "off"

[supervision]
restart_s = 1.5
first_backoff_s = 0.1
longest_backoff_s = 1.0
"""


MOST_NEAR_NS = 20_000_000
"""Between an exposure and the attitude it was levelled with: two of the autopilot's samples."""


class Flying:
    """A service that was seen to work, its autopilot, and two subscribers."""

    def __init__(self, live: Live, line: AutopilotLink) -> None:
        self.live, self.line = live, line
        self.prisms, self.health = live.subscribe("prisms", pb.PrismsFrame), live.subscribe("health", pb.Health)

    def well(self, seconds: float = PATIENCE_S, since_ns: int | None = None) -> None:
        """It sees, and nothing is wrong."""
        self.prisms.wait(lambda m: m.valid, seconds, since_ns)
        self.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, seconds, since_ns)

    def blind_frame(self, cause: str, seconds: float, since_ns: int) -> pb.PrismsFrame:
        """That the camera is blind, and why; the whole is blind with it."""
        blind: pb.PrismsFrame = self.prisms.wait(lambda m: not m.valid and cause in m.cause_text, seconds, since_ns)
        health = self.health.wait(lambda h: h.state == pb.Health.STATE_BLIND, seconds, since_ns)
        assert any("camera front is blind" in text for text in health.troubles)
        assert not blind.planes.corners_m
        assert not blind.prisms
        return blind

    def camera(self) -> pb.CameraHealth:
        return self.health.received[-1][1].cameras[0]


@pytest.fixture(scope="module")
def module_flying(tmp_path_factory: pytest.TempPathFactory, renders: Path) -> Iterator[Flying]:
    live = Live(tmp_path_factory.mktemp("live"), CONFIG, renders)
    with flown(live) as line:
        flying = Flying(live, line)
        try:
            live.start()
            yield flying
            assert live.stop() == 0
        finally:
            live.close()


@pytest.fixture
def flying(module_flying: Flying) -> Iterator[Flying]:
    begun_ns = time.monotonic_ns()
    module_flying.well()
    yield module_flying
    flight = module_flying.live.flight()
    errors = [attitude_error_deg(m, flight) for m in module_flying.prisms.since(begun_ns) if m.valid]
    assert max(errors) < 1.0  # of 90 degrees a second times some ms of a clock that is young


def test_frames_flow_with_the_attitude_of_their_exposure(flying: Flying) -> None:
    begun_ns = time.monotonic_ns()
    assert until(lambda: sum(m.valid for m in flying.prisms.since(begun_ns)) > 30)
    # on a busy machine a frame may be blind for a moment, and is reported as blind
    frames = [m for m in flying.prisms.since(begun_ns) if m.valid]
    assert all(m.frame == "ned" for m in frames)
    assert sum(len(m.planes.corners_m) > 0 for m in frames) > 25
    flight = flying.live.flight()
    near = [m for m in frames if m.attitude.distance_ns < MOST_NEAR_NS]
    assert len(near) > 10
    assert max(attitude_error_deg(m, flight) for m in near) < 0.3
    numbers = [m.publication.number for m in frames]
    assert numbers == sorted(set(numbers))
    (camera,) = flying.health.wait(lambda h: h.cameras[0].hz > 0.0, PATIENCE_S).cameras
    assert camera.condition == "running"
    runs: list[subprocess.CompletedProcess[str]] = []

    def all_well() -> bool:
        runs.append(flying.live.command("status", "-c", str(flying.live.config)))
        return runs[-1].returncode == 0 and "  OK" in runs[-1].stdout

    assert until(all_well), runs[-1]
    assert "autopilot: PX4" in runs[-1].stdout


def test_a_late_subscriber_receives_at_once(flying: Flying) -> None:
    late = flying.live.subscribe("prisms", pb.PrismsFrame)
    late.wait(lambda m: m.valid, PATIENCE_S)
    flying.live.subscribe("health", pb.Health).wait(lambda h: h.state == pb.Health.STATE_ACTIVE, PATIENCE_S)


def test_the_state_of_the_computer_is_sent_once_a_second_where_configured(flying: Flying) -> None:
    """Services without this setting send none: test_service_avoids.py."""
    assert not AutopilotConfig().computer_status

    def counts() -> tuple[int, int]:
        kinds = ("HEARTBEAT", "ONBOARD_COMPUTER_STATUS")
        beats, states = flying.line.change(lambda a: tuple(len(a.of_kind(kind)) for kind in kinds))
        return beats, states

    beats, states = counts()
    assert until(lambda: counts()[0] >= beats + 3)
    later_beats, later_states = counts()
    # one of each in a second; this test may be late
    assert 2 <= later_states - states <= later_beats - beats + 2


def test_a_second_service_is_refused_and_the_first_goes_on(flying: Flying) -> None:
    second = flying.live.command("run", "-c", str(flying.live.config))
    assert second.returncode == 1
    assert flying.live.process is not None
    assert f"another service (process {flying.live.process.pid}) publishes on" in second.stderr
    assert "stopped" not in second.stderr, "it never ran"
    flying.well(since_ns=time.monotonic_ns())


SLEEPER = textwrap.dedent("""
    import sys, time, zmq
    socket = zmq.Context().socket(zmq.SUB)
    socket.setsockopt(zmq.SUBSCRIBE, b"")
    socket.connect(sys.argv[1])
    socket.recv()
    print("joined", flush=True)
    time.sleep(1000)
""")


def test_one_that_hangs_costs_nothing(flying: Flying) -> None:
    address = f"ipc://{flying.live.folder}/run/prisms"
    with subprocess.Popen([sys.executable, "-c", SLEEPER, address], stdout=subprocess.PIPE, text=True) as sleeper:
        try:
            assert sleeper.stdout is not None
            assert sleeper.stdout.readline().strip() == "joined"
            sleeper.send_signal(signal.SIGSTOP)
            before, begun_ns = flying.live.memory_bytes(), time.monotonic_ns()
            assert until(lambda: len(flying.prisms.since(begun_ns)) > 60)
            assert flying.live.memory_bytes() - before < 20e6
        finally:
            sleeper.kill()


def test_a_killed_camera_process_is_reported_and_started_again(flying: Flying) -> None:
    starts = flying.camera().starts
    begun_ns = time.monotonic_ns()
    os.kill(flying.live.camera_pids()["front"], signal.SIGKILL)
    flying.blind_frame("process has ended", PATIENCE_S, begun_ns)
    back_ns = begun_ns + NS // 2
    flying.well(since_ns=back_ns)
    assert sum(not m.valid for m in flying.prisms.since(begun_ns)) > 2  # no silence until it is back
    camera = flying.health.wait(lambda h: h.cameras[0].starts > starts and not h.troubles, PATIENCE_S).cameras[0]
    assert "process has ended" in camera.last_loss
    assert 0 <= camera.last_loss_age_ns <= time.monotonic_ns() - begun_ns


def test_after_a_stop_of_all_processes_no_camera_is_restarted(flying: Flying) -> None:
    """As where memory is low, or a virtual machine or container is paused: a restart would make the camera blind for longer,
    an OAK for some seconds."""
    assert flying.live.process is not None
    processes = [flying.live.process.pid, flying.live.camera_pids()["front"]]
    for pid in processes:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(2.5)  # more than restart_s
    begun_ns = time.monotonic_ns()
    for pid in processes:
        os.kill(pid, signal.SIGCONT)
        time.sleep(0.5)  # the camera's first image comes later than the supervisor looks
    flying.well(since_ns=begun_ns)
    assert flying.live.camera_pids()["front"] == processes[1]


def test_a_camera_process_that_hangs_is_reported_and_replaced(flying: Flying) -> None:
    pid = flying.live.camera_pids()["front"]
    begun_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGSTOP)
    flying.blind_frame("camera process silent for", PATIENCE_S, begun_ns)
    assert until(lambda: flying.live.camera_pids().get("front", pid) != pid)
    flying.well()
    assert sum(not m.valid for m in flying.prisms.since(begun_ns)) > 2
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_an_unplugged_camera_is_named_and_comes_back(flying: Flying) -> None:
    begun_ns = time.monotonic_ns()
    flying.live.cable.unlink()
    try:
        flying.blind_frame("unplugged", PATIENCE_S, begun_ns)
        dark_ns = time.monotonic_ns()
        assert until(lambda: len(flying.prisms.since(dark_ns)) >= 20)
        assert not any(m.valid for m in flying.prisms.since(dark_ns))
    finally:
        flying.live.cable.touch()
    flying.well()
    assert "unplugged" in flying.camera().last_loss


def test_a_silent_autopilot_blinds_and_is_named(flying: Flying) -> None:
    begun_ns = time.monotonic_ns()
    flying.line.change(lambda a: setattr(a, "silent", True))
    try:
        flying.blind_frame("attitude is too old", PATIENCE_S, begun_ns)
        flying.health.wait(lambda h: any("the attitude is" in t for t in h.troubles), PATIENCE_S, begun_ns)
        dark_ns = time.monotonic_ns()
        assert until(lambda: len(flying.prisms.since(dark_ns)) >= 20)
        assert not any(m.valid for m in flying.prisms.since(dark_ns))
        flying.health.wait(
            lambda h: any("the autopilot does not send it" in t for t in h.troubles), PATIENCE_S, begun_ns
        )
    finally:
        flying.line.change(lambda a: setattr(a, "silent", False))
    flying.well()


def test_an_autopilot_that_reboots_is_noticed_and_its_clock_learned_again(flying: Flying) -> None:
    """Until then its stamps are of another time: blind, or already right; the fixture sees to it."""
    restarts = flying.health.received[-1][1].autopilot.clock.restarts
    begun_ns = time.monotonic_ns()
    flying.line.change(lambda a: a.reboot(begun_ns))
    flying.health.wait(lambda h: h.autopilot.clock.restarts == restarts + 1, PATIENCE_S, begun_ns)
    flying.health.wait(
        lambda h: (
            h.autopilot.clock.restarts == restarts + 1
            and h.autopilot.clock.source == pb.ClockEstimate.SOURCE_TIMESYNC
            and h.state == pb.Health.STATE_ACTIVE
        ),
        PATIENCE_S,
        begun_ns,
    )
    flying.prisms.wait(lambda m: m.valid, PATIENCE_S)


def test_the_state_of_the_pipeline_is_sent_to_the_autopilot(flying: Flying) -> None:
    """MAV_STATE of our heartbeat: 4 active, 5 critical."""

    def state() -> int:
        beats = flying.line.change(lambda a: a.of_kind("HEARTBEAT"))
        return int(beats[-1].system_status) if beats else -1

    assert until(lambda: state() == 4)
    flying.live.cable.unlink()
    try:
        assert until(lambda: state() == 5)
    finally:
        flying.live.cable.touch()
    flying.well()
    assert until(lambda: state() == 4)
