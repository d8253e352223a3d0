"""One flight with a configuration: its cameras, the pipeline, the obstacle output, the guard, and the client."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from benchmarks.autopilot.guard_loop import link_status_of
from benchmarks.faults.field import random_field
from benchmarks.faults.kinds import random_faults
from benchmarks.faults.loop import FaultLoop
from benchmarks.faults.service import Service
from benchmarks.faults.switches import NS
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import READS
from companion.autopilot.surroundings import Surroundings
from companion.config.avoidance import AvoidParams
from companion.config.loader import Config
from companion.guard.guard import READS as GUARD_READS
from companion.guard.guard import Guard
from companion.pipeline.configured import effective_cameras
from companion.pipeline.encode import prisms_message, wire_bytes
from companion.pipeline.results import PrismsResult
from core.types import CameraInfo, CameraMount
from drivers.mavlink.commands import PX4_AUTO, px4_mode_number
from drivers.mavlink.session_types import ARDUPILOT, PX4, LinkStatus, Vehicle
from drivers.simulation.source import camera_info
from osape_client.decode import model_from_message
from osape_client.proto import osape_v1_pb2 as pb

from .judge import ConfiguredJudge

MISSION = {PX4: px4_mode_number(PX4_AUTO, 4), ARDUPILOT: 3}
"""custom_mode in which the guard is active."""
WIDTHS_PX = (96, 128, 160)
CAMERA_YAW_RAD = (0.0, 1.48, 3.14, -1.48)
QUERY_EVERY = 8
"""Of so many results one is queried."""


class ConfiguredService(Service):
    """The service of a configuration, with its guard. Each result is encoded, and decoded by the client."""

    reads = READS | GUARD_READS

    def __init__(self, cameras: Sequence[CameraInfo], avoid: AvoidParams, flight: ConfiguredFlight) -> None:
        self._flight, self.guard, self._now_ns = flight, None, 0
        config = flight.config
        if config.guard.enabled:
            line = AutopilotLine(self._received, self._post, command=lambda message, _: self._post(message))
            self.guard = Guard(config.guard, avoid, line, self._link_status, None)
        super().__init__(cameras, avoid, config.service.timeout_s, config)

    def step(self, now_ns: int, *, pipeline: bool = True, sender: bool = True) -> list[bytes]:
        """As that of Service, then a step of the guard."""
        self._now_ns = now_ns
        out = super().step(now_ns, pipeline=pipeline, sender=sender)
        if self.guard is not None and sender:
            self.guard.step(now_ns)
        return out

    def message(self, message: Any, arrival_ns: int) -> None:
        """As that of Service, and for the guard."""
        super().message(message, arrival_ns)
        if self.guard is not None and message.get_msgId() in GUARD_READS:
            self.guard.message(message, arrival_ns)

    def result(self, result: PrismsResult) -> None:
        """Encodes and decodes the result, then uses it."""
        self._flight.result(result)
        super().result(result)

    def _observe(self, surroundings: Surroundings) -> None:
        if self.guard is None:
            return
        self.guard.observe(surroundings)
        sight = self.guard.sight
        assert sight is not None
        if not self._flight.faults:
            self._flight.judge.path(self._flight, sight)

    def _received(self) -> Vehicle | None:
        vehicle: Vehicle | None = self._vehicle(self._now_ns)
        return vehicle

    def _post(self, message: Any) -> None:
        self.session.post(message, self._now_ns)

    def _link_status(self) -> LinkStatus:
        return link_status_of(self._received())


class ConfiguredFlight(FaultLoop):
    """A flight with a configuration that sends obstacles. frames, models: results, and those with a model that the client decoded."""

    def __init__(self, config: Config, seed: int, seconds: float, *, faults: bool = False) -> None:
        self.config, self.frames, self.models = config, 0, 0
        kind = (PX4, ARDUPILOT)[seed % 2]
        chosen = random_faults(seed, 3.0, seconds - 0.5) if faults else []
        self.judge = ConfiguredJudge(chosen, kind, config=config)
        super().__init__(
            random_field(seed, seconds + 60.0),
            kind,
            seed,
            chosen,
            self.judge.sent,
            config.avoid,
            lambda cameras, avoid: ConfiguredService(cameras, avoid, self),
            cameras_of(config, seed),
        )
        self.autopilot.profile.custom_mode = MISSION[kind]

    def result(self, result: PrismsResult) -> None:
        """Encodes a result, decodes it as a client, and compares."""
        self.frames += 1
        model = model_from_message(pb.PrismsFrame.FromString(wire_bytes(prisms_message(result))))
        if result.model is None or model is None:
            return
        self.models += 1
        if len(model.planes) != len(result.model.planes) or model.free.end.shape != result.model.free.end.shape:
            self.judge.wrong.append("the client decodes another model than was encoded")
        if self.models % QUERY_EVERY == 0 and not self.faults:
            exposed_ns = self.flown_ns - (self.mono_ns - result.t_exposure_ns)
            self.judge.model(self, result, model, self.field.path.at(exposed_ns / NS))

    def violations(self) -> list[str]:
        """All contradictions, as text."""
        sent = [f"{v.t_s:.2f} s: {v.what}; faults: {', '.join(v.faults) or 'none'}" for v in self.judge.violations]
        return sent + self.judge.wrong


def cameras_of(config: Config, seed: int) -> tuple[CameraInfo, ...]:
    """The cameras of a configuration as small images, with its mounts and ranges. Without a configured yaw they look to different
    sides."""
    width_px = WIDTHS_PX[seed // 2 % len(WIDTHS_PX)]
    info = camera_info(width_px, width_px * 3 // 4)
    plain = [
        replace(info, camera=camera.name, mount=CameraMount(yaw_rad=CAMERA_YAW_RAD[number % 4]))
        for number, camera in enumerate(config.cameras)
    ]
    return effective_cameras(config, plain or [info])
