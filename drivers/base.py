"""The two protocols of the drivers, and their errors. A driver imports types and frames of core, but not the algorithm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample


class DriverError(Exception):
    """Root of all driver errors. The message names the device or file, the cause and the remedy."""


class DeviceNotFound(DriverError):
    """The device or file does not exist."""


class DeviceLost(DriverError):
    """The device was lost."""


class BadData(DriverError):
    """The data of the device or file are invalid."""


class DepthSource(Protocol):
    """A depth camera, real or simulated. close may be called twice; a failed open closes what it opened; read before
    open and after close raises DeviceNotFound. tests/drivers/test_sources.py checks every driver."""

    @property
    def info(self) -> CameraInfo:
        """The description, known after open()."""
        ...

    @property
    def notice(self) -> str:
        """What the user has to know about the opened camera: what was observed and what to do; empty: nothing."""
        ...

    @property
    def identity(self) -> str:
        """Which device was opened, for people and for comparison with the next opening; empty: not known."""
        ...

    def open(self) -> None:
        """Opens the camera. Raises DriverError."""
        ...

    def read(self, timeout_s: float) -> DepthFrame | None:
        """The newest undelivered frame, stamped with the middle of its exposure on time.monotonic_ns; None after timeout_s.

        Raises DeviceLost, and BadData where what the device delivers cannot be used. Either ends the process of the camera,
        which is then started again."""
        ...

    def close(self) -> None: ...


Event = DepthFrame | AttitudeSample | PoseSample
"""Events of a recording, in the order of arrival on board."""


class EventSource(Protocol):
    """A recording: cameras and autopilot in one stream, in order of arrival."""

    @property
    def cameras(self) -> tuple[CameraInfo, ...]: ...

    def events(self) -> Iterator[Event]:
        """Yields the events. Raises BadData where the recording is invalid, after everything readable was delivered."""
        ...
