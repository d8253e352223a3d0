"""Announces when the guard cannot act, when it can act again, and when the vehicle does not acknowledge commands."""

from __future__ import annotations

from dataclasses import dataclass

from .states import Announcement, Output

NS = 1_000_000_000
DOUBT_NS = 2 * NS
"""A doubt is announced if it lasts this long: after a start, the first COMMAND_ACK takes a moment."""


@dataclass(slots=True)
class Availability:
    """What was announced about the ability of the guard to act. Each change is announced once."""

    _lost_ns: int = 0
    _announced_doubt: str = ""
    _vehicle_answers: bool = True

    def lost(self, now_ns: int) -> None:
        """Records that the guard cannot act from now on, for a new reason."""
        self._lost_ns = now_ns

    def still_lost(self, doubt: str, now_ns: int) -> list[Output]:
        """Returns the announcement of a doubt that has lasted for DOUBT_NS."""
        if now_ns - self._lost_ns < DOUBT_NS or self._announced_doubt == doubt:
            return []
        self._announced_doubt = doubt
        return [Announcement(f"guard: off, {doubt}", critical=True)]

    def restored(self) -> list[Output]:
        """Returns the announcement that the guard can act again, if a doubt was announced."""
        if not self._announced_doubt:
            return []
        self._announced_doubt = ""
        return [Announcement("guard: active")]

    def vehicle_answers(self, answers: bool) -> list[Output]:
        """Returns the announcement that the vehicle stops acknowledging commands, or acknowledges them again."""
        if answers == self._vehicle_answers:
            return []
        self._vehicle_answers = answers
        text = "guard: vehicle answers again" if answers else "guard: vehicle does not answer, stop may fail"
        return [Announcement(text, critical=not answers)]
