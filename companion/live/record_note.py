"""Lines of the journal about the recording: its place and its data rate."""

from __future__ import annotations

from pathlib import Path

from ..config.camera import CameraConfig
from ..config.loader import Config
from ..log.recorder import RecordStatus
from ..paths import Folders

MEASURED_NS = 60_000_000_000


def record_note(config: Config, folders: Folders) -> str:
    """Returns where this configuration records, and the greatest amount per minute, with depth images before
    compression."""
    record = config.record
    if record.record == "off":
        return 'nothing is recorded: [record] record = "off"'
    place = record.place(folders.state)
    when = "while the vehicle is armed" if record.record == "armed" else "always"
    limits = f"[record] budget_mb = {record.budget_mb:g} deletes the oldest flights first"
    if not record.depth:
        return f"recording to {place} {when}, without depth images; {limits}"
    mb = sum(_raw_mb_per_minute(camera, record.depth_hz) for camera in config.cameras)
    return (
        f"recording to {place} {when}, up to {mb:.0f} MB a minute before compression; [record] depth_hz, now "
        f"{record.depth_hz:g} (0: every image), lowers it; {limits}"
    )


def _raw_mb_per_minute(camera: CameraConfig, depth_hz: float) -> float:
    hz = min(camera.fps, depth_hz) if depth_hz > 0.0 else camera.fps
    return camera.width_px * camera.height_px * 2 * hz * 60.0 / 1e6


class RecordRate:
    """Measures the amount recorded in the first minute."""

    def __init__(self) -> None:
        self._begun: tuple[int, int] | None = None
        self._done = False

    def note(self, status: RecordStatus, now_ns: int) -> str:
        """Returns the measured rate, once; otherwise empty. A stop of the recording restarts the measurement."""
        if self._done or not status.recording:
            self._begun = None
            return ""
        if self._begun is None:
            self._begun = now_ns, status.bytes
        begun_ns, begun_bytes = self._begun
        if now_ns - begun_ns < MEASURED_NS:
            return ""
        self._done = True
        mb = (status.bytes - begun_bytes) / 1e6 / ((now_ns - begun_ns) / MEASURED_NS)
        return f"recorded {mb:.0f} MB in the last minute, in {Path(status.file).parent}"
