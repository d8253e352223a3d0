"""The guard in the service as a process: a simulated autopilot flies a mission over UDP, and the service is killed in each state."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.autopilot.auto_flight import (
    COPTER_AUTO,
    PX4_HOLD,
    PX4_MISSION,
    AutoFlight,
    CopterAutoFlight,
    Px4AutoFlight,
)
from drivers.mavlink.commands import COPTER_BRAKE, COPTER_LOITER, DO_CHANGE_SPEED, DO_SET_MODE
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port
from tests.waiting import until

from ..live_service import Live, unread_output

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "demo"
width_px = 160
fps = 15.0
device = "{cable}"
follow = "udpin:127.0.0.1:CAMERA_PORT"

[autopilot]
address = "udpin:127.0.0.1:{port}"

[avoid]
send = true

[guard]
enabled = true

[record]
record = "off"
"""
WALL_M = 27.6
"""From the origin, straight north."""
START_M = 19.0
"""Where the vehicle waits for the guard: as far before the wall that it watches, and near, so that the flights are short."""


class TwoPeers:
    """One socket of the autopilot that sends to the service and to the simulated camera."""

    def __init__(self, ports: tuple[int, int]) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._ports = ports

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            return self._socket.recv(65_536)
        except (BlockingIOError, ConnectionRefusedError):
            return b""

    def write(self, data: bytes) -> None:
        for port in self._ports:
            try:
                self._socket.sendto(data, ("127.0.0.1", port))
            except (BlockingIOError, ConnectionRefusedError):
                continue

    def close(self) -> None:
        self._socket.close()


class Guarded:
    """A service, the autopilot and its flight towards a wall."""

    def __init__(self, live: Live, line: AutopilotLink, flight: AutoFlight) -> None:
        self.live, self.line, self.flight = live, line, flight
        self._mission = flight.mode

    def memory(self) -> dict[str, Any]:
        """In the state folder; empty: there is none yet."""
        try:
            content: dict[str, Any] = json.loads((self.live.folder / "state" / "guard.json").read_text())["memory"]
            return content
        except (OSError, ValueError):
            return {}

    def state(self) -> str:
        return str(self.memory().get("state", ""))

    def comes_to(self, *states: str) -> bool:
        return until(lambda: self.state() in states)

    def ready(self) -> None:
        """Waits until the guard watches a vehicle that stands in its mission. On a busy machine the first frames are so old that
        the guard stops the vehicle: then the pilot selects the mission again, and the guard must have seen the path since."""

        def reached() -> bool:
            if self.state() == "holding":
                self.do(lambda: self.flight.enter(self._mission))
            memory = self.memory()
            return memory.get("state") in ("watching", "limited") and not memory["blind_stop"]

        assert until(reached), self.live.output()

    def go(self) -> None:
        """The mission begins when the guard is ready."""
        self.ready()
        self.fly()

    def fly(self) -> None:
        """The mission gets its waypoint behind the wall."""

        def act(autopilot: SimulatedAutopilot) -> None:
            self.flight.waypoints_m = np.array([[WALL_M + 20.0, 0.0]])

        self.line.change(act)

    def kill_and_put_back(self) -> None:
        """Kills the service. The vehicle then stands at the start without a waypoint, since starts take their time."""
        self.live.kill()

        def act(autopilot: SimulatedAutopilot) -> None:
            self.flight.position_m, self.flight.velocity_m_s = np.array([START_M, 0.0]), np.zeros(2)
            self.flight.waypoints_m = np.zeros((0, 2))

        self.line.change(act)

    def do(self, act: Callable[[], None]) -> None:
        self.line.change(lambda _: act())

    def commands(self, *numbers: int) -> list[Any]:
        found: list[Any] = self.line.change(lambda a: [m for m in a.of_kind("COMMAND_LONG") if m.command in numbers])
        return found

    def texts(self) -> list[str]:
        return [m.text for m in self.line.change(lambda a: a.of_kind("STATUSTEXT"))]

    def distance_m(self) -> float:
        return WALL_M - float(self.flight.position_m[0])


@contextmanager
def guarded(
    folder: Path,
    renders: Path,
    kind: str,
    speed_m_s: float,
    before: tuple[str, ...] = (),
) -> Iterator[Guarded]:
    """before: see `Live.start`."""
    camera_port = free_port()
    live = Live(folder, CONFIG.replace("CAMERA_PORT", str(camera_port)), renders)
    start = np.array([START_M, 0.0])
    nowhere = np.zeros((0, 2))
    flight: AutoFlight = (
        Px4AutoFlight(nowhere, 2.5, speed_m_s, PX4_MISSION, start)
        if kind == PX4
        else CopterAutoFlight(nowhere, 2.5, speed_m_s, COPTER_AUTO, start)
    )
    autopilot = SimulatedAutopilot(
        FirmwareProfile(kind=kind, armed=True, flight=flight, boot_at_ns=time.monotonic_ns())
    )
    try:
        with AutopilotLink(autopilot, TwoPeers((live.port, camera_port))) as line:  # type: ignore[arg-type]
            live.start(*before)
            yield Guarded(live, line, flight)
    finally:
        live.close()


def test_px4_stops_before_the_wall_while_the_output_of_the_service_is_not_read(tmp_path: Path, renders: Path) -> None:
    with unread_output(tmp_path) as before, guarded(tmp_path, renders, PX4, 1.5, before) as g:
        g.go()
        assert g.comes_to("holding")
        assert g.flight.mode == PX4_HOLD
        assert g.distance_m() > 1.0
        assert {m.target_system for m in g.commands(DO_SET_MODE, DO_CHANGE_SPEED)} == {1}
        assert until(lambda: any("guard: stopped" in text for text in g.texts()))
        assert any("guard: stop, " in text for text in g.texts())
        assert g.live.stop() == 0


def test_ardupilot_is_stopped_and_held_by_a_service_that_is_killed_while_stopping_holding_and_watching(
    tmp_path: Path, renders: Path
) -> None:
    with guarded(tmp_path, renders, ARDUPILOT, 1.0) as g:
        # stopping: the first command has no effect
        g.ready()
        g.do(lambda: setattr(g.flight, "stubborn", True))
        g.fly()
        assert g.comes_to("stopping"), g.live.output()
        assert g.distance_m() > 1.0
        g.kill_and_put_back()
        before = len(g.commands(DO_SET_MODE))
        g.do(lambda: setattr(g.flight, "stubborn", False))
        g.live.start()
        assert g.comes_to("holding", "watching", "limited"), g.live.output()
        if g.state() != "holding":  # a slow start: the stop is over, and the vehicle goes on
            g.go()
        assert g.comes_to("holding"), g.live.output()
        assert g.flight.mode == COPTER_BRAKE
        assert len(g.commands(DO_SET_MODE)) > before
        assert {m.target_system for m in g.commands(DO_SET_MODE, DO_CHANGE_SPEED)} == {1}
        assert until(lambda: any("guard: stopped" in text for text in g.texts()))
        # holding
        g.kill_and_put_back()
        before = len(g.commands(DO_SET_MODE))
        killed_ns = time.monotonic_ns()
        g.live.start()
        # after what was on its way when it was killed
        assert until(lambda: g.line.autopilot.obstacle_times_ns[-1] > killed_ns + 500_000_000), g.live.output()
        assert g.state() == "holding"
        g.do(lambda: g.flight.enter(COPTER_LOITER))
        assert g.comes_to("inactive"), g.live.output()
        assert len(g.commands(DO_SET_MODE)) == before
        assert until(lambda: any("released" in text for text in g.texts()))
        # watching: the restarted service does not see yet, and the vehicle flies
        g.do(lambda: g.flight.enter(COPTER_AUTO))
        g.ready()
        g.kill_and_put_back()
        away = np.array([[-500.0, 0.0]])  # from the wall: starts take their time
        g.do(lambda: setattr(g.flight, "waypoints_m", away))
        assert until(lambda: g.flight.speed_m_s > 0.9)
        g.live.start()
        assert g.comes_to("holding"), g.live.output()
        assert g.flight.mode == COPTER_BRAKE
        assert g.flight.position_m[0] < START_M
