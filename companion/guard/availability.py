"""Announces when the guard cannot act, when it can act again, and when the vehicle does not acknowledge commands."""

from __future__ import annotations

from dataclasses import dataclass

from .states import Announcement, Output

NS = 1_000_000_000
DOUBT_NS = 2 * NS
"""A doubt is announced if it lasts this long: after a start, the first COMMAND_ACK takes a moment."""


@dataclass(slots=True)
class Availability:
    """What was announced about the ability of the guard to act. Each change is announced once in a watched mode."""

    _lost_ns: int | None = None  # instant since which the guard cannot act; None: it can, or it watches no mode
    _doubt: str = ""  # the newest reason
    _doubt_ns: int = 0  # instant since which it is the reason
    _announced_doubt: str = ""  # announced since _lost_ns
    _announced_off: bool = False  # the newest announcement is that the guard cannot act
    _vehicle_answers: bool = True

    def lost(self, doubt: str, now_ns: int) -> list[Output]:
        """Returns the announcement that the guard has been unable to act for DOUBT_NS, and of a further reason that has lasted
        as long."""
        if self._lost_ns is None:
            self._lost_ns, self._announced_doubt = now_ns, ""
        if doubt != self._doubt:
            self._doubt, self._doubt_ns = doubt, now_ns
        since_ns = self._doubt_ns if self._announced_doubt else self._lost_ns
        if now_ns - since_ns < DOUBT_NS or self._announced_doubt == doubt:
            return []
        self._announced_doubt, self._announced_off = doubt, True
        return [Announcement(f"guard: off, {doubt}", critical=True)]

    def ended(self) -> None:
        """Records that no mode is watched any more: a doubt in the next one is announced again."""
        self._lost_ns, self._doubt = None, ""

    def restored(self) -> list[Output]:
        """Returns the announcement that the guard can act again, if it was announced that it cannot."""
        self.ended()
        if not self._announced_off:
            return []
        self._announced_off = False
        return [Announcement("guard: active")]

    def vehicle_answers(self, answers: bool) -> list[Output]:
        """Returns the announcement that the vehicle stops acknowledging commands, or acknowledges them again."""
        if answers == self._vehicle_answers:
            return []
        self._vehicle_answers = answers
        text = "guard: vehicle answers again" if answers else "guard: vehicle does not answer, stop may fail"
        return [Announcement(text, critical=not answers)]
