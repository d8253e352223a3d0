"""The closed loop over real lines and in real time: rendered depth, the pipeline, the sender's thread, MAVLink over UDP and
over a pty, an autopilot that reads it, and a vehicle that flies as that lets it. Camera and vehicle alone are made up."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from companion.autopilot.distance_sensor import DOWNWARD
from companion.autopilot.failsafe import FENCE_SHARE, STOP_INSIDE_M
from companion.autopilot.line import line_of
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.config.avoidance import AvoidParams
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.mavlink.address import parse_address
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, PtyEnd, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState
from drivers.simulation.scenes import Scene
from drivers.simulation.source import render
from tests.ports import free_port

from .test_braking import AVOID, CAMERA, MARGIN_M, PARAMS, SENSOR, Flight, ardupilot, facade, px4, speed_after

pytestmark = pytest.mark.process

NS = 1_000_000_000
FRAME_NS = NS // 8
MOST_PAUSE_NS = 3 * NS // 10
"""Of frames and of messages with obstacles. In a longer one, which a busy machine makes, the vehicle stands still."""
LINES = pytest.mark.parametrize(("kind", "line"), [(PX4, "pty"), (ARDUPILOT, "udp")])


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """The service compiles its kernels before it sees anything; here, too, nothing may be compiled in flight, which would hold
    up the thread that sends."""
    flight = Flight(facade(), px4(), x_m=13.0)
    flight.fly(1.0)
    assert flight.x_m > 13.0


class Vehicle:
    """Wants north at 3 m/s, 1.5 m up, as its autopilot's reader lets it; it moves with each look at it.

    waits_for_frames, waits_for_output: it stands still while these do not come."""

    def __init__(self, kind: str, x_m: float) -> None:
        self.autopilot = SimulatedAutopilot(
            FirmwareProfile(kind=kind, armed=True, custom_mode=3 << 16 if kind == PX4 else 5, motion=self.state)
        )
        self.autopilot.obstacles = px4() if kind == PX4 else ardupilot()
        self.autopilot.parameters = {"CP_DIST": MARGIN_M} if kind == PX4 else {"AVOID_MARGIN": MARGIN_M}
        self.x_m, self.speed_m_s, self.fastest_m_s, self.farthest_m = x_m, 0.0, 0.0, x_m
        self.waits_for_frames = self.waits_for_output = True
        self._at_ns = self.exposed_ns = self._received_ns = time.monotonic_ns()
        self._counted = 0

    def _is_held_up(self, now_ns: int) -> bool:
        """Whether the machine is too busy for the camera or for the output."""
        if any(m.get_type().startswith("OBSTACLE") for m in self.autopilot.received[self._counted :]):
            self._received_ns = now_ns
        self._counted = len(self.autopilot.received)
        return (self.waits_for_frames and now_ns - self.exposed_ns > MOST_PAUSE_NS) or (
            self.waits_for_output and now_ns - self._received_ns > MOST_PAUSE_NS
        )

    def state(self, now_ns: int) -> VehicleState:
        held_up = self._is_held_up(now_ns)
        if held_up:
            self._at_ns = now_ns
        while self._at_ns < now_ns:
            step_ns = min(20_000_000, now_ns - self._at_ns)
            self._at_ns += step_ns
            self.speed_m_s = speed_after(self.autopilot.obstacles, self.speed_m_s, self._at_ns, step_ns / NS)
            self.x_m += self.speed_m_s * step_ns / NS
        self.fastest_m_s, self.farthest_m = max(self.fastest_m_s, self.speed_m_s), max(self.farthest_m, self.x_m)
        return VehicleState(
            position_ned_m=(self.x_m, 0.0, -1.5),
            velocity_ned_m_s=(0.0 if held_up else self.speed_m_s, 0.0, 0.0),
            euler_rad=(0.0, 0.0, 0.0),
            rates_frd_rad_s=(0.0, 0.0, 0.0),
        )


class Companion:
    """What the service has, without its processes: link, pipeline, obstacle output."""

    def __init__(self, address: str, avoid: AvoidParams = AVOID) -> None:
        self.waiting: deque[AttitudeSample | PoseSample] = deque()
        session = MavlinkSession(on_message=lambda message, t_ns: self.obstacle_output.message(message, t_ns))
        self.link = MavlinkLink(parse_address(address), session, self._samples)
        self.obstacle_output = ObstacleOutput(
            avoid,
            CameraUse(cameras=("front",), timeout_s=0.3),
            line_of(session, self.link),
        )
        self.obstacle_output.announce(CAMERA)
        self._pipeline = Pipeline((CAMERA,), lambda info: Extractor(PARAMS))
        self.frames = 0

    def _samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        self.waiting.extend(samples)
        self.obstacle_output.samples(samples)

    def see(self, scene: Scene, state: VehicleState, t_ns: int) -> None:
        """A frame that was exposed at t_ns."""
        self.frames += 1
        seen = render(scene, CAMERA, position_ned_m=state.position_ned_m, sensor=SENSOR, seed=7, frame=self.frames)
        while self.waiting:
            self._pipeline.handle(self.waiting.popleft())
        frame = DepthFrame(
            camera="front",
            sequence=self.frames,
            t_exposure_ns=t_ns,
            t_arrival_ns=time.monotonic_ns(),
            depth_mm=seen.depth_mm,
        )
        for output in self._pipeline.handle(frame):
            if isinstance(output, PrismsResult):
                self.obstacle_output.result(output)


@contextmanager
def flying(
    kind: str, line: str, x_m: float, avoid: AvoidParams = AVOID
) -> Iterator[tuple[Vehicle, Companion, AutopilotLink]]:
    vehicle = Vehicle(kind, x_m)
    if line == "udp":
        port = free_port()
        end: UdpEnd | PtyEnd = UdpEnd("127.0.0.1", port)
        address = f"udpin:127.0.0.1:{port}"
    else:
        end = PtyEnd()
        address = f"serial:{end.device}"
    with AutopilotLink(vehicle.autopilot, end) as running:
        companion = Companion(address, avoid)
        companion.link.open()
        companion.obstacle_output.open()
        try:
            yield vehicle, companion, running
        finally:
            companion.obstacle_output.close()
            companion.link.close()


def fly(
    scene: Scene,
    kind: str,
    line: str,
    x_m: float,
    stands_beyond_m: float,
    dies_at_m: float = 99.0,
) -> Vehicle:
    """Until it stands for half a second beyond some place."""
    with flying(kind, line, x_m) as (vehicle, companion, running):
        fly_on(scene, vehicle, companion, running, stands_beyond_m, dies_at_m)
    return vehicle


def fly_on(
    scene: Scene,
    vehicle: Vehicle,
    companion: Companion,
    running: AutopilotLink,
    stands_beyond_m: float,
    dies_at_m: float = 99.0,
) -> None:
    """A machine that is busy makes it stand blind before; a minute is enough for that, too."""
    end_ns = time.monotonic_ns() + 60 * NS
    stands_since_ns = None
    while time.monotonic_ns() < end_ns:
        t_ns = time.monotonic_ns()
        state: VehicleState = running.change(lambda a, t_ns=t_ns: vehicle.state(t_ns))
        companion.obstacle_output.tick(t_ns)
        if state.position_ned_m[0] < dies_at_m:
            vehicle.exposed_ns = t_ns
            companion.see(scene, state, t_ns)
        else:
            end_camera(vehicle)
        still = vehicle.x_m > stands_beyond_m and vehicle.fastest_m_s > 1.0 and abs(vehicle.speed_m_s) < 0.05
        stands_since_ns = (stands_since_ns or t_ns) if still else None
        if stands_since_ns is not None and t_ns - stands_since_ns > NS // 2:
            return
        time.sleep(max(0.0, (t_ns + FRAME_NS - time.monotonic_ns()) / NS))


def end_camera(vehicle: Vehicle) -> None:
    """No frame comes any more, and nothing to PX4 after a time: it flies as its autopilot lets it."""
    vehicle.waits_for_frames = False
    vehicle.waits_for_output = vehicle.autopilot.profile.kind == ARDUPILOT


def test_px4_stops_before_the_wall() -> None:
    vehicle = fly(facade(), PX4, "udp", 13.5, stands_beyond_m=20.0 - MARGIN_M - 2.5)
    assert vehicle.fastest_m_s > 1.0
    assert vehicle.farthest_m <= 20.0 - MARGIN_M + 0.1
    assert vehicle.x_m > 20.0 - MARGIN_M - 2.5
    assert abs(vehicle.speed_m_s) < 0.1


@LINES
def test_it_stops_when_the_camera_process_ends(kind: str, line: str) -> None:
    """ArduPilot may settle before the wall of the policy, which moves along: it creeps at most."""
    vehicle = fly(facade(), kind, line, 5.0, stands_beyond_m=7.0, dies_at_m=8.0)
    assert vehicle.fastest_m_s > 1.0
    assert 7.0 < vehicle.farthest_m < 13.5
    assert abs(vehicle.speed_m_s) < 0.1


def test_ardupilot_stops_before_a_wall_of_points_and_receives_the_ground_distance() -> None:
    """OBSTACLE_DISTANCE_3D in the place of OBSTACLE_DISTANCE, and DISTANCE_SENSOR downward; then the camera dies."""
    avoid = replace(AVOID, points=True, upward=True, downward=True)
    with flying(ARDUPILOT, "udp", 13.5, avoid) as (vehicle, companion, running):
        fly_on(facade(), vehicle, companion, running, stands_beyond_m=20.0 - MARGIN_M - 2.5)
        assert 20.0 - MARGIN_M - 2.5 < vehicle.farthest_m <= 20.0 - MARGIN_M + 0.1
        sent = running.change(lambda a: list(a.received))
        kinds = {m.get_type() for m in sent}
        assert "OBSTACLE_DISTANCE_3D" in kinds
        assert "OBSTACLE_DISTANCE" not in kinds
        found = companion.obstacle_output.diagnostics(time.monotonic_ns())
        assert "obstacles_not_accepted" not in [d.code for d in found]  # its echoes are those of OBSTACLE_DISTANCE
        down = [m.current_distance for m in sent if m.get_type() == "DISTANCE_SENSOR" and m.orientation == DOWNWARD]
        assert down
        assert all(abs(cm - 150) < 25 for cm in down)
        end_camera(vehicle)
        blind_ns = time.monotonic_ns() + NS
        while time.monotonic_ns() < blind_ns:  # no frame for a second
            running.change(lambda a: vehicle.state(time.monotonic_ns()))
            time.sleep(0.02)
        faces = running.change(lambda a: a.obstacles.faces_m(time.monotonic_ns()))
        wall_m = (MARGIN_M - STOP_INSIDE_M) / FENCE_SHARE
        assert 0.0 < faces[0] <= wall_m + 0.01
        assert running.change(lambda a: a.heights.down_m(time.monotonic_ns())) is None
