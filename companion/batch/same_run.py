"""Whether the files of a flight are of one run of the service: copies of two vehicles in one folder can have one name."""

from __future__ import annotations

from typing import Final

from core.types import CameraInfo
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb

EARLIER_NS: Final = 1_000_000_000
"""A file whose first exposure is farther than this before those of the files before it is of another run."""

_BOOT: Final = "boot of the computer"


class SameRun:
    """Compares each file of a flight with the ones before it: configuration, cameras, times and the boot of the computer. All files
    of a run begin with the same description of it."""

    def __init__(self) -> None:
        self._run: pb.RunInfo | None = None
        self._cameras: dict[str, CameraInfo] = {}
        self._newest_ns: int | None = None
        self._awaits_frame = False
        self._boot = ""
        self._differences: list[str] = []

    def begin_file(self, source: McapRecording) -> None:
        """Compares the descriptions in a file."""
        self._awaits_frame = True
        self._run = self._run or source.run
        if source.run is not None and source.run != self._run:
            self._differences.append("software or configuration")
        self._cameras = {info.camera: info for info in source.cameras} | self._cameras
        self._differences += [
            f"description of camera {info.camera}" for info in source.cameras if info != self._cameras[info.camera]
        ]

    def frame(self, t_exposure_ns: int) -> None:
        """Compares the time of the first frame of a file."""
        if self._awaits_frame and self._newest_ns is not None and t_exposure_ns < self._newest_ns - EARLIER_NS:
            self._differences.append("times, which begin before the end of the file before it")
        self._awaits_frame = False
        self._newest_ns = max(t_exposure_ns, self._newest_ns or t_exposure_ns)

    def boot(self, boot_id: str) -> None:
        """Compares the boot that a health report states; "": an older version, without it."""
        self._boot = self._boot or boot_id
        if boot_id and boot_id != self._boot and _BOOT not in self._differences:
            self._differences.append(_BOOT)

    def end_file(self) -> str:
        """How the file differs, as text; "" where it does not."""
        differences, self._differences = self._differences, []
        if not differences:
            return ""
        return (
            f"of another run than the first file of the flight ({', '.join(differences)}): the results of both are mixed; put "
            "the logs of each vehicle into a folder of its own"
        )
