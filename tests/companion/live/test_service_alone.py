"""The service without a camera or an autopilot and with many subscribers, with one camera of two, and after kill -9."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from companion.replay.replay import Options, replay
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import NS, Live, attitude_error_deg, flown, sent_ns

pytestmark = pytest.mark.process

CAMERA = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 15.0
device = "{cable}"
"""
RIGHT = """
[[camera]]
name = "right"
kind = "simulated"
flight = "street"
width_px = 160
fps = 15.0
yaw_deg = 90.0
required = false
"""
AUTOPILOT = """
[autopilot]
address = "udpin:127.0.0.1:{port}"
"""
QUICK = """
[supervision]
first_backoff_s = 0.1
longest_backoff_s = 0.5
"""
NO_LOG = """
[record]
record = "off"
"""


@contextmanager
def service(folder: Path, sections: str, renders: Path) -> Iterator[Live]:
    live = Live(folder, sections, renders)
    try:
        yield live
    finally:
        live.close()


def hold_connections(address: Path, number: int, open_ones: ExitStack) -> None:
    """Connects so many sockets to a stream, and waits until the service has accepted each: ZeroMQ then sends its greeting."""
    connections = [open_ones.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(number)]
    for connection in connections:
        connection.connect(str(address))  # without a limit: with one, a queue of connections that is full is an error
        connection.settimeout(PATIENCE_S)
    assert all(connection.recv(1) == b"\xff" for connection in connections)


def test_without_camera_and_autopilot_it_runs_and_reports_both(tmp_path: Path, renders: Path) -> None:
    """Both are connected later; no fault is reported then. Nor do more subscribers than files may be open usually end it: libzmq
    aborts a process that cannot accept a connection because too many files are open."""
    with service(tmp_path, CAMERA + AUTOPILOT + QUICK + NO_LOG, renders) as live:
        live.cable.unlink()
        prisms, health = live.subscribe("prisms", pb.PrismsFrame), live.subscribe("health", pb.Health)
        live.start("/bin/sh", "-c", 'ulimit -Sn 200; exec "$@"', "sh")
        assert until(lambda: "INFO ready" in live.output())
        begun_ns = time.monotonic_ns()
        silent = f"no heartbeat of an autopilot on udpin:127.0.0.1:{live.port}"
        report = health.wait(  # the link may be opened after the first report
            lambda h: "unplugged" in " ".join(h.troubles) and any(silent in t for t in h.troubles), PATIENCE_S
        )
        assert report.state == pb.Health.STATE_BLIND
        assert any("camera front is blind" in t for t in report.troubles)
        assert until(lambda: len(prisms.since(begun_ns)) >= 20)
        assert not any(m.valid for m in prisms.since(0))
        assert all(m.camera == "front" and m.cause == pb.CAUSE_CAMERA for m in prisms.since(begun_ns))
        status = live.command("status", "-c", str(live.config))
        assert status.returncode == 1
        assert status.stdout.startswith("BLIND")
        assert "autopilot: no heartbeat" in status.stdout
        live.cable.touch()
        with flown(live), ExitStack() as open_ones:
            hold_connections(tmp_path / "run" / "prisms", 400, open_ones)
            prisms.wait(lambda m: m.valid, PATIENCE_S)
            health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)
            assert live.stop(signal.SIGINT) == 0


def test_two_cameras_fail_independently_and_only_the_required_one_makes_the_service_blind(
    tmp_path: Path, renders: Path
) -> None:
    with service(tmp_path, CAMERA + RIGHT + AUTOPILOT + QUICK + NO_LOG, renders) as live, flown(live):
        prisms, health = live.subscribe("prisms", pb.PrismsFrame), live.subscribe("health", pb.Health)
        surround = live.subscribe("surround", pb.SurroundFrame)
        live.start()
        health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE, PATIENCE_S)
        surround.wait(lambda m: m.valid and all(c.valid for c in m.cameras), PATIENCE_S)

        begun_ns = time.monotonic_ns()
        right = live.camera_pids()["right"]
        os.kill(right, signal.SIGSTOP)
        health.wait(
            lambda h: "camera right (not required) is blind: camera process silent" in " ".join(h.troubles), PATIENCE_S
        )
        # on a busy machine the required camera may be blind for a moment, too
        blind = [" ".join(h.troubles) for h in health.since(begun_ns) if h.state == pb.Health.STATE_BLIND]
        assert all("camera front is blind" in text for text in blind), blind
        health.wait(lambda h: h.state == pb.Health.STATE_DEGRADED, PATIENCE_S)
        prisms.wait(lambda m: m.camera == "right" and not m.valid, PATIENCE_S)
        partly = surround.wait(lambda m: [c.valid for c in m.cameras] == [True, False], PATIENCE_S)
        assert partly.valid
        dark_ns = time.monotonic_ns()
        assert until(lambda: sum(m.camera == "front" and m.valid for m in prisms.since(dark_ns)) > 12)
        assert not any(m.valid for m in prisms.since(dark_ns) if m.camera == "right")

        live.cable.unlink()
        report = health.wait(lambda h: h.state == pb.Health.STATE_BLIND, PATIENCE_S)
        assert "camera front is blind" in report.troubles[0]
        assert not surround.wait(lambda m: not m.valid, PATIENCE_S).cameras[0].valid
        live.cable.touch()
        health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE, PATIENCE_S)
        assert live.stop() == 0


def test_each_failure_in_a_flight_is_reported(tmp_path: Path, renders: Path) -> None:
    """The flight `broken`: blind pixels, a frozen image, no attitude, no frames, on the way there and back. What the
    autopilot receives while the newest good exposure is older than 0.4 s is nothing but unknown."""
    avoid = "\n[avoid]\nsend = true\nremember_s = 0.0\n"
    sections = CAMERA.replace('"street"', '"broken"') + AUTOPILOT + QUICK + NO_LOG + avoid
    with service(tmp_path, sections, renders) as live, flown(live) as line:
        prisms = live.subscribe("prisms", pb.PrismsFrame)
        live.start()
        prisms.wait(lambda m: m.valid, PATIENCE_S)
        begun_ns = time.monotonic_ns()
        for cause in ("too few pixels hold a measurement", "frozen: the same image", "attitude is too old"):
            prisms.wait(lambda m, cause=cause: not m.valid and cause in m.cause_text, PATIENCE_S, begun_ns)
        flight = live.flight()
        valid = [m for m in prisms.since(begun_ns) if m.valid]
        assert max(attitude_error_deg(m, flight) for m in valid) < 1.0
        lost = [m for m in valid if any(a <= flight.on_path(m.t_exposure_ns)[0] / NS < b for a, b in ((1.05, 1.75),))]
        assert not lost  # nothing but unknown pixels was in view

        def late() -> list[set[int]]:
            sent = line.change(
                lambda a: [(1000 * m.time_usec, set(m.distances)) for m in a.of_kind("OBSTACLE_DISTANCE")]
            )
            # the frames before it have arrived here, too
            assert until(lambda: not sent or sent_ns(prisms.received[-1][1]) > sent[-1][0])
            seen_ns = [m.t_exposure_ns for m in prisms.since(begun_ns) if m.valid]
            return [v for t, v in sent if t > seen_ns[0] and not any(0 <= t - s <= 4 * NS // 10 for s in seen_ns)]

        # four faults on the way, each longer than that; where on it we began to look decides how soon it is enough
        assert until(lambda: len(late()) > 5)
        assert [values for values in late() if values != {65535}] == []
        assert live.stop() == 0


def test_after_kill_9_the_next_start_repairs_the_log(tmp_path: Path, renders: Path) -> None:
    with service(tmp_path, CAMERA + AUTOPILOT, renders) as live, flown(live):
        prisms = live.subscribe("prisms", pb.PrismsFrame)
        live.start()
        prisms.wait(lambda m: m.valid, PATIENCE_S)
        begun_ns = time.monotonic_ns()
        assert until(lambda: sum(m.valid for m in prisms.since(begun_ns)) > 45)
        live.kill()
        (left,) = live.logs
        assert left.name.endswith(".mcap.active")
        killed_ns = time.monotonic_ns()
        live.start()
        prisms.wait(lambda m: m.valid, PATIENCE_S, killed_ns)
        assert until(lambda: not left.exists(), 600.0)  # the repair has the lowest priority
        assert live.stop() == 0
        first, second = live.logs
        assert first.name == left.name.removesuffix(".active")
        for log in (first, second):
            check = replay(log, Options(check=True)).comparison
            assert check is not None
            assert check.passed, check
            assert check.compared > 0
        with McapRecording(first) as recording:
            assert sum(1 for _ in recording.messages("decision")) > 30
