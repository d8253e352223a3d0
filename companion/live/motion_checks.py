"""The self-checks that compare the motion of the image with that of the vehicle."""

from __future__ import annotations

from collections.abc import Callable

from core.types import CameraInfo
from drivers.base import Event

from ..cameras.masks import Mask
from ..self_check.exposure_monitor import ExposureOffsetMonitor
from ..self_check.exposure_offset import ExposureOffset
from ..self_check.mount_yaw import MountYaw, MountYawMonitor


class MotionChecks:
    """Measures the exposure time offset and the mount's yaw of each camera. Changes no result."""

    def __init__(self, mask: Callable[[CameraInfo], Mask | None] = lambda info: None) -> None:
        """mask: pixels that show the vehicle."""
        self._offset, self._yaw = ExposureOffsetMonitor(mask), MountYawMonitor(mask)

    def announce(self, info: CameraInfo) -> None:
        """Adds an opened camera."""
        self._offset.announce(info)
        self._yaw.announce(info)

    def event(self, event: Event) -> None:
        """Adds a sample or a frame."""
        self._offset.event(event)
        self._yaw.event(event)

    def offsets(self) -> tuple[ExposureOffset, ...]:
        """The present estimates of the offsets."""
        return self._offset.offsets()

    def yaws(self) -> tuple[MountYaw, ...]:
        """The present estimates of the yaws."""
        return self._yaw.yaws()
