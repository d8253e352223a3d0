"""Checks the stamps of the images of a ROS 2 recording."""

from __future__ import annotations

from statistics import median
from typing import Final

from ..console import counted
from ..pipeline.sync import NS
from .report import Report

MAX_AHEAD_S: Final = 0.1
"""Images stamped later than this after their log time, where the attitude is not, were stamped by another clock than that."""


class ImageStamps:
    """The stamps of the images of a topic, in file order.

    where: file, for the report. recorder_behind_ns: by which the log times are before the stamps of the attitude; None: not known,
    since log times and stamps are of different clocks."""

    def __init__(self, where: str, topic: str, recorder_behind_ns: int | None) -> None:
        self._where, self._topic, self._recorder_behind_ns = where, topic, recorder_behind_ns
        self._newest_ns: int | None = None
        self._not_later: list[int] = []
        self._ahead_ns: list[int] = []

    def add(self, number: int, t_ns: int, log_ns: int) -> None:
        """Adds an image."""
        self._ahead_ns.append(t_ns - log_ns)
        if self._newest_ns is not None and t_ns <= self._newest_ns:
            self._not_later.append(number)
        else:
            self._newest_ns = t_ns

    def report(self, report: Report) -> None:
        """Reports stamps with which images cannot be used, or are matched with an attitude of another time."""
        if self._not_later:
            report.problem(
                "order",
                f"{self._where}: {counted(len(self._not_later), 'image')} of {self._topic} have a stamp that is not later than one "
                f"before, the first is image {self._not_later[0]}: a replay leaves them out; correct the driver's stamps, or record "
                "each image once",
            )
        if self._recorder_behind_ns is None or not self._ahead_ns:
            return
        ahead_s = (median(self._ahead_ns) - self._recorder_behind_ns) / NS
        if ahead_s > MAX_AHEAD_S:
            report.warning(
                "stamp",
                f"{self._where}: images of {self._topic} are stamped {ahead_s:.2f} s after their log time: the clock of the camera is "
                "ahead, and each image gets the attitude of a later time; synchronise the clocks (chrony, PTP) and record again",
            )
