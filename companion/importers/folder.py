"""Reads a directory with depth PNGs, intrinsics.json, frames.csv and optionally a .tlog.

frames.csv: `file`, `t_ns` (mid-exposure), `roll_rad`, `pitch_rad`, `yaw_rad` (frd to ned, ZYX, as in MAVLink), and
optionally `x_m`, `y_m`, `z_m` (ned). Other columns are ignored. With a .tlog, attitude and position are taken from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from core.frames import quaternion_from_euler
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import BadData, Event

from ..pipeline.sync import NS
from .frames_csv import FrameRow, looks_like_degrees, read_rows
from .intrinsics_json import read_intrinsics
from .png import read_depth_png
from .report import ImportOptions, Report, spans, uncovered
from .tlog import TiltRow, tlog_samples


class FolderSource:
    """A recording in a directory (EventSource). Problems with single rows and images are added to `report`; the rest is
    delivered. Raises BadData where nothing can be delivered. frame_count: number of rows."""

    def __init__(self, folder: Path, options: ImportOptions, report: Report) -> None:
        self._folder, self._options, self._report = folder, options, report
        self._info, self._coding = read_intrinsics(folder / "intrinsics.json", options)
        self._rows, self.frame_count = read_rows(folder / "frames.csv", report)
        if not self._rows:
            raise BadData(f"{folder / 'frames.csv'}: no usable row; expected one for each depth image")
        self._report_unlisted()
        self._attitudes, self._poses = self._samples()
        self.shift_ns = self._shift()

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The camera."""
        return (self._info,)

    def close(self) -> None:
        """Does nothing: no file stays open."""

    def events(self) -> Iterator[Event]:
        """All events in order of arrival; images are read when due."""

        def arrival(item: AttitudeSample | PoseSample | FrameRow) -> int:
            return self._arrival_ns(item) if isinstance(item, FrameRow) else item.t_arrival_ns

        # samples come before a frame of the same arrival, which may use them
        items: list[AttitudeSample | PoseSample | FrameRow] = [*self._attitudes, *self._poses, *self._rows]
        for item in sorted(items, key=arrival):
            if not isinstance(item, FrameRow):
                yield self._shifted(item)
                continue
            try:
                yield self._frame(item)
            except BadData as error:
                self._report.problem("image", f"frames.csv line {item.line}: {error}")

    def _arrival_ns(self, row: FrameRow) -> int:
        return row.t_ns + round(self._options.frame_latency_s * NS)

    def _frame(self, row: FrameRow) -> DepthFrame:
        k = self._info.intrinsics
        depth_mm = read_depth_png(
            self._folder / row.file, (k.width, k.height), self._coding.unit_mm, self._coding.invalid
        )
        return DepthFrame(
            camera=self._info.camera,
            sequence=row.number,
            t_exposure_ns=row.t_ns + self.shift_ns,
            t_arrival_ns=self._arrival_ns(row) + self.shift_ns,
            depth_mm=depth_mm,
        )

    def _shifted(self, s: AttitudeSample | PoseSample) -> AttitudeSample | PoseSample:
        t_ns, arrival_ns = s.t_ns + self.shift_ns, s.t_arrival_ns + self.shift_ns
        if isinstance(s, AttitudeSample):
            return AttitudeSample(t_ns, arrival_ns, s.q_ned_frd_wxyz, s.rates_frd_rad_s)
        return PoseSample(t_ns, arrival_ns, s.position_ned_m, s.velocity_ned_m_s, s.reset_counter)

    def _shift(self) -> int:
        """Shift in whole seconds that makes all timestamps 0 or later, as a log requires."""
        samples: list[AttitudeSample | PoseSample] = [*self._attitudes, *self._poses]
        first = min([r.t_ns for r in self._rows] + [s.t_ns for s in samples])
        shift_ns = -(first // NS) * NS if first < 0 else 0
        if shift_ns:
            self._report.note(f"all timestamps were shifted by {shift_ns // NS} s, so that none is negative")
        return shift_ns

    def _samples(self) -> tuple[list[AttitudeSample], list[PoseSample]]:
        log = self._tlog()
        exposures = [r.t_ns for r in self._rows]
        if log is not None:
            rows = [TiltRow(r.t_ns, r.euler_rad[0], r.euler_rad[1]) for r in self._rows if r.euler_rad is not None]
            attitudes, poses = tlog_samples(log, (min(exposures), max(exposures)), rows, self._options, self._report)
        else:
            attitudes = [
                AttitudeSample(r.t_ns, r.t_ns, quaternion_from_euler(*r.euler_rad))
                for r in self._rows
                if r.euler_rad is not None and not looks_like_degrees(r)
            ]
            poses = [PoseSample(r.t_ns, r.t_ns, r.position_ned_m) for r in self._rows if r.position_ned_m is not None]
            self._report_unusable()
        missing = uncovered(exposures, [a.t_ns for a in attitudes], self._options.sync)
        if missing and log is not None:
            missing_ns = set(missing)
            lines = spans(r.line for r in self._rows if r.t_ns in missing_ns)
            self._report.problem(
                "attitude",
                f"{log.name}: no attitude near the frames of frames.csv line {lines}; these frames are kept without "
                "attitude",
            )
        return attitudes, poses

    def _report_unusable(self) -> None:
        """Reports attitudes and positions of frames.csv that are not used."""
        path = self._folder / "frames.csv"
        without_attitude = [r.line for r in self._rows if r.euler_rad is None]
        if without_attitude:
            self._report.problem(
                "attitude",
                f"{path}: {len(without_attitude)} rows without a usable attitude (line {spans(without_attitude)}): "
                "the frames are kept without attitude; fill in roll_rad, pitch_rad and yaw_rad, or add a .tlog",
            )
        too_large = [r.line for r in self._rows if looks_like_degrees(r)]
        if too_large:
            self._report.problem(
                "attitude",
                f"{path}: {len(too_large)} rows with angles of more than a full turn (line {spans(too_large)}): the "
                "frames are kept without attitude; roll_rad, pitch_rad and yaw_rad must be radians, these look like "
                "degrees",
            )
        without_position = [r.line for r in self._rows if r.position_ned_m is None]
        if 0 < len(without_position) < len(self._rows):
            self._report.problem(
                "position",
                f"{path}: {len(without_position)} rows without a usable position (line {spans(without_position)}): "
                "the frames are kept without position; fill in x_m, y_m and z_m",
            )

    def _tlog(self) -> Path | None:
        if self._options.tlog is not None or not self._options.use_tlog:
            return self._options.tlog
        found = sorted(self._folder.glob("*.tlog"))
        if len(found) > 1:
            names = ", ".join(f.name for f in found)
            raise BadData(
                f"{self._folder}: several logs ({names}); choose one with --tlog FILE or use none with --no-tlog"
            )
        return found[0] if found else None

    def _report_unlisted(self) -> None:
        """Reports images without a row: they have no time and are not used."""
        listed = {(self._folder / r.file).resolve() for r in self._rows}
        for parent in sorted({p.parent for p in listed}):
            unlisted = [p.name for p in sorted(parent.glob("*.png")) if p not in listed]
            if unlisted:
                shown = ", ".join(unlisted[:3]) + (", ..." if len(unlisted) > 3 else "")
                self._report.problem(
                    "gap",
                    f"{self._folder / 'frames.csv'}: {len(unlisted)} images in {parent.name}/ have no row ({shown}): "
                    "they have no time and are left out; add their rows, or move the images away",
                )
