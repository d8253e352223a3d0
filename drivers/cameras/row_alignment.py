"""Aligns the rows of both rectified images of a stereo camera, and monitors their calibration.

The calibration of the maker leaves differences of some tenths of a pixel, which change with temperature and shocks. Matching
looks along rows: at 0.3 px an open field is not open any more, at 1 px a street has four times as many planes
(docs/research/stereo-confidence.md). The same error about the vertical axis makes all depths wrong, and nothing in the
images shows it. It is assumed to be ROW_ERROR_SHARE times as great as the measured one (stereo_errors.py)."""

from __future__ import annotations

import statistics
import time
from collections import deque
from dataclasses import dataclass, field, replace

from core.types import Intrinsics

from ..base import BadData
from .corner_matches import Gray, match_corners, refined
from .right_rotation import RightRotation, measure_rotation
from .row_check import judged
from .stereo_errors import assumed_bias_px

MEASUREMENTS, NEWEST = 3, 5
"""The rotation is the median of the newest measurements, of which there must be at least the first number."""
CHECK_SOON_NS, CHECK_AGAIN_NS = 1_000_000_000, 10_000_000_000
"""Time until the next check: until the rotation is known, and since then. A check takes 7 to 10 ms of a fast processor at
672 x 376, 20 ms at 1280 x 720."""
FAULTS = 3
"""Checks that must fail once the calibration has passed one, with none between them that passes: a repeating texture may match a
wrong row."""
LEAST_CHANGE_PX = 0.05
NOTICE_PX, NOTICE_UNCORRECTED_PX = 0.5, 0.3
"""Row differences from which on `notice` reports them, with and without a correction. Smaller ones are usual, and corrected or
nearly without effect."""


@dataclass(slots=True)
class RowAlignment:
    """The alignment of one camera that is open.

    remedy: what to do about a wrong calibration; corrects: the driver applies `rotation` to the right image before it passes
    it to `take`; rotation: of the right camera, known so far; row_error_px: of the calibration as the camera was opened."""

    camera: str
    remedy: str
    corrects: bool
    rotation: RightRotation = field(default_factory=RightRotation)
    row_error_px: float = 0.0
    _measured: deque[RightRotation] = field(default_factory=lambda: deque(maxlen=NEWEST))
    _stated_px: float | None = None
    _passed: bool = False
    _faults: int = 0
    _next_ns: int = 0

    @property
    def due(self) -> bool:
        """Whether the next pair is to be checked."""
        return time.monotonic_ns() >= self._next_ns

    @property
    def settled(self) -> bool:
        """Whether the rotation is known."""
        return len(self._measured) >= MEASUREMENTS

    def take(self, left: Gray, right: Gray, k: Intrinsics) -> bool:
        """Checks a rectified pair and measures its rotation; returns whether that succeeded. `rotation` may be another one
        afterwards. Raises BadData where the calibration is wrong, or worse than stated."""
        matches = match_corners(left, right)
        found = judged(matches, left.shape)
        self._next_ns = time.monotonic_ns() + (CHECK_AGAIN_NS if self._passed and self.settled else CHECK_SOON_NS)
        if found.fault:
            self._faults += 1
            if not self._passed or self._faults >= FAULTS:
                raise BadData(f"camera {self.camera}: {found.fault}; {self.remedy}")
            self._next_ns = time.monotonic_ns() + CHECK_SOON_NS
            return False
        if found.complete:  # a view with few corners does not contradict the faults before it
            self._passed, self._faults = True, 0
        elif self._faults:
            self._next_ns = time.monotonic_ns() + CHECK_SOON_NS
        measured = measure_rotation(refined(matches, left, right), k)
        if measured is None:
            return False
        self._add(self.rotation + measured if self.corrects else measured, k)
        return True

    def opened(self, k: Intrinsics) -> None:
        """The camera states its errors by what is known now."""
        self.row_error_px = self._known().error_px(k)
        self._stated_px = assumed_bias_px(k.width, self.row_error_px)

    def notice(self, k: Intrinsics) -> str:
        """What the user has to know about the opened camera; empty: nothing."""
        rows_px = self._known().greatest_row_px(k)
        if rows_px <= (NOTICE_PX if self.corrects else NOTICE_UNCORRECTED_PX):
            return ""
        done = "the right image is turned to fit" if self.corrects else "the device matches them as they are"
        return (
            f"camera {self.camera}: the rows of both images differ by up to {rows_px:.1f} px; {done}, and an error of "
            f"{assumed_bias_px(k.width, self.row_error_px):.2f} px is assumed for all disparities, so free space ends earlier; "
            f"{self.remedy}"
        )

    def _add(self, rotation: RightRotation, k: Intrinsics) -> None:
        self._measured.append(rotation)
        if not self.settled:
            return
        known = self._known()
        if self._stated_px is not None and known.error_px(k) > self._stated_px:
            raise BadData(
                f"camera {self.camera}: the rows of its images differ by up to {known.greatest_row_px(k):.1f} px, more than when it "
                f"was opened; it is opened again with a greater error of its depths; {self.remedy}"
            )
        turned = replace(known, stretch=0.0)
        if self.corrects and (turned - self.rotation).greatest_row_px(k) > LEAST_CHANGE_PX:
            self.rotation = turned

    def _known(self) -> RightRotation:
        """The median of the measurements; no rotation before there are enough."""
        if not self.settled:
            return RightRotation()
        return RightRotation(
            statistics.median(r.pitch_rad for r in self._measured),
            statistics.median(r.roll_rad for r in self._measured),
            statistics.median(r.stretch for r in self._measured),
        )
