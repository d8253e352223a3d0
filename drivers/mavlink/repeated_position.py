"""Detects a position that is sent again with new timestamps while the vehicle moves.

An estimator that runs never gives the same position and velocity twice: in recordings of PX4, ArduSub and ArduCopter (SITL) none
of 10,000 LOCAL_POSITION_NED repeats the numbers of the one before. Repeated numbers are those of an earlier time. ArduPilot stamps
the message with the time of sending, so that it repeats while its estimator does not run, or gives fewer positions than are sent.
A relay may send the newest message again with a stamp of its own.

A simulator without noise repeats the position of a vehicle at rest, which is true: repetitions with a velocity of zero are used."""

from __future__ import annotations

from typing import Final

MOVING_M_S: Final = 0.05
"""A repeated velocity of which no component is greater is one of a vehicle at rest."""

Numbers = tuple[float, ...]


class RepeatedPosition:
    """Takes the messages of one kind in order of arrival."""

    def __init__(self) -> None:
        self._numbers: Numbers = ()
        self._first_ns = 0  # stamp of the first message in a row with these numbers

    def take(self, boot_ns: int, numbers: Numbers) -> bool:
        """Takes a message; returns whether it is not to be used. A copy with the same stamp is no repetition.

        Args:
            boot_ns: its timestamp.
            numbers: position and velocity as received, in m and m/s."""
        if numbers != self._numbers:
            self._numbers, self._first_ns = numbers, boot_ns
            return False
        return boot_ns > self._first_ns and max(map(abs, numbers[3:])) > MOVING_M_S
