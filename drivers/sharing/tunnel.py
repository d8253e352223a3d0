"""Packets between vehicles in MAVLink TUNNEL messages (385), with a payload type of the private range."""

from __future__ import annotations

from collections import Counter, OrderedDict
from typing import Any, Final

from ..mavlink.dialect import dialect
from ..mavlink.parser import SIGNATURE_BYTES, Frame, MessageSplitter
from ..mavlink.signing import Signing
from ..mavlink.transport import Source
from .link import ReceivedPacket

TUNNEL_ID: Final = dialect.MAVLINK_MSG_ID_TUNNEL
PAYLOAD_TYPE: Final = 0xA05A
"""41050: above 32767, so it is for private use (MAV_TUNNEL_PAYLOAD_TYPE)."""
PAYLOAD_BYTES: Final = 128
FRAME_BYTES: Final = 17
"""Header, checksum and the fields before the payload."""
LINK_ID: Final = 1
"""Of the signatures: the line to the autopilot has 0, each with timestamps of its own."""
NAME: Final = "tunnel"
MOST_SENDERS: Final = 16


def tunnel_message(packet: bytes) -> Any:
    """A message to all. Raises ValueError for a packet of more than PAYLOAD_BYTES."""
    if len(packet) > PAYLOAD_BYTES:
        raise ValueError(f"a packet of {len(packet)} bytes does not fit into a TUNNEL message of {PAYLOAD_BYTES}")
    payload = list(packet.ljust(PAYLOAD_BYTES, b"\0"))
    return dialect.MAVLink_tunnel_message(0, 0, PAYLOAD_TYPE, len(packet), payload)


def packet_of(frame: Frame, arrival_ns: int, source: object = None) -> ReceivedPacket | None:
    """The packet of a TUNNEL message of this payload type; None for others."""
    if frame.id != TUNNEL_ID:
        return None
    message = frame.message()
    if message is None or message.payload_type != PAYLOAD_TYPE or message.payload_length > PAYLOAD_BYTES:
        return None
    return ReceivedPacket(NAME, bytes(message.payload[: message.payload_length]), arrival_ns, frame.system, source)


class TunnelCodec:
    """Both directions of a line of its own. signing: with a key only messages signed with it are accepted, and all are signed."""

    def __init__(self, component_id: int, signing: Signing | None = None) -> None:
        self._signing = signing or Signing()
        self._encoder = dialect.MAVLink(None)
        self._encoder.srcComponent = component_id
        self._encoder.signing.link_id = LINK_ID
        self._splitters: OrderedDict[Source, MessageSplitter] = OrderedDict()
        self.refused: Counter[str] = Counter()

    @property
    def overhead_bytes(self) -> int:
        """Bytes of each message beyond its packet."""
        return FRAME_BYTES + (SIGNATURE_BYTES if self._signing.on else 0)

    def encoded(self, packet: bytes, vehicle: int) -> bytes:
        """A packet ready for the line."""
        self._encoder.srcSystem = vehicle
        self._signing.prepare(self._encoder)
        data = bytes(tunnel_message(packet).pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return data

    def decoded(self, data: bytes, arrival_ns: int, source: Source = None) -> list[ReceivedPacket]:
        """The packets that these bytes complete. source: of the bytes, where several senders share the line."""
        splitter = self._splitters.setdefault(source, MessageSplitter())
        self._splitters.move_to_end(source)
        if len(self._splitters) > MOST_SENDERS:
            self._splitters.popitem(last=False)
        found = []
        for frame in splitter.frames(data):
            if frame.id != TUNNEL_ID:  # MAVLink 1, which has no signatures, has no id above 255
                continue
            if not self._signing.believes(frame, arrival_ns):
                self.refused["signature"] += 1
                continue
            packet = packet_of(frame, arrival_ns, source)
            if packet is None:
                self.refused["other_payload"] += 1
            else:
                found.append(packet)
        return found
