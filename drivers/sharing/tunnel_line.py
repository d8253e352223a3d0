"""A line of its own for TUNNEL messages, such as a telemetry radio: serial, UDP or TCP."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Final

from ..base import DriverError
from ..mavlink.address import Address
from ..mavlink.open_transport import open_transport
from ..mavlink.signing import Signing
from ..mavlink.transport import Transport
from ..watched_thread import WatchedThread
from .link import Deliver, ReceivedPacket
from .tunnel import NAME, PAYLOAD_BYTES, TunnelCodec

READ_S: Final = 0.02
FIRST_BACKOFF_S, LONGEST_BACKOFF_S = 0.25, 5.0
MOST_WAITING: Final = 32


class TunnelLine:
    """A `TeamLink`: reads and writes in a thread, and opens the line again when it is lost."""

    name = NAME
    packet_bytes = PAYLOAD_BYTES

    def __init__(self, address: Address, component_id: int, deliver: Deliver, signing: Signing | None = None) -> None:
        self._address, self._deliver = address, deliver
        self._codec = TunnelCodec(component_id, signing)
        self._waiting: deque[tuple[bytes, int]] = deque(maxlen=MOST_WAITING)
        self._stop = threading.Event()
        self._fault = "not opened yet"
        self._confirmed: object = None
        self._thread = WatchedThread(self._run, "team tunnel")

    @property
    def overhead_bytes(self) -> int:
        return self._codec.overhead_bytes

    @property
    def fault(self) -> str:
        return self._thread.failure or self._fault

    @property
    def refused(self) -> dict[str, int]:
        return dict(self._codec.refused)

    def open(self) -> None:
        self._thread.start()

    def send(self, packets: Sequence[bytes], vehicle: int) -> None:
        if not self._fault:
            self._waiting.extend((packet, vehicle) for packet in packets)

    def confirm(self, packet: ReceivedPacket) -> None:
        self._confirmed = packet.source

    def close(self) -> None:
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(2.0)

    def _run(self) -> None:
        backoff_s = FIRST_BACKOFF_S
        while not self._stop.is_set():
            transport: Transport | None = None
            try:
                transport = open_transport(self._address)
                self._fault = ""
                while not self._stop.is_set():
                    self._round(transport)
                    backoff_s = FIRST_BACKOFF_S
            except DriverError as error:
                self._fault = str(error)
            finally:
                if transport is not None:
                    transport.close()
            self._waiting.clear()
            self._stop.wait(backoff_s)
            backoff_s = min(2.0 * backoff_s, LONGEST_BACKOFF_S)

    def _round(self, transport: Transport) -> None:
        chunks = transport.read(READ_S)
        sources = transport.sources or [None] * len(chunks)
        for k, ((data, arrival_ns), source) in enumerate(zip(chunks, sources, strict=True)):
            packets = self._codec.decoded(data, arrival_ns, source)
            # not after any packet: every sender can reach the port
            if source is not None and source == self._confirmed:
                transport.answer(k)
            for packet in packets:
                self._deliver(packet)
        while self._waiting:
            payload, vehicle = self._waiting.popleft()
            transport.write(self._codec.encoded(payload, vehicle))
