"""The two contracts of the hardware floor, and its errors. A driver imports core.types, never the algorithm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample


class DriverError(Exception):
    """Root of all driver errors. The message names the device or file, the cause and the remedy."""


class DeviceNotFound(DriverError):
    """The device or file is not there."""


class DeviceLost(DriverError):
    """It was there and has gone away."""


class BadData(DriverError):
    """It is there, but what it delivers cannot be used."""


class DepthSource(Protocol):
    """One depth camera, live or not. close is idempotent; a half-failed open closes what it opened; read before open and
    after close raises DeviceNotFound. tests/drivers/test_sources.py holds every driver to it."""

    @property
    def info(self) -> CameraInfo:
        """Known after open()."""
        ...

    def open(self) -> None:
        """Raises DriverError."""
        ...

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest frame not yet delivered, or None after timeout_s. Raises DeviceLost."""
        ...

    def close(self) -> None: ...


Event = DepthFrame | AttitudeSample | PoseSample
"""What a recording delivers, in the order in which it arrived on board."""


class EventSource(Protocol):
    """A recording: cameras and autopilot in one stream, in order of arrival."""

    @property
    def cameras(self) -> tuple[CameraInfo, ...]: ...

    def events(self) -> Iterator[Event]:
        """Raises BadData where the recording cannot be used; what was readable before it has been delivered."""
        ...

    def close(self) -> None: ...
