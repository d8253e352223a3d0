"""Finds the line on which an autopilot sends heartbeats."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.mavlink.address import parse_address
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession

from ..autopilot.session_factory import params_of
from ..config.loader import Config
from ..doctor.wait import wait_until

BAUDS: Final = (921600, 115200, 57600)
UDP: Final = ("udpin:0.0.0.0:14540", "udpin:0.0.0.0:14550")
"""Where PX4 sends to a companion computer, and where autopilots and routers send to a ground station."""
HEARTBEAT_S: Final = 2.5
"""Autopilots send a heartbeat each second."""


@dataclass(frozen=True, slots=True)
class FoundAutopilot:
    """An autopilot that was found."""

    address: str  # as in [autopilot]
    kinds: Mapping[int, str]  # system id -> PX4 or another kind; several: those of other vehicles are received, too

    @property
    def text(self) -> str:
        """All autopilots."""
        return ", ".join(f"{kind}, system {system}" for system, kind in self.kinds.items())


def candidates(ports: Sequence[str]) -> Iterator[str]:
    """Addresses to try: serial ports at the usual speeds (a USB device of an autopilot has none), then UDP."""
    for port in ports:
        is_autopilot = "FTDI" not in port and "CP210" not in port and "usb-" in port
        for baud in BAUDS[:1] if is_autopilot else BAUDS:
            yield f"serial:{port}:{baud}"
    yield from UDP


def autopilot_at(address: str, seconds: float, print_line: Callable[[str], None]) -> FoundAutopilot | None:
    """The autopilots on an address; None where no heartbeat arrives. seconds: longest wait for a first heartbeat, and wait for those
    of others; print_line: takes the cause if the line is not open."""
    session = MavlinkSession(params_of(Config()))
    link = MavlinkLink(parse_address(address), session, lambda samples: None)
    link.open()
    try:
        wait_until(lambda: session.vehicle is not None, seconds)
        if session.vehicle is not None:
            time.sleep(seconds)
        if error := link.state.error:
            print_line(f"{address} is not open: {error.removeprefix(f'{address}: ')}")
    finally:
        link.close()
    kinds = session.vehicles(time.monotonic_ns())
    return FoundAutopilot(address, kinds) if kinds else None


def find_autopilot(addresses: Sequence[str], print_line: Callable[[str], None]) -> FoundAutopilot | None:
    """The first address with an autopilot."""
    for address in addresses:
        print_line(f"listening on {address} ...")
        if (found := autopilot_at(address, HEARTBEAT_S, print_line)) is not None:
            return found
    return None
