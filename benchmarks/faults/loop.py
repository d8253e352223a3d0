"""A flight in simulated time: the field, the vehicle, its autopilot, the line, the camera, and the service.

Two clocks run: the true time, by which the vehicle and its autopilot live, and CLOCK_MONOTONIC of the companion computer, which
stands still while the computer is suspended, and is corrected by a time daemon."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.config.avoidance import AvoidParams
from core.frames import rotation_frd_optical
from core.types import CameraInfo, CameraMount, DepthFrame
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session_types import ARDUPILOT
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState
from drivers.simulation.ray_caster import cast_rays
from drivers.simulation.sensor_model import TYPICAL, measure
from drivers.simulation.source import camera_info

from .field import Field
from .service import Service
from .switches import MS, NS, Fault, Switches, switches_at

STEP_NS = 5 * MS
FRAME_NS = NS // 15
FRAME_LATE_NS = 50 * MS
LINE_NS = 3 * MS
START_NS = 1000 * NS
RESTART_NS = NS
"""From the end of the service to its next start."""
OBSTACLE_DISTANCE, ATTITUDE, ATTITUDE_QUATERNION, TIMESYNC = 330, 30, 31, 111
SECOND_BOOT_NS = 700 * NS
"""The second autopilot was started this long before it appears on the line."""

Sent = Callable[["FaultLoop", list[int]], None]


@dataclass(slots=True)
class Estimate:
    """How the estimate of the autopilot differs from the truth. tilt_rad: roll and pitch."""

    heading_rad: float = 0.0
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(slots=True)
class Evidence:
    """True instants of the newest correct evidence that reached the service, ns of the flight; -1: none.

    Attributes:
        frame_ns: of each camera, exposure of the newest complete, new, correctly stamped image.
        left_ns: the same for images whose left part was not covered.
        attitude_ns: measurement of the newest correct attitude."""

    frame_ns: list[int]
    left_ns: list[int]
    attitude_ns: int = -1


class _OnLine(NamedTuple):
    """A message on its way from the autopilot."""

    arrival_ns: int  # of the flight
    number: int  # order of the messages
    data: bytes
    measured_ns: int  # of a correct attitude, ns of the flight; -1: it is none


def cameras_of(seed: int) -> tuple[CameraInfo, ...]:
    """The cameras of a flight: one that looks ahead, and in every third flight a second one that looks to the right and overlaps
    its view, or does not. In every ninth flight both look ahead, one up and one down, and see the height band together."""
    front = camera_info(160, 120, max_range_m=20.0)
    if seed % 9 == 3:
        up, down = (replace(front.mount, pitch_rad=math.radians(pitch_deg)) for pitch_deg in (22.0, -22.0))
        return replace(front, mount=up), replace(front, camera="down", mount=down)
    if seed % 3:
        return (front,)
    mount = CameraMount(yaw_rad=math.radians(60.0 if seed % 2 else 85.0), x_m=0.1, y_m=0.15, z_m=-0.05)
    return front, replace(front, camera="right", mount=mount)


class FaultLoop:
    """`fly` runs the flight. on_sent: called with the 72 values of each OBSTACLE_DISTANCE when it leaves the service. service:
    makes a run of it. cameras: others than those of the seed."""

    def __init__(
        self,
        field: Field,
        kind: str,
        seed: int,
        faults: list[Fault],
        on_sent: Sent,
        avoid: AvoidParams | None = None,
        service: Callable[[Sequence[CameraInfo], AvoidParams], Service] = Service,
        cameras: tuple[CameraInfo, ...] = (),
    ) -> None:
        self.field, self.kind, self.faults, self.avoid = field, kind, faults, avoid or AvoidParams(send=True)
        self.cameras = cameras or cameras_of(seed)
        self.flown_ns, self.mono_ns = 0, START_NS
        self.estimate, self.evidence, self.switches = Estimate(), self._no_evidence(), Switches()
        self.began_ns = 0
        self._sensor = TYPICAL.scaled_to(160)
        self._rng, self._seed, self._on_sent = np.random.default_rng([6, seed]), seed, on_sent
        self._make_service = service
        self.service: Service | None = service(self.cameras, self.avoid)
        parameters = {"AVOID_MARGIN": 2.0, "PRX1_TYPE": 2.0} if kind == ARDUPILOT else {"CP_DIST": 3.0}
        self.autopilot = self._autopilot(1, -40 * NS)
        self.autopilot.parameters = dict(parameters)
        self._second: SimulatedAutopilot | None = None
        self._line: list[_OnLine] = []
        self._numbers = itertools.count()
        self._later: list[tuple[int, int, Callable[[], None]]] = []
        self._splitter, self._sent_splitter = MessageSplitter(), MessageSplitter()
        self._pack = dialect.MAVLink(None, 1, 1)
        self._attitude_bytes: dict[int, bytes] = {}
        self._images: list[deque[NDArray[np.uint16]]] = [deque(maxlen=16) for _ in self.cameras]
        self._repeating: list[list[NDArray[np.uint16]]] = [[] for _ in self.cameras]
        self._newest: dict[str, DepthFrame] = {}
        self._frames = self._next_frame_ns = self._silent_until_ns = 0
        self._waiting = sorted(faults, key=lambda fault: fault.begin_ns)

    def _autopilot(self, system_id: int, boot_at_ns: int) -> SimulatedAutopilot:
        profile = FirmwareProfile(
            kind=self.kind, system_id=system_id, boot_at_ns=boot_at_ns, drift=30e-6, armed=True, motion=self._estimated
        )
        if self.kind == ARDUPILOT:
            profile.streams = {ATTITUDE: 50.0, 32: 20.0}
        return SimulatedAutopilot(profile)

    # ---- events, by name -----------------------------------------------------------------------------------------------

    def reset_heading(self) -> None:
        """The estimate of the heading jumps."""
        self.estimate.heading_rad += float(self._rng.choice([-1.0, 1.0]) * self._rng.uniform(0.05, 3.0))

    def reset_position(self) -> None:
        """The estimate of the position jumps."""
        x, y, z = np.add(self.estimate.shift_m, self._rng.uniform(-8.0, 8.0, 3)).tolist()
        self.estimate.shift_m = (x, y, z)

    def change_estimator(self) -> None:
        """Another estimator is used: attitude and position jump."""
        self.reset_heading()
        self.reset_position()
        roll, pitch = self._rng.uniform(-0.02, 0.02, 2).tolist()
        self.estimate.tilt_rad = (roll, pitch)

    def reboot(self) -> None:
        """The autopilot restarts, and is silent for 1.5 s."""
        self.autopilot.reboot(self.flown_ns)
        self._silent_until_ns = self.flown_ns + 3 * NS // 2

    def restart(self) -> None:
        """The service ends, and is started again."""
        self.service, self._newest = None, {}
        self._after(RESTART_NS, self._start)

    def suspend(self) -> None:
        """The computer is suspended. The service ends when it runs again."""
        still_ns = round(float(self._rng.choice([0.05, 0.5, 2.0]) * self._rng.uniform(0.5, 1.5)) * NS)
        self.service, self._newest = None, {}
        self.flown_ns += still_ns
        self._line.clear()
        self.restart()

    def _start(self) -> None:
        self.service = self._make_service(self.cameras, self.avoid)
        self.evidence = self._no_evidence()
        self.began_ns = self.flown_ns

    # ---- time ----------------------------------------------------------------------------------------------------------

    def fly(self, seconds: float) -> None:
        """Flies up to this time."""
        while self.flown_ns < seconds * NS:
            self.step()

    def step(self) -> None:
        """One step of STEP_NS of the true time."""
        self.flown_ns += STEP_NS
        self.mono_ns += round(STEP_NS * (1.0 + self.switches.clock_rate))
        before, self.switches = self.switches, switches_at(self.faults, self.flown_ns)
        if self.switches.repeats and not before.repeats:
            self._repeating = [list(images)[-self.switches.repeats :] for images in self._images]
        while self._waiting and self._waiting[0].begin_ns <= self.flown_ns:
            fault = self._waiting.pop(0)
            if fault.event:
                getattr(self, fault.event)()
        due = [act for at_ns, _, act in sorted(self._later, key=lambda row: row[:2]) if at_ns <= self.flown_ns]
        self._later = [row for row in self._later if row[0] > self.flown_ns]
        for act in due:
            act()
        self._autopilot_sends()
        if self.flown_ns >= self._next_frame_ns:
            self._next_frame_ns = self.flown_ns + FRAME_NS
            self._frames += 1
            for number in range(len(self.cameras)):
                self._expose(number)
        self._service_runs()

    def _no_evidence(self) -> Evidence:
        return Evidence([-1] * len(self.cameras), [-1] * len(self.cameras))

    def _after(self, delay_ns: int, act: Callable[[], None]) -> None:
        self._later.append((self.flown_ns + delay_ns, next(self._numbers), act))

    def truth(self) -> VehicleState:
        """The vehicle now."""
        return self.field.path.at(self.flown_ns / NS)

    # ---- autopilot -----------------------------------------------------------------------------------------------------

    def _estimated(self, flown_ns: int) -> VehicleState:
        """The vehicle as its autopilot estimates it."""
        true, e = self.field.path.at(flown_ns / NS), self.estimate
        c, s = math.cos(e.heading_rad), math.sin(e.heading_rad)
        (x, y, z), (u, v, w) = true.position_ned_m, true.velocity_ned_m_s
        dx, dy, dz = e.shift_m
        roll, pitch, yaw = true.euler_rad
        euler = (roll + e.tilt_rad[0], pitch + e.tilt_rad[1], math.remainder(yaw + e.heading_rad, math.tau))
        if self.switches.not_a_number:
            euler = (math.nan, euler[1], euler[2])
        return VehicleState(
            position_ned_m=(c * x - s * y + dx, s * x + c * y + dy, z + dz),
            velocity_ned_m_s=(c * u - s * v, s * u + c * v, w),
            euler_rad=euler,
            rates_frd_rad_s=true.rates_frd_rad_s,
        )

    def _autopilot_sends(self) -> None:
        s = self.switches
        if self.flown_ns >= self._silent_until_ns:
            self.autopilot.profile.hides_attitude = lambda _: s.hides_attitude
            self.autopilot.profile.repeats_attitude = lambda _: s.repeats_attitude
            for data in self.autopilot.due(self.flown_ns):
                self._send(data)
        if not s.second_system_id:
            self._second = None
            return
        if self._second is None or self._second.profile.system_id != s.second_system_id:
            self._second = self._autopilot(s.second_system_id, self.flown_ns - SECOND_BOOT_NS)
            self._second.profile.motion = _elsewhere
        for data in self._second.due(self.flown_ns):
            self._put(data, LINE_NS, -1)

    def _send(self, data: bytes) -> None:
        """Puts a message of the autopilot on the line, with the faults of the line."""
        s, number = self.switches, int.from_bytes(data[7:10], "little")
        measured_ns, delay_ns = -1, LINE_NS + s.delay_ns
        if number in (ATTITUDE, ATTITUDE_QUATERNION):
            if s.repeats_stamp:
                data = self._attitude_bytes.get(number, data)
            elif not s.not_a_number and not s.repeats_attitude:
                measured_ns = self.flown_ns
                self._attitude_bytes[number] = data
            if s.negates and number == ATTITUDE_QUATERNION and self._rng.random() < 0.5:
                data = self._changed(data, _negate)
        if number == TIMESYNC and (s.answer_delay_ns or s.answer_shift_ns or s.answer_scatter_ns):
            shift_ns = s.answer_shift_ns + round(self._rng.uniform(-1.0, 1.0) * s.answer_scatter_ns)
            data = self._changed(data, lambda m: setattr(m, "tc1", max(1, m.tc1 + shift_ns) if m.tc1 else 0))
            delay_ns += s.answer_delay_ns
        if s.jitter_ns:
            delay_ns += round(self._rng.uniform(0.0, s.jitter_ns))
        if not s.link_up or self._rng.random() < s.lost_share:
            return
        if self._rng.random() < s.noise_share:
            at, measured_ns = int(self._rng.integers(len(data))), -1
            data = data[:at] + bytes([data[at] ^ int(self._rng.integers(1, 256))]) + data[at + 1 :]
        self._put(data, delay_ns, measured_ns)

    def _changed(self, data: bytes, change: Callable[[Any], object]) -> bytes:
        (message,) = self._splitter.feed(data)
        change(message)
        return bytes(message.pack(self._pack))

    def _put(self, data: bytes, delay_ns: int, measured_ns: int) -> None:
        self._line.append(_OnLine(self.flown_ns + delay_ns, next(self._numbers), data, measured_ns))

    # ---- camera --------------------------------------------------------------------------------------------------------

    def _expose(self, number: int) -> None:
        """Exposes an image of a camera, which arrives later. number: of the camera."""
        camera, state = self.cameras[number], self.truth()
        s = self.switches if self.switches.broken_camera in (-1, number) else Switches()
        R_ned_optical = state.R_ned_frd @ rotation_frd_optical(camera.mount)
        lever_m = np.array([camera.mount.x_m, camera.mount.y_m, camera.mount.z_m])
        at, scene = np.array(state.position_ned_m) + state.R_ned_frd @ lever_m, self.field.scene
        depth_m, _ = cast_rays(
            scene.kinds, scene.rows, scene.corners, scene.halfspaces, camera.intrinsics, R_ned_optical, at
        )
        depth_mm = measure(depth_m, camera, self._sensor, self._seed + 1000 * number, self._frames)
        self._images[number].append(depth_mm)
        if not s.delivers:
            return
        frame_ns = left_ns = self.flown_ns
        if s.repeats and self._repeating[number]:
            depth_mm, frame_ns, left_ns = self._repeating[number][self._frames % len(self._repeating[number])], -1, -1
        if s.covered:
            depth_mm = depth_mm.copy()
            depth_mm[:, : round(s.covered * depth_mm.shape[1])] = 0
            left_ns = -1
            if s.covered >= 1.0:
                frame_ns = -1
        if s.other_size:
            depth_mm, frame_ns, left_ns = np.ascontiguousarray(depth_mm[:100]), -1, -1
        if s.stamp_shift_ns:
            frame_ns = left_ns = -1
        late_ns = FRAME_LATE_NS + (s.frame_delay_ns if self._frames % 2 else 0)
        sequence, stamp_ns = self._frames, self.mono_ns + s.stamp_shift_ns

        def arrive() -> None:
            self._newest[camera.camera] = DepthFrame(
                camera=camera.camera,
                sequence=sequence,
                t_exposure_ns=stamp_ns,
                t_arrival_ns=self.mono_ns,
                depth_mm=depth_mm,
            )
            self.evidence.frame_ns[number] = max(self.evidence.frame_ns[number], frame_ns)
            self.evidence.left_ns[number] = max(self.evidence.left_ns[number], left_ns)

        self._after(late_ns, arrive)

    # ---- service -------------------------------------------------------------------------------------------------------

    def _service_runs(self) -> None:
        s, service = self.switches, self.service
        if s.stops_all:
            return
        due = sorted(item for item in self._line if item.arrival_ns <= self.flown_ns)
        self._line = [item for item in self._line if item.arrival_ns > self.flown_ns]
        if service is None:
            return
        for item in due:
            service.receive(item.data, self.mono_ns)
            self.evidence.attitude_ns = max(self.evidence.attitude_ns, item.measured_ns)
        out: list[bytes] = []
        while self._newest:
            out += service.frame(self._newest.pop(next(iter(self._newest))), self.mono_ns)
        out += service.step(self.mono_ns, pipeline=not s.stops_pipeline, sender=not s.stops_sender)
        for data in out:
            if int.from_bytes(data[7:10], "little") == OBSTACLE_DISTANCE:
                (message,) = self._sent_splitter.feed(data)
                self._on_sent(self, [int(v) for v in message.distances])
            if s.link_down and self.flown_ns >= self._silent_until_ns:
                self._after(LINE_NS, _Delivery(self.autopilot, data, self))


@dataclass(frozen=True, slots=True)
class _Delivery:
    """The arrival of bytes at an autopilot."""

    autopilot: SimulatedAutopilot
    data: bytes
    loop: FaultLoop

    def __call__(self) -> None:
        self.autopilot.receive(self.data, self.loop.flown_ns)


def _negate(message: Any) -> None:
    """Gives a quaternion the other sign."""
    for name in ("q1", "q2", "q3", "q4"):
        setattr(message, name, -getattr(message, name))


def _elsewhere(flown_ns: int) -> VehicleState:
    """Another vehicle, which turns quickly at another place."""
    yaw = math.remainder(1.5 * flown_ns / NS, math.tau)
    return VehicleState(
        position_ned_m=(40.0, -30.0, -9.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        euler_rad=(0.2, -0.1, yaw),
        rates_frd_rad_s=(0.0, 0.0, 1.5),
    )
