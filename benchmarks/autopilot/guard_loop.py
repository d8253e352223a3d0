"""One vehicle with the guard in simulated time: rendered depth, pipeline, obstacle output, guard, link, autopilot model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.autopilot.auto_flight import AutoFlight
from companion.autopilot.failsafe import AutopilotNow
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from companion.config.avoidance import AvoidParams
from companion.config.guard import GuardParams
from companion.guard.braking import braking_of
from companion.guard.guard import Guard
from companion.guard.path_sight import path_sight
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.extractor import Extractor
from core.frames import rotation_frd_optical
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.commands import (
    DO_CHANGE_SPEED,
    DO_REPOSITION,
    DO_SET_MODE,
    REQUEST_MESSAGE,
    SET_MESSAGE_INTERVAL,
)
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import LinkStatus, Vehicle
from drivers.simulation.ray_caster import cast_rays
from drivers.simulation.scenes import Scene
from drivers.simulation.sensor_model import SensorModel, measure

NS = 1_000_000_000
MS = 1_000_000
TICK_NS = 20 * MS
FRAME_NS = NS // 12
DECIDE_NS = NS // 15
HEARTBEAT_NS = NS // 5
FRAME_LATE_NS = 70 * MS
"""From the exposure to the result: camera, USB, extraction."""
LINK_NS = 40 * MS
"""Each way, between the service and the autopilot."""
NOISE_S = 0.5
"""Time constant of the noise of the reported velocity."""
SYSTEM, COMPONENT = 1, 196
_OF_HEARTBEATS = (SET_MESSAGE_INTERVAL, REQUEST_MESSAGE)
NO_CLOCK = ClockEstimate(ClockSource.NONE)


def link_status_of(vehicle: Vehicle | None) -> LinkStatus:
    """The status of a link whose clock is not synchronised, for a guard without a link."""
    return LinkStatus(
        vehicle=vehicle,
        clock=NO_CLOCK,
        clock_restarts=0,
        attitude_hz=50.0,
        position_hz=50.0,
        received=0,
        counts={},
    )


@dataclass(slots=True)
class LoopRecord:
    """What happened. stops: (instant, speed) of the first attempt of each stop; reasons: for each of them, what it was decided from;
    limits: number of speed commands; texts: of STATUSTEXT.
    reactions_s: for each stop before an obstacle, time from the exposure of the first of the frames, one after the other, in which an
    obstacle did not leave the braking distance, also where that one needed a second frame."""

    stops: list[tuple[int, float]] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    limits: int = 0
    texts: list[str] = field(default_factory=list)
    reactions_s: list[float] = field(default_factory=list)


class GuardLoop:
    """`run` flies. kind: PX4 or ArduPilot. blind_ns: from this instant on the camera gives no frames. velocity_noise_m_s: standard
    deviation of each component of the reported velocity, with the time constant NOISE_S. times_reactions: False saves the time
    for `LoopRecord.reactions_s`."""

    def __init__(
        self,
        scene: Scene,
        camera: CameraInfo,
        sensor: SensorModel,
        flight: AutoFlight,
        kind: str,
        seed: int,
        guard: GuardParams | None = None,
        avoid: AvoidParams | None = None,
    ) -> None:
        self.scene, self.camera, self.sensor, self.flight, self.kind, self.seed = (
            scene,
            camera,
            sensor,
            flight,
            kind,
            seed,
        )
        self.avoid, self.params = avoid or AvoidParams(), guard or GuardParams(enabled=True)
        self.braking = braking_of(self.params, self.avoid)
        self.record = LoopRecord()
        self.now_ns = 100 * NS
        self.blind_ns: int | None = None
        self.velocity_noise_m_s = 0.0
        self.times_reactions = True
        self._noise_m_s, self._rng = np.zeros(3), np.random.default_rng([30, seed])
        extractor = Extractor()
        self._pipeline = Pipeline((camera,), lambda info: extractor)
        line = AutopilotLine(self._vehicle, self._post, command=lambda message, _: self._post(message))
        self.guard = Guard(self.params, self.avoid, line, self._link_status, None)
        self._builder = ObstacleReportBuilder(
            self.avoid,
            CameraUse(
                cameras=(camera.camera,), timeout_s=0.3, observer=self.guard.observe, reach_m=self.params.horizon_m
            ),
        )
        self._first_shown = ObstacleReportBuilder(
            replace(self.avoid, confirm_px=0), CameraUse(cameras=(camera.camera,), timeout_s=0.3, observer=self._note)
        )
        for builder in self._builders():
            builder.announce(camera)
        self._later: list[tuple[int, Callable[[], None]]] = []
        self._heartbeat = (flight.mode, self.now_ns)
        self._frame = 0
        self._next_frame_ns = self._next_decide_ns = self._next_heartbeat_ns = self.now_ns
        self._shown_ns: int | None = None

    # ---- what the guard is given -------------------------------------------------------------------------------------

    def _vehicle(self) -> Vehicle:
        mode, heard_ns = self._heartbeat
        return Vehicle(SYSTEM, self.kind, 2, True, mode, heard_ns)

    def _link_status(self) -> LinkStatus:
        return link_status_of(self._vehicle())

    def _builders(self) -> tuple[ObstacleReportBuilder, ...]:
        """The one of the service, and one that shows each plane in its first frame."""
        return (self._builder, self._first_shown) if self.times_reactions else (self._builder,)

    def _note(self, surroundings: Surroundings) -> None:
        """Notes the first exposure that shows an obstacle within the braking distance, confirmed by another frame or not."""
        sight = path_sight(surroundings, self.avoid, self.params)
        obstacle_m = min(sight.obstacle_m, sight.weak_obstacle_m)
        speed_m_s = sight.speed_m_s or 0.0
        if not (speed_m_s > 0.3 and self.braking.needed_m(speed_m_s) > obstacle_m):
            self._shown_ns = None
        elif self._shown_ns is None:
            self._shown_ns = sight.exposed_ns

    def _post(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.record.texts.append(str(message.text))
        if kind != "COMMAND_LONG":
            return
        assert message.target_system == SYSTEM
        if message.command in (DO_SET_MODE, DO_REPOSITION) and self.guard.memory.attempts == 1:
            self.record.stops.append((self.now_ns, self.flight.speed_m_s))
            self.record.reasons.append(self._reason())
            if self._shown_ns is not None:
                self.record.reactions_s.append((self.now_ns - self._shown_ns) / NS)
        self.record.limits += message.command == DO_CHANGE_SPEED
        self._after(LINK_NS, lambda: self._command(message))

    def _reason(self) -> str:
        """What the stop of this instant was decided from, in one line."""
        sight, verdict = self.guard.sight, self.guard.verdict
        if sight is None or verdict is None:
            return "nothing seen"
        needed_m = self.braking.needed_m(verdict.predicted_m_s)
        limit_m_s = self.guard.memory.limit_m_s
        return (
            f"at {verdict.speed_m_s:.1f} m/s, to come {verdict.predicted_m_s:.1f}, needed {needed_m:.1f} m, free {sight.free_m:.1f}, "
            f"ahead {sight.ahead_free_m:.1f}, obstacle {sight.obstacle_m:.1f}, weak {sight.weak_obstacle_m:.1f}, "
            f"remembered {sight.remembered_m:.1f}, limit {limit_m_s:.1f} of {self.record.limits}: {verdict.cause}"
        )

    def _command(self, message: Any) -> None:
        result = 0 if message.command in _OF_HEARTBEATS else self.flight.command(message)
        if result is not None:
            ack = dialect.MAVLink_command_ack_message(message.command, result, 0, 0, SYSTEM, COMPONENT)
            self._after(LINK_NS, lambda: self.guard.message(ack, self.now_ns))

    def _after(self, delay_ns: int, act: Callable[[], None]) -> None:
        self._later.append((self.now_ns + delay_ns, act))

    # ---- time -------------------------------------------------------------------------------------------------------

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Flies for so long, or until a condition holds."""
        end_ns = self.now_ns + round(seconds * NS)
        while self.now_ns < end_ns and not until():
            self.tick()

    def tick(self) -> None:
        """One step of TICK_NS."""
        self.now_ns += TICK_NS
        self.flight.step(TICK_NS / NS)
        due = [act for t_ns, act in self._later if t_ns <= self.now_ns]
        self._later = [(t_ns, act) for t_ns, act in self._later if t_ns > self.now_ns]
        for act in due:
            act()
        self._send_motion()
        if self.now_ns >= self._next_heartbeat_ns:
            self._next_heartbeat_ns += HEARTBEAT_NS
            beat = (self.flight.mode, self.now_ns + LINK_NS)
            self._after(LINK_NS, lambda: setattr(self, "_heartbeat", beat))
        if self.now_ns >= self._next_frame_ns:
            self._next_frame_ns += FRAME_NS
            if self.blind_ns is None or self.now_ns < self.blind_ns:
                self._expose()
        if self.now_ns >= self._next_decide_ns:
            self._next_decide_ns += DECIDE_NS
            for builder in reversed(self._builders()):
                builder.decide(AutopilotNow(kind=self.kind, margin_m=2.0, cp_dist_m=3.0), self.now_ns)
        self.guard.step(self.now_ns)

    def _send_motion(self) -> None:
        s, t_ns = self.flight.state(), self.now_ns
        samples: list[AttitudeSample | PoseSample] = [
            AttitudeSample(t_ns, t_ns, s.q_ned_frd_wxyz, s.rates_frd_rad_s),
            PoseSample(t_ns, t_ns, s.position_ned_m, self._reported_m_s(s.velocity_ned_m_s)),
        ]
        for sample in samples:
            self._pipeline.handle(sample)
        for builder in self._builders():
            builder.samples(samples)

    def _reported_m_s(self, velocity_ned_m_s: tuple[float, float, float]) -> tuple[float, float, float]:
        """The velocity as the autopilot reports it."""
        if self.velocity_noise_m_s == 0.0:
            return velocity_ned_m_s
        kept = math.exp(-TICK_NS / NS / NOISE_S)
        fresh = self._rng.normal(0.0, self.velocity_noise_m_s, 3)
        self._noise_m_s = kept * self._noise_m_s + math.sqrt(1.0 - kept * kept) * fresh
        north, east, down = np.add(velocity_ned_m_s, self._noise_m_s).tolist()
        return north, east, down

    def _expose(self) -> None:
        s, t_ns, number = self.flight.state(), self.now_ns, self._frame
        self._frame += 1
        R_ned_optical = s.R_ned_frd @ rotation_frd_optical(self.camera.mount)
        scene, at = self.scene, np.array(s.position_ned_m)
        depth_m, _ = cast_rays(
            scene.kinds, scene.rows, scene.corners, scene.halfspaces, self.camera.intrinsics, R_ned_optical, at
        )
        depth_mm = measure(depth_m, self.camera, self.sensor, self.seed, number)

        def arrive() -> None:
            frame = DepthFrame(
                camera=self.camera.camera,
                sequence=number,
                t_exposure_ns=t_ns,
                t_arrival_ns=self.now_ns,
                depth_mm=depth_mm,
            )
            for output in self._pipeline.handle(frame):
                if isinstance(output, PrismsResult):
                    for builder in self._builders():
                        builder.result(output)

        self._after(FRAME_LATE_NS, arrive)

    @property
    def place_m(self) -> np.ndarray:
        """(3,) ned."""
        x, y = self.flight.position_m
        return np.array([x, y, -self.flight.height_m])

    @property
    def direction(self) -> np.ndarray:
        """(2,) of the velocity; of the heading while the vehicle stands."""
        speed = self.flight.speed_m_s
        if speed < 0.1:
            return np.array([math.cos(self.flight.heading_rad), math.sin(self.flight.heading_rad)])
        return self.flight.velocity_m_s / speed
