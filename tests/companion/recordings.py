"""Small recordings in other people's formats, written by the tests themselves."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core.types import DepthFrame
from drivers.base import Event
from drivers.logs.reader import McapRecording
from drivers.mavlink.dialect import dialect

WIDTH, HEIGHT = 64, 48
EPOCH_US = 1_700_000_000_000_000
HEADING = "file,t_ns,roll_rad,pitch_rad,yaw_rad,x_m,y_m,z_m"


def depth_image(number: int) -> NDArray[np.uint16]:
    """(HEIGHT, WIDTH) uint16: every pixel of every frame another value."""
    return (1000 + number * 10 + np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)).astype(np.uint16)


def tilt(t_s: float) -> tuple[float, float]:
    """Roll and pitch of a hand that is never still and never the same."""
    return 0.10 * np.sin(1.3 * t_s) + 0.04 * np.sin(3.1 * t_s), -0.3 + 0.08 * np.cos(0.9 * t_s) + 0.03 * np.sin(
        2.3 * t_s
    )


def row(number: int) -> str:
    roll, pitch = tilt(number * 0.1)
    return f"depth/{number:06d}.png,{number * 100_000_000},{roll:.6f},{pitch:.6f},0.1,{number * 0.1:.2f},0,-1.5"


def write_folder(folder: Path, frames: int = 20, rows: Sequence[str] | None = None, heading: str = HEADING) -> Path:
    """A folder recording; `rows` instead of the right ones."""
    (folder / "depth").mkdir(parents=True)
    for i in range(frames):
        assert cv2.imwrite(str(folder / "depth" / f"{i:06d}.png"), depth_image(i))
    content = {"width": WIDTH, "height": HEIGHT, "fx": 45.0, "fy": 45.0, "cx": 31.5, "cy": 23.5}
    (folder / "intrinsics.json").write_text(json.dumps(content))
    lines = [heading, *(rows if rows is not None else [row(i) for i in range(frames)])]
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    return folder


def write_tlog(
    path: Path,
    seconds: float,
    boot_ms: int = 7000,
    start_s: float = 0.0,
    lag_us: int = 400,
    unix_us: int = EPOCH_US,
    rates: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Path:
    """Heartbeats and attitudes at 50 Hz of the same motion, t 0 being unix_us. rates: as written, those of the motion are others."""
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    parts = []
    for i in range(int(seconds * 50) + 1):
        t_s = start_s + i * 0.02
        stamp = unix_us + round(t_s * 1e6) + lag_us
        roll, pitch = tilt(t_s)
        messages = [dialect.MAVLink_attitude_message(boot_ms + round((t_s - start_s) * 1000), roll, pitch, 0.1, *rates)]
        if i % 50 == 0:
            messages.insert(0, dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
        parts += [struct.pack(">Q", stamp) + bytes(m.pack(sender)) for m in messages]
    path.write_bytes(b"".join(parts))
    return path


def events_of(path: Path) -> list[Event]:
    """All events of one of our logs, in file order."""
    with McapRecording(path) as recording:
        return list(recording.events())


def frames_of(path: Path) -> list[DepthFrame]:
    """Its depth frames."""
    return [e for e in events_of(path) if isinstance(e, DepthFrame)]
