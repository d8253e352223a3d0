"""The service as a process with other senders on its link: the output to the autopilot stays safe in content and
timing.

With ArduPilot, which would fly on without the wall. With both kinds of autopilot, on real links without the processes:
tests/companion/autopilot/test_fault_table.py; parameters: test_avoidance.py."""

from __future__ import annotations

import os
import random
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from drivers.mavlink.dialect import dialect
from drivers.simulation.autopilot import ARDUPILOT, AUTOPILOT_IDS, PX4
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import NS, Live, flown
from .test_service_avoids import CONFIG, FRONT, AvoidingService

pytestmark = [pytest.mark.process, pytest.mark.realtime]

WALL_CM = 266
"""Distance sent by the policy `stop` with an AVOID_MARGIN of 2.5 m."""


@pytest.fixture(scope="module")
def avoiding(tmp_path_factory: pytest.TempPathFactory, renders: Path) -> Iterator[AvoidingService]:
    sections = CONFIG.replace("restart_s = 1.5", "restart_s = 20.0")  # `blind_after` ends the camera process earlier
    sections = sections.replace(
        "[avoid]", "system_id = 1\n\n[avoid]"
    )  # without it a second vehicle makes the cameras blind
    live = Live(tmp_path_factory.mktemp("conflicts"), sections, renders, quick=True)
    with flown(live, ARDUPILOT) as line:
        avoiding = AvoidingService(live, line, ARDUPILOT)
        avoiding.correct_parameters()
        try:
            live.start()
            assert until(avoiding.has_obstacles), live.output()
            avoiding.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)
            yield avoiding
            assert line.change(lambda a: a.of_kind("PARAM_SET")) == []
            assert live.stop() == 0
        finally:
            live.close()


def packed(m: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(m.pack(dialect.MAVLink(None, system, component)))


@contextmanager
def sending(avoiding: AvoidingService, messages: Callable[[int], list[bytes]]) -> Iterator[list[bytes]]:
    """Sends messages(k) to the service's port from another address, a hundred times a second. Yields what the service sends
    to that address."""
    stop = threading.Event()
    answers: list[bytes] = []

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            k = 0
            while not stop.wait(0.01):
                with suppress(BlockingIOError):
                    while True:
                        answers.append(sender.recv(2048))
                for data in messages(k):
                    sender.sendto(data, ("127.0.0.1", avoiding.live.port))
                k += 1

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield answers
    finally:
        stop.set()
        thread.join()


def noise_and_other_senders(k: int) -> list[bytes]:
    """Random bytes, messages with a flipped bit, of another vehicle, and answers to requests that were not sent."""
    rng = random.Random(k)
    other = {0: 12, 1: 3}[k % 2]
    attitude = dialect.MAVLink_attitude_message(k, 1.5, 0.5, 0.0, 0.0, 0.0, 0.0)
    broken = bytearray(packed(attitude))
    broken[rng.randrange(10, len(broken))] ^= 1 << rng.randrange(8)
    return [
        rng.randbytes(rng.randrange(1, 60)),
        b"\xfd\xff\x00\x00",
        bytes(broken),
        packed(dialect.MAVLink_heartbeat_message(2, other, 128, 0, 4, 3), system=7),
        packed(attitude, system=7),
        packed(attitude, component=100),
        packed(dialect.MAVLink_timesync_message(10**15 + k, 10**12 + k)),
    ]


def blind_after(avoiding: AvoidingService, seconds: float) -> tuple[int, list[tuple[float, list[int]]]]:
    """Stops the camera process for this time, less than its restart takes, and ends it. Returns the instant of the stop, and
    (seconds after it, values ahead) of the messages decided on later than 0.4 s after the stop, which is later than any
    exposure."""
    camera = avoiding.live.camera_pids()["front"]
    os.kill(camera, signal.SIGSTOP)  # its end is not reported
    stopped_ns = time.monotonic_ns()
    end_ns = stopped_ns + round(seconds * NS)
    assert until(lambda: time.monotonic_ns() > end_ns)
    late = [
        ((t - stopped_ns) / NS, [values[i] for i in FRONT])
        for t, values in avoiding.decisions()
        if stopped_ns + 400_000_000 < t < end_ns
    ]
    os.kill(camera, signal.SIGKILL)  # another one is started at once
    return stopped_ns, late


def decisions_ns(avoiding: AvoidingService, answers: list[bytes]) -> list[int]:
    """Instants at which the values of all messages were decided, also of those that went to the other sender's address."""
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    others = [m for data in list(answers) for m in parser.parse_buffer(data) or []]
    messages = [m for m in others if m.get_type() == "OBSTACLE_DISTANCE"]
    messages += avoiding.line.change(lambda a: a.of_kind("OBSTACLE_DISTANCE"))
    return [1000 * m.time_usec for m in messages]


def test_noise_and_other_senders_do_not_change_what_the_autopilot_receives(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles), avoiding.live.output()
    with sending(avoiding, noise_and_other_senders):
        assert avoiding.steadily()
        assert until(avoiding.has_obstacles)
        _, late = blind_after(avoiding, 1.0)
        assert late
        assert [x for x in late if not set(x[1]) <= {WALL_CM}] == []
        least = {"other_vehicle": 100, "timesync_unpaired": 100, "noise_bytes": 1000}
        avoiding.health.wait(lambda h: all(h.autopilot.counts[name] > n for name, n in least.items()), PATIENCE_S)
    assert until(avoiding.has_obstacles), avoiding.live.output()


def test_a_forged_kind_of_autopilot_causes_no_silence_and_no_clear_sector(avoiding: AvoidingService) -> None:
    """The vehicle would fly on with the policy of PX4. While the kind is ambiguous, the wall that stops both is sent."""
    assert until(avoiding.has_obstacles), avoiding.live.output()
    assert until(avoiding.has_read_the_margin)
    beat = packed(dialect.MAVLink_heartbeat_message(2, AUTOPILOT_IDS[PX4], 0, 0, 4, 3))
    with sending(avoiding, lambda k: [beat]) as answers:
        avoiding.health.wait(lambda h: any("contradictory heartbeats" in t for t in h.troubles), PATIENCE_S)
        assert until(avoiding.has_obstacles)
        stopped_ns, late = blind_after(avoiding, 3.5)
        # no silence: that of PX4's policy would begin after 2 s
        begin_ns, end_ns = stopped_ns + round(2.5 * NS), stopped_ns + round(3.5 * NS)
        # on a busy machine the service answers the other address for a while
        assert until(lambda: any(begin_ns < t < end_ns for t in decisions_ns(avoiding, answers)))
        # its margin was read before and still counts
        assert {v for _, values in late for v in values} == {WALL_CM}
    # sent once, to the address that the newest message of the autopilot came from: the forger's or the autopilot's
    text = "OA: contradictory heartbeats"
    assert until(lambda: text in avoiding.texts() or any(text.encode() in data for data in answers))
    assert until(avoiding.has_obstacles), avoiding.live.output()
    avoiding.health.wait(lambda h: not any("contradict" in t for t in h.troubles), PATIENCE_S)


def test_a_second_companion_is_reported_and_obstacles_are_still_sent(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles), avoiding.live.output()
    clear = packed(
        dialect.MAVLink_obstacle_distance_message(0, 4, [1201] * 72, 5, 20, 1200, 5.0, 0.0, 12), component=197
    )
    with sending(avoiding, lambda k: [clear] if k % 10 == 0 else []):
        text = "component 197 sends obstacles too"
        # degraded by it; on a busy machine a report may be of a moment without a fresh frame
        avoiding.health.wait(
            lambda h: h.state == pb.Health.STATE_DEGRADED and any(text in t for t in h.troubles), PATIENCE_S
        )
        assert until(lambda: "OA: component 197 sends obstacles too" in avoiding.texts())
        begun_ns = time.monotonic_ns()
        assert until(lambda: len([t for t, _ in avoiding.messages() if t > begun_ns]) > 20)
        assert until(avoiding.has_obstacles)


def test_forged_parameters_do_not_move_the_wall(avoiding: AvoidingService) -> None:
    """Nearer than AVOID_MARGIN the vehicle would fly backwards."""
    assert until(avoiding.has_obstacles), avoiding.live.output()
    assert until(avoiding.has_read_the_margin)
    values = [packed(dialect.MAVLink_param_value_message(b"AVOID_MARGIN", v, 9, 1, 0)) for v in (20.0, 0.5)]
    with sending(avoiding, lambda k: values if k % 10 == 0 else []):
        begun_ns = time.monotonic_ns()
        assert until(lambda: time.monotonic_ns() > begun_ns + 3 * NS)
        _, late = blind_after(avoiding, 1.0)
        assert late
        assert {v for _, ahead in late for v in ahead} == {WALL_CM}
        avoiding.health.wait(lambda h: any("AVOID_MARGIN is received as" in t for t in h.troubles), PATIENCE_S)
    assert until(avoiding.has_obstacles), avoiding.live.output()
