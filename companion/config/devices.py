"""Checks of the devices of live cameras: that none can be exchanged for another one, and none is a file."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .camera import CameraConfig
from .camera_kinds import CAMERA_KINDS

_ENUMERATED = re.compile(r"/dev/video\d+")
"""Numbered in the order in which the devices appear: after a reset of the bus two cameras may have changed their numbers."""


def device_problems(cameras: Sequence[CameraConfig]) -> list[str]:
    """Causes and remedies. A camera that opens the device of another one places what that sees in its own direction."""
    return [*_recordings(cameras), *_shared(cameras), *_unnamed(cameras), *_numbered(cameras), *_alike(cameras)]


def _recordings(cameras: Sequence[CameraConfig]) -> list[str]:
    return [
        f'[[camera]] "{c.name}": device = "{c.device}" is no device but a file, whose images would count as taken now; set the '
        "path of a camera, best in /dev/v4l/by-id or by-path"
        for c in _video(cameras)
        if not c.device.startswith("/dev/")
    ]


def _shared(cameras: Sequence[CameraConfig]) -> list[str]:
    owners = [c for c in cameras if c.device and c.kind in CAMERA_KINDS and CAMERA_KINDS[c.kind].owns_device]
    shared = {c.device: [d.name for d in owners if d.device == c.device] for c in owners}
    return [
        f'[[camera]] {", ".join(names)}: device = "{device}" occurs {len(names)} times; give each camera its own'
        for device, names in shared.items()
        if len(names) > 1
    ]


def _unnamed(cameras: Sequence[CameraConfig]) -> list[str]:
    oaks = [c for c in cameras if c.kind == "oak"]
    if len(oaks) < 2:
        return []
    return [
        f'[[camera]] "{c.name}": device is empty, with {len(oaks)} cameras of kind "oak" configured; it would open that of '
        "another one while only that is connected. Set device to its id, which `companion setup` prints"
        for c in oaks
        if not c.device
    ]


def _numbered(cameras: Sequence[CameraConfig]) -> list[str]:
    video = _video(cameras)
    return [
        f'[[camera]] "{c.name}": device = "{c.device}" may be another camera after each start or reset, with {len(video)} video '
        "devices configured; set a path in /dev/v4l/by-id, or in /dev/v4l/by-path for cameras without a serial number"
        for c in video
        if len(video) > 1 and _ENUMERATED.fullmatch(c.device)
    ]


def _alike(cameras: Sequence[CameraConfig]) -> list[str]:
    """All ZED of a model have the same name by id: no serial number of their own is in it."""
    zeds = [c for c in cameras if c.kind == "zed"]
    return [
        f'[[camera]] "{c.name}": device = "{c.device}" may be the other ZED after each connection; set a path in '
        "/dev/v4l/by-path for each of them"
        for c in zeds
        if len(zeds) > 1 and c.device.startswith("/dev/v4l/by-id/")
    ]


def _video(cameras: Sequence[CameraConfig]) -> list[CameraConfig]:
    return [c for c in cameras if c.kind in CAMERA_KINDS and CAMERA_KINDS[c.kind].is_video]
