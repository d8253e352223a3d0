"""The process of one camera: `python -m companion.cameras.worker FD CONFIG`. It sends frames to the service.

A camera library may hang, crash or abort; in a process of its own it cannot stop the service. `supervisor.py` starts
and restarts the process."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
import sys
import time
from typing import Any

from core.types import CameraInfo, CameraMount, DepthFrame, Intrinsics
from drivers.base import DepthSource, DeviceLost, DriverError
from drivers.cameras.frame_channel import FrameWriter

from ..config.camera import CameraConfig
from .factory import make_source

READ_S = 0.1
"""Longest wait for a frame before a notification `alive` is sent."""
CAUSE_CHARACTERS = 2000


def info_from_json(payload: dict[str, Any]) -> CameraInfo:
    """The description from its values as dataclasses.asdict gives them. Raises ValueError, KeyError or TypeError."""
    values = dict(payload)
    intrinsics, mount = Intrinsics(**values.pop("intrinsics")), CameraMount(**values.pop("mount"))
    return CameraInfo(intrinsics=intrinsics, mount=mount, **values)


def with_offset(frame: DepthFrame, offset_ms: float) -> DepthFrame:
    """The frame with its exposure stamp corrected by `exposure_offset_ms`; no exposure is later than the arrival."""
    if offset_ms == 0.0:
        return frame
    t_exposure_ns = min(frame.t_exposure_ns - round(offset_ms * 1e6), frame.t_arrival_ns)
    return dataclasses.replace(frame, t_exposure_ns=t_exposure_ns)


def shortened(cause: str) -> str:
    """The cause without what does not fit to a notification: a library may put a whole dump into its message."""
    rest = len(cause) - CAUSE_CHARACTERS
    return cause if rest <= 0 else f"{cause[:CAUSE_CHARACTERS]}... ({rest} more characters)"


def description(section: CameraConfig, source: DepthSource) -> CameraInfo:
    """The description of an opened camera, with the configured values. A configured bias_per_m does not lower that of a camera which
    the driver finds misaligned: it may be older. Nor does a configured min_range_m lower the least depth that the driver can measure.
    Raises ValueError, also for images of another size than the configured one, in which masks are drawn."""
    info = section.applied_to(source.info)
    found, wanted = (info.intrinsics.width, info.intrinsics.height), section.size_px
    if found != wanted:
        raise ValueError(
            f"camera {section.name}: its images have {found[0]}x{found[1]} pixels, {wanted[0]}x{wanted[1]} are configured: masks would hide "
            f"other parts of the image. Set width_px = {found[0]} and height_px = {found[1]}, and draw masks in an image of this size"
        )
    least_m = max(info.min_range_m, source.info.min_range_m)
    if least_m >= info.max_range_m:
        raise ValueError(
            f"max_range_m = {info.max_range_m:g} is not greater than the least depth of this camera, {least_m:g} m; raise it"
        )
    info = dataclasses.replace(info, min_range_m=least_m)
    if source.notice:
        info = dataclasses.replace(info, bias_per_m=max(info.bias_per_m, source.info.bias_per_m))
    return info


def run_camera(section: CameraConfig, writer: FrameWriter, source: DepthSource) -> None:
    """Opens the source and passes its frames on until the device or the service is lost. Raises DriverError."""
    writer.send("opening")
    source.open()
    info = description(section, source)
    writer.send("opened", info=dataclasses.asdict(info), notice=shortened(source.notice), identity=source.identity)
    while True:
        frame = source.read(READ_S)
        if frame is not None:
            writer.write(with_offset(frame, section.exposure_offset_ms))
        else:
            writer.send("alive", t_ns=time.monotonic_ns())


def main(argv: list[str]) -> int:
    """Runs until it is stopped (0) or fails (1); the cause of a failure is sent as a notification, before the source is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the service ends this process
    section = CameraConfig(**json.loads(argv[1]))
    writer = FrameWriter(int(argv[0]), section.name)
    with contextlib.ExitStack() as opened:
        try:
            source = make_source(section)
            opened.callback(source.close)
            run_camera(section, writer, source)
        except (DriverError, ValueError, ImportError) as error:
            with contextlib.suppress(DeviceLost):  # the service has ended: no receiver is left
                writer.send("failed", cause=shortened(str(error)))
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
