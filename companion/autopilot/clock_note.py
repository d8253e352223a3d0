"""The note for the ground station on an uncertain clock of the autopilot: the cause of frames that are not used in
turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from drivers.mavlink.session_types import LinkStatus

NS: Final = 1_000_000_000
LARGE_BOUND_NS: Final = 10_000_000
"""Error bound of the autopilot's clock that is reported: 1 degree in a turn of 100 degrees a second."""
LASTS_NS: Final = 2 * NS
"""A large bound that is gone sooner is not sent: the first answers after a start are slow."""
KEEP_NS: Final = 10 * NS
"""A note is kept for this time after the bound was large last. While a clock is corrected the bound changes with each
answer, and each change of a note is a text."""
NO_ANSWERS: Final = "no TIMESYNC answers, attitudes late"
UNCERTAIN: Final = "clock uncertain, blind in fast turns"


@dataclass(slots=True)
class ClockNote:
    """Decides on the note by each state of the link."""

    _first_ns: int | None = None  # of the large bounds that are less than KEEP_NS apart
    _newest_ns: int = 0

    def text(self, link: LinkStatus | None, now_ns: int) -> str:
        """Returns the note now; empty: none. It contains no value, which would change each time."""
        clock = None if link is None else link.clock
        if clock is not None and clock.bound_ns is not None and clock.bound_ns > LARGE_BOUND_NS:
            self._first_ns = now_ns if self._first_ns is None else self._first_ns
            self._newest_ns = now_ns
        if link is not None and not link.timesync_answered:
            return NO_ANSWERS
        if self._first_ns is None:
            return ""
        if now_ns - self._newest_ns > KEEP_NS:
            self._first_ns = None
            return ""
        return UNCERTAIN if self._newest_ns - self._first_ns >= LASTS_NS else ""
