"""Why the service would refuse a configuration that a replay can use."""

from __future__ import annotations

from collections.abc import Sequence

from .camera import CameraConfig
from .camera_kinds import RECORDED, live_kinds
from .devices import device_problems
from .endpoints import beyond_loopback, opened_streams, without_keys_text
from .loader import Config


def run_problems(config: Config) -> list[str]:
    """Causes and remedies, for `run` and `install`."""
    return [*recording_problems(config.cameras), *startup_problems(config)]


def startup_problems(config: Config) -> list[str]:
    """Those of a configuration of which it is not known whether it is for a replay, for `check-config`."""
    return [*device_problems(config.cameras), *stream_problems(config)]


def recording_problems(cameras: Sequence[CameraConfig]) -> list[str]:
    """Cameras that are recordings, which the service would wait for in vain or take for the present."""
    return [
        f'[[camera]] "{camera.name}": kind = "{RECORDED}" is a recording, not a camera. Set kind to {live_kinds()}; '
        "`companion setup` writes such a configuration, `companion configs` lists examples. `companion replay` processes a "
        "recording"
        for camera in cameras
        if camera.kind == RECORDED
    ]


def stream_problems(config: Config) -> list[str]:
    """Streams that the service opens and that other machines could reach without keys."""
    if config.publish.keys:
        return []
    addresses = {name: getattr(config.publish, name) for name in opened_streams(config)}
    return [without_keys_text(name, address) for name, address in addresses.items() if beyond_loopback(address)]
