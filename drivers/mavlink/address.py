"""Address of an autopilot.

serial:/dev/serial/by-id/usb-...:921600      (the rate may be left out: 921600)
udpin:0.0.0.0:14540                          waits for the autopilot; answers go to its address
udpout:127.0.0.1:14550                       sends first, to a router or a ground station
tcp:127.0.0.1:5760

HOST is a name, an IPv4 address, or an IPv6 address in brackets such as [::1]."""

from __future__ import annotations

import re
from dataclasses import dataclass

DEFAULT_BAUD = 921_600
LEAST_BAUD, GREATEST_BAUD = 1200, 12_000_000
"""No MAVLink line is slower, and no serial adapter faster. A rate of 0 would hang the line up."""
_PATH_END = re.compile(r"/dev/serial/by-path/.*:[0-9a-f]+\.[0-9]+(-[^:]*)?")
"""A device by its path ends with a colon and the number of an interface or a PCI function, not with a baud rate."""
SocketAddress = tuple[str, int] | tuple[str, int, int, int]
"""Host, port, and for IPv6 flow and scope."""


@dataclass(frozen=True, slots=True)
class Address:
    """Address of an autopilot."""

    kind: str  # serial, udpin, udpout or tcp
    place: str  # device or host
    number: int  # baud rate or port

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}:{self.number}"


def is_host(text: str) -> bool:
    """True if a text can be a host in HOST:PORT: not empty, and an IPv6 address in brackets only."""
    return bool(text) and (":" not in text or (text.startswith("[") and text.endswith("]")))


def parse_address(text: str) -> Address:
    """Returns the address in a text. Raises ValueError that names the valid forms."""
    kind, _, rest = text.partition(":")
    forms = "serial:/dev/serial/by-id/NAME[:BAUD], udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT, an IPv6 HOST in brackets"
    place, _, number = rest.rpartition(":")
    if kind == "serial" and rest.startswith("/"):
        if not place or _PATH_END.fullmatch(rest):
            return Address(kind, rest, DEFAULT_BAUD)
        if number.isdecimal() and LEAST_BAUD <= int(number) <= GREATEST_BAUD:
            return Address(kind, place, int(number))
        raise ValueError(
            f'"{text}" is not an address: the baud rate is "{number}", expected {LEAST_BAUD} to {GREATEST_BAUD}, such as '
            f"{DEFAULT_BAUD}"
        )
    if kind in ("udpin", "udpout", "tcp") and is_host(place) and number.isdecimal() and 0 < int(number) < 65536:
        return Address(kind, place, int(number))
    near = f"; did you mean serial:{text}?" if text.startswith("/dev/") else ""
    raise ValueError(f'"{text}" is not an address{near or f": expected {forms}"}')
