"""Newest position and attitude of the own vehicle, and the jumps of their estimate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from core.types import AttitudeSample, PoseSample

from ..pipeline.heading_jumps import HeadingJumps
from ..pipeline.position_sections import PositionSections

NS: Final = 1_000_000_000
STALE_NS: Final = NS
"""An older position is not sent, and nothing is placed with it. While attitudes are older, the heading may jump unnoticed."""


@dataclass(frozen=True, slots=True)
class Motion:
    """The estimate at one instant."""

    # pose, attitude: the newest ones; None: none has arrived
    pose: PoseSample | None = None
    attitude: AttitudeSample | None = None
    # first stamp after the newest jump of position or heading, or after a gap in which the heading may have jumped; 0:
    # there was none
    jump_ns: int = 0
    # numbers of sections of the position and of jumps of the heading. One changes when something has jumped, or may
    # have in a gap, or when small steps of the position have added up.
    estimate: tuple[int, int] = 0, 0

    def pose_at(self, now_ns: int) -> PoseSample | None:
        """Returns the newest position; None: position or heading are not known now."""
        pose, attitude = self.pose, self.attitude
        if pose is None or attitude is None:
            return None
        return pose if now_ns - min(pose.t_arrival_ns, attitude.t_arrival_ns) <= STALE_NS else None


@dataclass(slots=True)
class OwnMotion:
    """Follows the samples. `take` and `newest` may be called from different threads."""

    newest: Motion = field(default_factory=Motion)
    _sections: PositionSections = field(default_factory=PositionSections)
    _headings: HeadingJumps = field(default_factory=HeadingJumps)

    def take(self, samples: Iterable[AttitudeSample | PoseSample]) -> None:
        """Handles attitudes and positions, in order of arrival."""
        pose, attitude = self.newest.pose, self.newest.attitude
        for sample in samples:
            if isinstance(sample, PoseSample):
                self._sections.take(sample)
                pose = sample
            else:
                self._headings.take(sample)
                attitude = sample
        stepped_ns = 0 if pose is None else self._sections.at(pose.t_ns).jump_ns
        turned_ns = 0 if attitude is None else self._headings.newest_ns(attitude.t_ns)
        self.newest = Motion(pose, attitude, max(stepped_ns, turned_ns), (self._sections.number, self._headings.number))
