"""What a transport between vehicles offers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class ReceivedPacket:
    """A packet."""

    transport: str
    data: bytes
    arrival_ns: int
    sender: int | None  # the vehicle's number by the transport; None: the transport does not have it
    source: object = None
    """Of the bytes, for `TeamLink.confirm`."""


Deliver = Callable[[ReceivedPacket], None]
"""Called from a thread of the transport; it must not block."""


class TeamLink(Protocol):
    """A transport. A link that is missing or lost is opened again; `fault` says why it is not open."""

    @property
    def name(self) -> str:
        """Short name for messages and logs."""
        ...

    @property
    def overhead_bytes(self) -> int:
        """Bytes that each packet takes beyond its own."""
        ...

    @property
    def packet_bytes(self) -> int:
        """Greatest packet."""
        ...

    @property
    def fault(self) -> str:
        """Why it is not open or has ended, as text; empty: it is open."""
        ...

    @property
    def refused(self) -> dict[str, int]:
        """Code -> number of messages that were not delivered."""
        ...

    def open(self) -> None:
        """Starts it."""
        ...

    def send(self, packets: Sequence[bytes], vehicle: int) -> None:
        """Sends packets of this vehicle, or drops them while the link is not open. Never blocks."""
        ...

    def confirm(self, packet: ReceivedPacket) -> None:
        """A packet of this link was accepted: its source is a member of the team."""
        ...

    def close(self) -> None:
        """Ends it. May be called twice."""
        ...
