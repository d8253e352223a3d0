"""Decides which cameras are blind: no frames, invalid frames and old frames have the same effect."""

from __future__ import annotations

from dataclasses import dataclass

from ..cameras.status import CameraCondition, CameraStatus
from ..pipeline.results import PrismsResult

NS = 1_000_000_000


@dataclass(slots=True)
class _Camera:
    exposure_ns: int | None = None  # of the newest valid frame
    newest_ns: int | None = None  # of the newest frame, valid or not
    cause: str = "no frame yet"
    sequence: int = 0


class StalenessMonitor:
    """Takes the results and answers for any instant. A camera is blind until its first valid result, after an invalid
    one, and when the newest valid exposure is older than timeout_s."""

    def __init__(self, cameras: tuple[str, ...], timeout_s: float) -> None:
        self._timeout_ns = round(timeout_s * NS)
        self._cameras = {camera: _Camera() for camera in cameras}

    def result(self, result: PrismsResult) -> None:
        """Adds the result of a frame."""
        seen = self._cameras[result.camera]
        # a valid frame is the newest also after its exposures began again at an earlier time
        if result.valid or seen.newest_ns is None or result.t_exposure_ns >= seen.newest_ns:
            seen.newest_ns, seen.sequence = result.t_exposure_ns, result.sequence
        if result.valid:
            # a timestamp in the future would not become old
            seen.exposure_ns, seen.cause = min(result.t_exposure_ns, result.t_arrival_ns), ""
        else:
            seen.cause = result.cause_text

    def age_ns(self, camera: str, now_ns: int) -> int | None:
        """Age of the newest valid exposure; None: there was none."""
        exposure_ns = self._cameras[camera].exposure_ns
        return None if exposure_ns is None else now_ns - exposure_ns

    def cause(self, camera: str, now_ns: int, status: CameraStatus | None = None) -> str:
        """Why a camera is blind, as text; empty if it is not."""
        seen = self._cameras[camera]
        age_ns = self.age_ns(camera, now_ns)
        if age_ns is not None and age_ns <= self._timeout_ns and not seen.cause:
            return ""
        if status is not None and status.condition is not CameraCondition.RUNNING:
            if status.last_loss and status.condition in (CameraCondition.STARTING, CameraCondition.LOST):
                # one text for all attempts to open it again: each change is logged
                return f"lost: {status.last_loss.removeprefix(f'camera {camera}: ')}"
            if status.condition is CameraCondition.SILENT:
                return status.cause  # says so
            return f"{status.condition}: {status.cause.removeprefix(f'camera {camera}: ')}"
        if seen.cause:
            return seen.cause
        return f"the newest valid exposure is {(age_ns or 0) / NS:.1f} s old"

    def newest_ns(self, camera: str) -> int | None:
        """Exposure of the newest frame with a result, valid or not; None: there was none."""
        return self._cameras[camera].newest_ns

    def sequence(self, camera: str) -> int:
        """Sequence number of the newest frame with a result, valid or not; 0: there was none."""
        return self._cameras[camera].sequence
