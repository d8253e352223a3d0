"""TUNNEL messages over the link to the autopilot, which forwards them to its other links."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.parser import SIGNATURE_BYTES, Frame
from drivers.sharing.link import Deliver, ReceivedPacket
from drivers.sharing.tunnel import FRAME_BYTES, NAME, PAYLOAD_BYTES, packet_of, tunnel_message


class AutopilotTunnel:
    """A `TeamLink`. The session of the link signs what is sent, and passes only messages whose signature it accepts. vehicle of
    `send` is the system id of that session."""

    name = NAME
    packet_bytes = PAYLOAD_BYTES

    def __init__(self, link: MavlinkLink, deliver: Deliver, *, signed: bool) -> None:
        self._link, self._deliver = link, deliver
        self.overhead_bytes = FRAME_BYTES + (SIGNATURE_BYTES if signed else 0)
        self._refused: Counter[str] = Counter()

    @property
    def fault(self) -> str:
        state = self._link.state
        return "" if state.open else f"the link to the autopilot is not open: {state.error}"

    @property
    def refused(self) -> dict[str, int]:
        return dict(self._refused)

    def open(self) -> None:
        """The link to the autopilot is opened by the service."""

    def send(self, packets: Sequence[bytes], vehicle: int) -> None:
        for packet in packets:
            self._link.post(tunnel_message(packet))

    def confirm(self, packet: ReceivedPacket) -> None:
        """Nothing to do: the link has one other end."""

    def close(self) -> None:
        """The link to the autopilot is closed by the service."""

    def take(self, frame: Frame, arrival_ns: int) -> None:
        """A TUNNEL message of another vehicle."""
        packet = packet_of(frame, arrival_ns)
        if packet is None:
            self._refused["other_payload"] += 1
        else:
            self._deliver(packet)
