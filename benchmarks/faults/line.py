"""The line from the autopilot to the companion computer, with its faults."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter

from .switches import MS, Switches

LINE_NS = 3 * MS
ATTITUDE, ATTITUDE_QUATERNION, TIMESYNC = 30, 31, 111


class OnLine(NamedTuple):
    """A message on its way from the autopilot."""

    arrival_ns: int  # of the flight
    number: int  # order of the messages
    data: bytes
    measured_ns: int  # of a correct attitude, ns of the flight; -1: it is none


class AutopilotLine:
    """Takes messages of autopilots with `send` and `put`, and gives those that have arrived with `take`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._messages: list[OnLine] = []
        self._numbers = itertools.count()
        self._splitter, self._pack = MessageSplitter(), dialect.MAVLink(None, 1, 1)
        self._attitude_bytes: dict[int, bytes] = {}
        self._attitude_ns: dict[int, int] = {}

    def clear(self) -> None:
        """Loses what is on its way."""
        self._messages.clear()

    def take(self, flown_ns: int) -> list[OnLine]:
        """Returns the messages that have arrived, in order."""
        due = sorted(item for item in self._messages if item.arrival_ns <= flown_ns)
        self._messages = [item for item in self._messages if item.arrival_ns > flown_ns]
        return due

    def put(self, data: bytes, arrival_ns: int, measured_ns: int = -1) -> None:
        """Adds a message without a fault."""
        self._messages.append(OnLine(arrival_ns, next(self._numbers), data, measured_ns))

    def send(self, data: bytes, s: Switches, flown_ns: int) -> None:
        """Adds a message of the autopilot, with the faults of the line."""
        number, measured_ns = int.from_bytes(data[7:10], "little"), -1
        if number in (ATTITUDE, ATTITUDE_QUATERNION):
            if flown_ns - self._attitude_ns.get(number, -s.attitude_gap_ns) < s.attitude_gap_ns:
                return
            self._attitude_ns[number] = flown_ns
            data, measured_ns = self._attitude(number, data, s, flown_ns)
        delay_ns = LINE_NS + s.delay_ns
        if number == TIMESYNC and (s.answer_delay_ns or s.answer_shift_ns or s.answer_scatter_ns):
            shift_ns = s.answer_shift_ns + round(self._rng.uniform(-1.0, 1.0) * s.answer_scatter_ns)
            data = self._changed(data, lambda m: setattr(m, "tc1", max(1, m.tc1 + shift_ns) if m.tc1 else 0))
            delay_ns += s.answer_delay_ns
        if s.jitter_ns:
            delay_ns += round(self._rng.uniform(0.0, s.jitter_ns))
        if s.route_delay_ns and self._rng.random() < 0.5:
            delay_ns += s.route_delay_ns
        if not s.link_up or self._rng.random() < s.lost_share:
            return
        if self._rng.random() < s.noise_share:
            at, measured_ns = int(self._rng.integers(len(data))), -1
            data = data[:at] + bytes([data[at] ^ int(self._rng.integers(1, 256))]) + data[at + 1 :]
        arrival_ns = flown_ns + delay_ns
        if s.burst_ns:
            arrival_ns = -(-arrival_ns // s.burst_ns) * s.burst_ns
        self.put(data, arrival_ns, measured_ns)
        if s.copied_share and self._rng.random() < s.copied_share:
            self.put(data, arrival_ns + s.copy_delay_ns, measured_ns)

    def _attitude(self, number: int, data: bytes, s: Switches, flown_ns: int) -> tuple[bytes, int]:
        """Returns an attitude with its faults, and the instant of its measurement; -1: it is not correct."""
        measured_ns = -1
        if s.repeats_stamp:
            data = self._attitude_bytes.get(number, data)
        elif not s.not_a_number and not s.repeats_attitude:
            measured_ns = flown_ns
            self._attitude_bytes[number] = data
        if s.negates and number == ATTITUDE_QUATERNION and self._rng.random() < 0.5:
            data = self._changed(data, _negate)
        return data, measured_ns

    def _changed(self, data: bytes, change: Callable[[Any], object]) -> bytes:
        (message,) = self._splitter.feed(data)
        change(message)
        return bytes(message.pack(self._pack))


def _negate(message: Any) -> None:
    """Gives a quaternion the other sign."""
    for name in ("q1", "q2", "q3", "q4"):
        setattr(message, name, -getattr(message, name))
