"""A serial line to an autopilot."""

from __future__ import annotations

import contextlib
import errno
import os
import termios
import time

import serial

from ..base import BadData, DeviceLost, DeviceNotFound
from .address import Address
from .transport import READ_BYTES, Chunk, reason, wait_readable

_BACKLOG_S = 0.1
"""Nothing is sent while the buffer of the line holds bytes for a longer time."""
_DRAIN_S = 0.5
"""Longest time for which `close` waits until the last messages are sent."""


class SerialLine:
    """A serial port or a pty."""

    sends_first = False
    sources = None
    flood = None
    backlog_remedy = "set 921600 baud, and check the cable and its flow control"

    def __init__(self, address: Address) -> None:
        self._address, self._rest = address, b""
        try:
            self._port = serial.Serial(address.place, address.number, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, termios.error) as error:  # SerialException is an OSError; others if it is unplugged meanwhile
            raise DeviceNotFound(f"{address}: {reason(error)}; {_serial_remedy(error, address.place)}") from error
        except ValueError as error:
            raise BadData(
                f"{address}: {error}; choose a rate that the port supports, such as 921600 or 57600"
            ) from error

    @property
    def bytes_per_s(self) -> float | None:
        return self._address.number / 10.0  # 8 bits, start and stop

    @property
    def backlog_bytes(self) -> int:
        return round(_BACKLOG_S * self._address.number / 10.0)

    @property
    def waiting_bytes(self) -> int:
        try:
            return int(self._port.out_waiting)
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {reason(error)}; check its cable") from error

    def wait(self, timeout_s: float) -> None:
        try:
            wait_readable(self._port.fileno(), timeout_s)
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {reason(error)}; check its cable") from error

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        try:
            # asked each time: of an empty line a read brings the same nothing as of one that was disconnected
            if not wait_readable(self._port.fileno(), timeout_s):
                return []
            data = os.read(self._port.fileno(), READ_BYTES)
            arrival_ns = time.monotonic_ns()  # after it: before, a byte might arrive between the two
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {reason(error)}; check its cable") from error
        if not data:
            raise DeviceLost(f"{self._address}: the device disconnected; check its cable")
        return [(data, arrival_ns)]

    def write(self, data: bytes) -> None:
        # a message that was cut short is completed first: the receiver would take the next one for the rest of it
        self._rest = self._rest[self._sent(self._rest) :]
        if not self._rest:
            sent = self._sent(data)
            self._rest = data[sent:] if sent else b""

    def _sent(self, data: bytes) -> int:
        """Sends and returns the number of bytes sent: 0 if the buffer is full, as later messages have newer content."""
        try:
            return os.write(self._port.fileno(), data) if data else 0
        except BlockingIOError:
            return 0
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {reason(error)}; check its cable") from error

    def answer(self, chunk: int) -> None:
        pass  # a serial line has one other end

    def close(self) -> None:
        with contextlib.suppress(OSError, serial.SerialException, TypeError, termios.error):
            until_ns = time.monotonic_ns() + round(_DRAIN_S * 1e9)
            while self._port.out_waiting and time.monotonic_ns() < until_ns:
                time.sleep(0.005)
            if self._port.out_waiting:  # the device takes no bytes: the kernel would wait for 30 s
                self._port.reset_output_buffer()
        self._port.close()


def _serial_remedy(error: BaseException, place: str) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return "add the user to the group that owns the port (dialout)"
    if number == errno.ENOENT:
        return "plug it in, and name it as in /dev/serial/by-id"
    if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
        return f"another program holds {place}: stop it, or put mavlink-router between"
    return "check the name of the port"
