"""Transports to an autopilot: serial, UDP in and out, TCP. They give bytes with their arrival times.

    serial:/dev/serial/by-id/usb-...:921600      (the rate may be left out: 921600)
    udpin:0.0.0.0:14540                          waits for the autopilot; answers go to its address
    udpout:127.0.0.1:14550                       sends first, to a router or a ground station
    tcp:127.0.0.1:5760

A transport does not depend on MAVLink. Every failure is a DriverError that names the address, the cause and the
remedy; the owner then closes the transport and opens a new one later."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import socket
import sys
import termios
import time
from dataclasses import dataclass
from typing import Protocol

import serial

from ..base import BadData, DeviceLost, DeviceNotFound
from .udp_flood import FloodFilter

DEFAULT_BAUD = 921_600
_READ_BYTES = 65_536
_MOST_DATAGRAMS = 1024
"""Greatest number of datagrams per read. Dropping one as a flood takes some microseconds; the buffer of the socket
holds about as many."""
_LONGEST_NS = 10_000_000
"""Longest time of one read during a flood, since a frame may wait for it."""
_BUFFER_BYTES = 1 << 20
"""Buffer of a UDP socket, if the system allows it: room for the autopilot beside a flood until the next read."""
_BACKLOG_S = 0.1
"""Nothing is sent while the buffer of a serial line holds bytes for a longer time."""
_TCP_BACKLOG_BYTES = 4096
"""The same of a TCP connection: 0.2 to 0.5 s of the usual messages."""
Chunk = tuple[bytes, int]
"""Bytes and their arrival time, monotonic ns."""
Source = tuple[str, int] | None
"""Host and port of the sender; None: the transport has one other end."""


class Transport(Protocol):
    """An open transport."""

    @property
    def bytes_per_s(self) -> float | None:
        """Data rate; None: no relevant limit."""
        ...

    @property
    def waiting_bytes(self) -> int:
        """Bytes in the buffer of the line that are not sent yet; 0: not known. Raises DeviceLost."""
        ...

    @property
    def backlog_bytes(self) -> int:
        """While more bytes are in the buffer nothing is sent, since distances would arrive old; the newest ones wait."""
        ...

    @property
    def backlog_remedy(self) -> str:
        """What to do about a buffer that stays full."""
        ...

    @property
    def sends_first(self) -> bool:
        """True if the other end sends nothing before it has received a message."""
        ...

    @property
    def sources(self) -> list[Source] | None:
        """The sender of each chunk of the newest `read`; None: there is one other end."""
        ...

    @property
    def flood(self) -> FloodFilter | None:
        """The filter of floods from other addresses; None: there is one other end."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Waits until something has arrived, for at most timeout_s. Raises DeviceLost."""
        ...

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        """Returns what has arrived, after waiting for at most timeout_s. Raises DeviceLost."""
        ...

    def write(self, data: bytes) -> None:
        """Sends at once. A message of which nothing can be sent now is lost. Raises DeviceLost."""
        ...

    def answer(self, chunk: int) -> None:
        """Makes `write` send to the sender of this chunk of the newest `read`, since others may send to the port,
        too."""
        ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Address:
    """Address of an autopilot. kind: serial, udpin, udpout or tcp; place: device or host; number: baud rate or port."""

    kind: str
    place: str
    number: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}:{self.number}"


def parse_address(text: str) -> Address:
    """Returns the address in a text. Raises ValueError that names the valid forms."""
    kind, _, rest = text.partition(":")
    forms = "serial:/dev/serial/by-id/NAME[:BAUD], udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT"
    place, _, number = rest.rpartition(":")
    if kind == "serial" and rest.startswith("/"):
        if not place:
            return Address(kind, rest, DEFAULT_BAUD)
        # by-path names hold colons of their own
        return Address(kind, place, int(number)) if number.isdecimal() else Address(kind, rest, DEFAULT_BAUD)
    if kind in ("udpin", "udpout", "tcp") and place and number.isdecimal() and 0 < int(number) < 65536:
        return Address(kind, place, int(number))
    near = f"; did you mean serial:{text}?" if text.startswith("/dev/") else ""
    raise ValueError(f'"{text}" is not an address{near or f": expected {forms}"}')


def open_transport(address: Address) -> Transport:
    """Opens a transport. Raises DeviceNotFound or BadData."""
    if address.kind == "serial":
        return SerialLine(address)
    if address.kind == "tcp":
        return TcpLine(address)
    return UdpLine(address)


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
        except serial.SerialException as error:
            raise DeviceNotFound(f"{address}: {_reason(error)}; {_serial_remedy(error, address.place)}") from error
        except ValueError as error:
            raise BadData(f"{address}: {error}; choose a rate the port knows, such as 921600 or 57600") from error

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
            raise DeviceLost(f"{self._address}: {_reason(error)}; check its cable") from error

    def wait(self, timeout_s: float) -> None:
        try:
            select.select([self._port.fileno()], [], [], timeout_s)
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {_reason(error)}; check its cable") from error

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        try:
            # asked each time: of an empty line a read brings the same nothing as of one that was disconnected
            ready, _, _ = select.select([self._port.fileno()], [], [], timeout_s)
            if not ready:
                return []
            arrival_ns = time.monotonic_ns()
            data = os.read(self._port.fileno(), _READ_BYTES)
        except (OSError, serial.SerialException, TypeError) as error:
            raise DeviceLost(f"{self._address}: {_reason(error)}; check its cable") from error
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
            raise DeviceLost(f"{self._address}: {_reason(error)}; check its cable") from error

    def answer(self, chunk: int) -> None:
        pass  # a serial line has one other end

    def close(self) -> None:
        self._port.close()


class UdpLine:
    """A UDP socket. udpin sends to the last sender until `answer` selects one; udpout always sends to its host."""

    bytes_per_s = None
    waiting_bytes = backlog_bytes = 0  # a datagram is sent at once or not at all
    backlog_remedy = ""

    def __init__(self, address: Address) -> None:
        self._address = address
        self.flood = FloodFilter()
        self._room = memoryview(bytearray(_READ_BYTES))
        self.sends_first = address.kind == "udpout"
        place = _resolve(address)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._more = select.poll()
        self._more.register(self._socket, select.POLLIN)
        self._peer: tuple[str, int] | None = place if self.sends_first else None
        self.sources: list[Source] = []
        self._chosen = self.sends_first
        try:
            self._socket.bind(("0.0.0.0", 0) if self.sends_first else place)
        except OSError as error:
            self._socket.close()
            raise DeviceNotFound(
                f"{address}: {_reason(error)}; end the other program on this port, or choose another port"
            ) from error

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def wait(self, timeout_s: float) -> None:
        select.select([self._socket], [], [], timeout_s)

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        if timeout_s > 0.0:
            self.wait(timeout_s)
        chunks: list[Chunk] = []
        self.sources = []
        begun_ns, dropped = time.monotonic_ns(), False
        for _ in range(_MOST_DATAGRAMS):  # then the rest of the loop has its turn
            # asked, since after a pause an empty socket's exception takes three times as long; in a flood more is there
            if not dropped and not self._more.poll(0):
                break
            try:
                size, peer = self._socket.recvfrom_into(self._room)
            except BlockingIOError:
                break
            except ConnectionRefusedError:
                continue  # the port of the receiver was closed when the last datagram arrived
            except OSError as error:
                raise DeviceLost(f"{self._address}: {_reason(error)}") from error
            arrival_ns = time.monotonic_ns()
            dropped = not self.flood.passes(peer, arrival_ns)
            if dropped:
                if arrival_ns - begun_ns > _LONGEST_NS:
                    break
                continue
            chunks.append((bytes(self._room[:size]), arrival_ns))
            self.sources.append(peer)
            if not self._chosen:
                self._peer = peer
        return chunks

    def write(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except (BlockingIOError, ConnectionRefusedError):
            return
        except OSError as error:
            # a network that is down for a moment (no route) is as good as a lost datagram
            if error.errno not in _NETWORK_DOWN:
                raise DeviceLost(f"{self._address}: {_reason(error)}") from error

    def answer(self, chunk: int) -> None:
        source = self.sources[chunk]
        if source is not None:
            self.flood.trust(source, time.monotonic_ns())
        if not self.sends_first:
            self._peer, self._chosen = source, True

    def close(self) -> None:
        self._socket.close()


class TcpLine:
    """A TCP connection to an autopilot or a router."""

    bytes_per_s = None
    sends_first = False
    sources = None
    flood = None
    backlog_bytes = _TCP_BACKLOG_BYTES
    backlog_remedy = "check the network, and that the other end reads"

    def __init__(self, address: Address, timeout_s: float = 2.0) -> None:
        self._address = address
        try:
            self._socket = socket.create_connection(_resolve(address), timeout=timeout_s)
        except OSError as error:
            raise DeviceNotFound(
                f"{address}: {_reason(error)}; check the address, and that the other end listens there"
            ) from error
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def waiting_bytes(self) -> int:
        """Bytes that the other end has not confirmed."""
        try:
            return int.from_bytes(fcntl.ioctl(self._socket, termios.TIOCOUTQ, bytes(4)), sys.byteorder)
        except OSError as error:
            raise DeviceLost(f"{self._address}: {_reason(error)}") from error

    def wait(self, timeout_s: float) -> None:
        select.select([self._socket], [], [], timeout_s)

    def read(self, timeout_s: float = 0.0) -> list[Chunk]:
        if timeout_s > 0.0:
            self.wait(timeout_s)
        try:
            data = self._socket.recv(_READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            raise DeviceLost(f"{self._address}: {_reason(error)}") from error
        if not data:
            raise DeviceLost(f"{self._address}: the other end closed the connection")
        return [(data, time.monotonic_ns())]

    def write(self, data: bytes) -> None:
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            return
        except OSError as error:
            raise DeviceLost(f"{self._address}: {_reason(error)}") from error
        if sent < len(data):
            raise DeviceLost(f"{self._address}: the connection is stuck")

    def answer(self, chunk: int) -> None:
        pass  # a connection has one other end

    def close(self) -> None:
        self._socket.close()


_NETWORK_DOWN = frozenset({errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTUNREACH, errno.EPERM})
"""EPERM: a firewall."""


def _resolve(address: Address) -> tuple[str, int]:
    try:
        found = socket.getaddrinfo(address.place, address.number, socket.AF_INET, socket.SOCK_DGRAM)
    except OSError as error:
        raise DeviceNotFound(f"{address}: {_reason(error)}; use an address such as 127.0.0.1") from error
    host, port = found[0][4][:2]
    return str(host), int(port)


def _reason(error: BaseException) -> str:
    """The system's text of the cause, without the sentence that pyserial puts around it."""
    if isinstance(error, socket.gaierror):  # its numbers are not those of the system
        return error.strerror or str(error)
    number = getattr(error, "errno", None)
    return os.strerror(number) if isinstance(number, int) else str(error) or type(error).__name__


def _serial_remedy(error: BaseException, place: str) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return "add the user to the group that owns the port (dialout)"
    if number == errno.ENOENT:
        return "plug it in, and name it as in /dev/serial/by-id"
    if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
        return f"another program holds {place}: stop it, or put mavlink-router between"
    return "check the name of the port"
