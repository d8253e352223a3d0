"""Options and report of the importers."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median

from ..config.camera import CameraConfig
from ..config.sync import SyncParams
from ..pipeline.sync import NS

LATENCY_S = 0.05
BASE_FRAME = "base_link"
SHOWN = 8
"""Number of problems per kind that are printed; the rest is counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosTopics:
    """Topics of a ROS 2 recording; None: the only matching one."""

    depth: str | None = None
    camera_info: str | None = None
    attitude: str | None = None
    pose: str | None = None
    base_frame: str = BASE_FRAME


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options of an import."""

    # name and overrides of the recording
    camera: CameraConfig = field(default_factory=lambda: CameraConfig(name="front"))
    frame_latency_s: float = LATENCY_S  # from mid-exposure to arrival where the recording does not contain it
    tlog: Path | None = None
    use_tlog: bool = True
    tlog_epoch_us: int | None = None  # unix microseconds of t_ns 0
    system_id: int | None = None  # of the vehicle, if the log has several
    topics: RosTopics = field(default_factory=RosTopics)
    sync: SyncParams = field(default_factory=SyncParams)


class _Texts:
    """Texts by kind: of each kind the first SHOWN, and the number of the others."""

    def __init__(self) -> None:
        self._shown: list[str] = []
        self._numbers: Counter[str] = Counter()

    def add(self, kind: str, text: str) -> None:
        self._numbers[kind] += 1
        if self._numbers[kind] <= SHOWN:
            self._shown.append(text)

    def all(self) -> list[str]:
        more = [f"... and {n - SHOWN} more: {kind}" for kind, n in self._numbers.items() if n > SHOWN]
        return self._shown + more


class Report:
    """Collects what an importer reports. notes: its decisions that the user should know."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self._problems, self._warnings = _Texts(), _Texts()

    def problem(self, kind: str, text: str) -> None:
        """Adds a missing or unused part: the import fails, and the readable part is kept."""
        self._problems.add(kind, text)

    def warning(self, kind: str, text: str) -> None:
        """Adds what will limit the use of the log, although nothing is missing."""
        self._warnings.add(kind, text)

    def note(self, text: str) -> None:
        """Adds a note once."""
        if text not in self.notes:
            self.notes.append(text)

    def all_problems(self) -> list[str]:
        """Returns the problems: of each kind the first SHOWN, and the number of further ones."""
        return self._problems.all()

    def all_warnings(self) -> list[str]:
        """Returns the warnings in the same form."""
        return self._warnings.all()


def spans(numbers: Iterable[int]) -> str:
    """3, 4, 5, 9 as "3-5, 9"."""
    runs: list[list[int]] = []
    for n in sorted(numbers):
        if runs and n == runs[-1][1] + 1:
            runs[-1][1] = n
        else:
            runs.append([n, n])
    return ", ".join(f"{a}-{b}" if b > a else str(a) for a, b in runs)


def uncovered(exposures_ns: Sequence[int], attitudes_ns: Sequence[int], sync: SyncParams) -> list[int]:
    """Exposures without an attitude near enough before or after, whatever its arrival."""
    stamps = sorted(attitudes_ns)
    out = []
    for t in exposures_ns:
        i = bisect_left(stamps, t)
        near = [abs(stamps[k] - t) for k in (i - 1, i) if 0 <= k < len(stamps)]
        between = len(near) == 2 and stamps[i] - stamps[i - 1] <= sync.max_gap_s * NS
        if not near or (min(near) > sync.max_extrapolation_s * NS and not between):
            out.append(t)
    return out


def attitude_rate_problem(exposures_ns: Sequence[int], attitudes_ns: Sequence[int], sync: SyncParams) -> str:
    """Why the attitudes come too seldom, "" if they do not: frames between two attitudes farther apart than
    `max_gap_s` cannot be used, as in a log of a telemetry radio (2 to 4 Hz)."""
    stamps = sorted(set(attitudes_ns))
    if len(stamps) < 3 or not exposures_ns:
        return ""
    interval_s = median(b - a for a, b in pairwise(stamps)) / NS
    if interval_s <= sync.max_gap_s:
        return ""
    usable = len(exposures_ns) - len(uncovered(exposures_ns, stamps, sync))
    return (
        f"the attitude comes at {1.0 / interval_s:.1f} Hz: {usable} of {len(exposures_ns)} frames can be used, since nothing "
        f"is interpolated between attitudes more than {sync.max_gap_s:g} s apart. A log of a telemetry radio is too slow: "
        "take the autopilot's own log (PX4 .ulg, ArduPilot .bin), or record ATTITUDE at 50 Hz on the vehicle"
    )
