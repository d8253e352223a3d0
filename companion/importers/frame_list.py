"""A recording made of a list of image files with times, and samples of attitude and position."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import BadData, Event

from ..pipeline.sync import NS
from .frames_csv import FrameRow
from .images import DepthImages
from .report import ImportOptions, Report

_LONGEST_NS: Final = 1 << 62
"""Shifted times, with the delay of the arrival, fit into the 63 bits of a log's stamps."""

Samples = tuple[list[AttitudeSample], list[PoseSample]]


class FrameListSource:
    """A recording (EventSource). Problems with single images are added to `report`; the rest is delivered. rows: in order
    of time, of the file `list_name`; frame_count: number of frames that it names."""

    def __init__(
        self,
        images: DepthImages,
        rows: Sequence[FrameRow],
        samples: Samples,
        options: ImportOptions,
        report: Report,
        frame_count: int,
        list_name: str,
    ) -> None:
        self._images, self._rows, self._options, self._report = images, rows, options, report
        self._attitudes, self._poses = samples
        self.frame_count, self._list_name = frame_count, list_name
        self._shift_ns = self._shift()

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The camera."""
        return (self._images.info,)

    @property
    def files(self) -> dict[int, str]:
        """Sequence of each frame -> name of its file."""
        return {row.number: row.file for row in self._rows}

    def events(self) -> Iterator[Event]:
        """All events in order of arrival; images are read when due."""

        def arrival(item: AttitudeSample | PoseSample | FrameRow) -> int:
            return self._arrival_ns(item) if isinstance(item, FrameRow) else item.t_arrival_ns

        # samples come before a frame of the same arrival, which may use them
        items: list[AttitudeSample | PoseSample | FrameRow] = [*self._attitudes, *self._poses, *self._rows]
        for item in sorted(items, key=arrival):
            if not isinstance(item, FrameRow):
                yield replace(item, t_ns=item.t_ns + self._shift_ns, t_arrival_ns=item.t_arrival_ns + self._shift_ns)
                continue
            try:
                yield self._frame(item)
            except BadData as error:
                self._report.problem("image", f"{self._list_name} line {item.line}: {error}")

    def _arrival_ns(self, row: FrameRow) -> int:
        return row.t_ns + round(self._options.frame_latency_s * NS)

    def _frame(self, row: FrameRow) -> DepthFrame:
        return DepthFrame(
            camera=self._images.info.camera,
            sequence=row.number,
            t_exposure_ns=row.t_ns + self._shift_ns,
            t_arrival_ns=self._arrival_ns(row) + self._shift_ns,
            depth_mm=self._images.read(row),
        )

    def _shift(self) -> int:
        """Shift in whole seconds that makes all timestamps 0 or later, as a log requires. Raises BadData for times too far apart."""
        samples: list[AttitudeSample | PoseSample] = [*self._attitudes, *self._poses]
        times = [r.t_ns for r in self._rows] + [s.t_ns for s in samples]
        first, last = min(times), max(times)
        shift_ns = -(first // NS) * NS if first < 0 else 0
        if last - first > _LONGEST_NS:
            raise BadData(
                f"{self._list_name}: times from {first} ns to {last} ns do not fit into one log; correct the first or the last stamp"
            )
        if shift_ns:
            self._report.note(f"all timestamps were shifted by {shift_ns // NS} s, so that none is negative")
        return shift_ns
