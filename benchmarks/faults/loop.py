"""A flight in simulated time: the field, the vehicle, its autopilot, the line, the camera, and the service.

Two clocks run: the true time, by which the vehicle and its autopilot live, and CLOCK_MONOTONIC of the companion computer, which
stands still while the computer is suspended, and is corrected by a time daemon."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from companion.config.avoidance import AvoidParams
from companion.pipeline.results import PrismsResult
from core.types import CameraInfo, DepthFrame
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session_types import ARDUPILOT
from drivers.simulation.autopilot import SimulatedAutopilot
from drivers.simulation.firmware_profile import FirmwareProfile
from drivers.simulation.flight_path import VehicleState

from .field import Field
from .images import ImageSource, cameras_of, reopened
from .line import ATTITUDE, LINE_NS, AutopilotLine
from .service import Service
from .switches import MS, NS, Fault, Switches, switches_at

STEP_NS = 5 * MS
FRAME_LATE_NS = 50 * MS
START_NS = 1000 * NS
RESTART_NS = NS
"""From the end of the service to its next start."""
OBSTACLE_DISTANCE = 330
ON_GROUND, IN_AIR = 1, 2
"""MAV_LANDED_STATE."""
SECOND_BOOT_NS = 700 * NS
"""The second autopilot was started this long before it appears on the line."""

Sent = Callable[["FaultLoop", list[int]], None]
Published = Callable[["FaultLoop", PrismsResult], None]


@dataclass(frozen=True, slots=True)
class Estimate:
    """How the estimate of the autopilot differs from the truth. tilt_rad: roll and pitch; since_ns: of the flight."""

    heading_rad: float = 0.0
    tilt_rad: tuple[float, float] = (0.0, 0.0)
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    since_ns: int = 0


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
        self.on_published: Published = lambda loop, result: None
        self.field, self.kind, self.faults, self.avoid = field, kind, faults, avoid or AvoidParams(send=True)
        self.cameras = list(cameras or cameras_of(seed))
        self.flown_ns, self.mono_ns = 0, START_NS
        self.estimates = [Estimate()]
        self.evidence, self.switches = self._no_evidence(), Switches()
        self.began_ns = 0
        self.camera_switches = [Switches()] * len(self.cameras)
        self._sources = [ImageSource(number, seed) for number in range(len(self.cameras))]
        self._closed_until_ns = [0] * len(self.cameras)
        self._rng, self._on_sent = np.random.default_rng([6, seed]), on_sent
        self._make_service = service
        self.service: Service | None = service(self.cameras, self.avoid)
        parameters = {"AVOID_MARGIN": 2.0, "PRX1_TYPE": 2.0} if kind == ARDUPILOT else {"CP_DIST": 3.0}
        self.autopilot = self._autopilot(1, -40 * NS)
        self.autopilot.parameters = dict(parameters)
        self._second: SimulatedAutopilot | None = None
        self._line = AutopilotLine(np.random.default_rng([9, seed]))
        self._numbers = itertools.count()
        self._later: list[tuple[int, int, Callable[[], None]]] = []
        self._sent_splitter = MessageSplitter()
        self._newest: dict[str, DepthFrame] = {}
        self._silent_until_ns = 0
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
        """The estimate of the heading jumps. By less than the width of a view as often as by more: then both views overlap."""
        step_rad = float(self._rng.choice([-1.0, 1.0]) * math.exp(self._rng.uniform(math.log(0.05), math.log(3.0))))
        self._estimates(heading_rad=self.estimate.heading_rad + step_rad)

    def reset_position(self) -> None:
        """The estimate of the position jumps."""
        x, y, z = np.add(self.estimate.shift_m, self._rng.uniform(-8.0, 8.0, 3)).tolist()
        self._estimates(shift_m=(x, y, z))

    def change_estimator(self) -> None:
        """Another estimator is used: attitude and position jump."""
        self.reset_heading()
        self.reset_position()
        roll, pitch = self._rng.uniform(-0.02, 0.02, 2).tolist()
        self._estimates(tilt_rad=(roll, pitch))

    def _estimates(self, **changes: Any) -> None:
        self.estimates.append(replace(self.estimate, since_ns=self.flown_ns, **changes))

    @property
    def estimate(self) -> Estimate:
        """The present one."""
        return self.estimates[-1]

    def reboot(self) -> None:
        """The autopilot restarts, and is silent for 1.5 s."""
        self.autopilot.reboot(self.flown_ns)
        self._silent_until_ns = self.flown_ns + 3 * NS // 2

    def step_clock(self) -> None:
        """The boot time of the autopilot jumps, without a restart."""
        step_s = float(
            self._rng.choice([-1.0, 1.0]) * self._rng.choice([0.05, 0.2, 1.0, 5.0]) * self._rng.uniform(0.6, 1.5)
        )
        self.autopilot.profile.boot_at_ns -= round(step_s * NS)

    def change_parameter(self) -> None:
        """A ground station changes the distance at which the autopilot brakes; at most 0: it does not brake."""
        name, value = ("AVOID_MARGIN", 0.5) if self.kind == ARDUPILOT else ("CP_DIST", -1.0)
        self.autopilot.parameters[name] = float(self._rng.choice([value, 1.0, 2.5, 6.0, 15.0]))

    def reopen(self) -> None:
        """A camera is closed, and is opened with another calibration, which the supervisor of the service would refuse."""
        number = int(self._rng.integers(len(self.cameras)))
        closed_ns = round(self._rng.uniform(0.5, 1.5) * NS)
        if self.flown_ns < self._closed_until_ns[number]:  # closed by a fault before this one
            return
        self._closed_until_ns[number] = self.flown_ns + closed_ns
        self._after(closed_ns, lambda: self._opened(number, reopened(self.cameras[number], self._rng)))

    def _opened(self, number: int, info: CameraInfo) -> None:
        self.cameras[number] = info
        self.evidence.frame_ns[number] = self.evidence.left_ns[number] = -1
        if self.service is not None:
            self.service.opened(info)

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
        self.switches = switches_at(self.faults, self.flown_ns)
        numbers = range(len(self.cameras))
        self.camera_switches = [switches_at(self.faults, self.flown_ns, number) for number in numbers]
        while self._waiting and self._waiting[0].begin_ns <= self.flown_ns:
            fault = self._waiting.pop(0)
            if fault.event:
                getattr(self, fault.event)()
        due = [act for at_ns, _, act in sorted(self._later, key=lambda row: row[:2]) if at_ns <= self.flown_ns]
        self._later = [row for row in self._later if row[0] > self.flown_ns]
        for act in due:
            act()
        self._autopilot_sends()
        for number, source in enumerate(self._sources):
            if self.flown_ns >= source.next_ns:
                source.next_ns = self.flown_ns + source.period_ns
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
            self.autopilot.profile.armed = not s.disarmed
            self.autopilot.profile.landed_state = ON_GROUND if s.disarmed else IN_AIR
            for data in self.autopilot.due(self.flown_ns):
                self._line.send(data, s, self.flown_ns)
        if not s.second_system_id:
            self._second = None
            return
        if self._second is None or self._second.profile.system_id != s.second_system_id:
            self._second = self._autopilot(s.second_system_id, self.flown_ns - SECOND_BOOT_NS)
            self._second.profile.motion = _elsewhere
        for data in self._second.due(self.flown_ns):
            self._line.put(data, self.flown_ns + LINE_NS)

    # ---- camera --------------------------------------------------------------------------------------------------------

    def _expose(self, number: int) -> None:
        """Exposes an image of a camera, which arrives later. number: of the camera."""
        camera, s, source = self.cameras[number], self.camera_switches[number], self._sources[number]
        image = source.expose(camera, self.field.scene_at(self.flown_ns / NS), self.truth(), s)
        if image is None or self.flown_ns < self._closed_until_ns[number]:
            return
        frame_ns = self.flown_ns if image.correct else -1
        left_ns = self.flown_ns if image.left_correct else -1
        late_ns = FRAME_LATE_NS + (s.frame_delay_ns if source.frames % 2 else 0)
        sequence, stamp_ns = source.frames, self.mono_ns + s.stamp_shift_ns

        def arrive() -> None:
            if self.cameras[number] != camera:  # of before it was opened again
                return
            self._newest[camera.camera] = DepthFrame(
                camera=camera.camera,
                sequence=sequence,
                t_exposure_ns=stamp_ns,
                t_arrival_ns=self.mono_ns,
                depth_mm=image.depth_mm,
            )
            self.evidence.frame_ns[number] = max(self.evidence.frame_ns[number], frame_ns)
            self.evidence.left_ns[number] = max(self.evidence.left_ns[number], left_ns)

        self._after(late_ns, arrive)

    # ---- service -------------------------------------------------------------------------------------------------------

    def _service_runs(self) -> None:
        s, service = self.switches, self.service
        if s.stops_all:
            return
        due = self._line.take(self.flown_ns)
        if service is None:
            return
        for item in due:
            service.receive(item.data, self.mono_ns)
            self.evidence.attitude_ns = max(self.evidence.attitude_ns, item.measured_ns)
        out: list[bytes] = []
        while self._newest:
            out += service.frame(self._newest.pop(next(iter(self._newest))), self.mono_ns)
        service.pipeline_ns = s.pipeline_ns
        out += service.step(self.mono_ns, pipeline=not s.stops_pipeline, sender=not s.stops_sender)
        for result in service.published:
            self.on_published(self, result)
        service.published.clear()
        for data in out:
            if int.from_bytes(data[7:10], "little") == OBSTACLE_DISTANCE:
                (message,) = self._sent_splitter.feed(data)
                self._on_sent(self, [int(v) for v in message.distances])
            if s.link_down and self.flown_ns >= self._silent_until_ns:
                self._after(LINE_NS + s.request_delay_ns, _Delivery(self.autopilot, data, self))


@dataclass(frozen=True, slots=True)
class _Delivery:
    """The arrival of bytes at an autopilot."""

    autopilot: SimulatedAutopilot
    data: bytes
    loop: FaultLoop

    def __call__(self) -> None:
        self.autopilot.receive(self.data, self.loop.flown_ns)


def _elsewhere(flown_ns: int) -> VehicleState:
    """Another vehicle, which turns quickly at another place."""
    yaw = math.remainder(1.5 * flown_ns / NS, math.tau)
    return VehicleState(
        position_ned_m=(40.0, -30.0, -9.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        euler_rad=(0.2, -0.1, yaw),
        rates_frd_rad_s=(0.0, 0.0, 1.5),
    )
