"""One flight with a configuration: its cameras, the pipeline, the obstacle output, the guard, and the client."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.faults.field import random_field
from benchmarks.faults.kinds import random_faults
from benchmarks.faults.loop import FaultLoop
from benchmarks.faults.service import Service
from companion.config.loader import Config
from companion.pipeline.configured import effective_cameras
from core.types import CameraInfo, CameraMount
from drivers.mavlink.commands import PX4_AUTO, px4_mode_number
from drivers.mavlink.session_types import ARDUPILOT, PX4
from drivers.simulation.source import camera_info

from .judge import ConfiguredJudge

MISSION = {PX4: px4_mode_number(PX4_AUTO, 4), ARDUPILOT: 3}
"""custom_mode in which the guard is active."""
WIDTHS_PX = (96, 128, 160)
CAMERA_YAW_RAD = (0.0, 1.48, 3.14, -1.48)
FIRST_FAULT_S = 3.0


class ConfiguredFlight(FaultLoop):
    """A flight with a configuration that sends obstacles. faults: with random ones."""

    def __init__(self, config: Config, seed: int, seconds: float, *, faults: bool = False) -> None:
        kind = (PX4, ARDUPILOT)[seed % 2]
        chosen = random_faults(seed, FIRST_FAULT_S, seconds - 0.5) if faults else []
        self.judge = ConfiguredJudge(chosen, kind, config=config)
        super().__init__(
            random_field(seed, seconds + 60.0),
            kind,
            seed,
            chosen,
            self.judge.sent,
            config.avoid,
            lambda cameras, avoid: Service(cameras, avoid, config=config),
            cameras_of(config, seed),
        )
        self.on_published = self.judge.published
        if config.autopilot.system_id:  # no other autopilot is used
            own = self._autopilot(config.autopilot.system_id, self.autopilot.profile.boot_at_ns)
            own.parameters, self.autopilot = self.autopilot.parameters, own
        self.autopilot.profile.custom_mode = MISSION[kind]


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
