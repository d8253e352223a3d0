"""Opens the transport of an address, at once or in a thread of its own."""

from __future__ import annotations

import threading

from ..base import DriverError
from .address import Address
from .serial_line import SerialLine
from .tcp_line import TcpLine
from .transport import Transport
from .udp_line import UdpLine


def open_transport(address: Address) -> Transport:
    """Opens a transport. Raises DeviceNotFound or BadData."""
    if address.kind == "serial":
        return SerialLine(address)
    if address.kind == "tcp":
        return TcpLine(address)
    return UdpLine(address)


class Opening(threading.Thread):
    """Opens a transport. done: set when it is open or has failed."""

    def __init__(self, address: Address) -> None:
        super().__init__(name="mavlink open", daemon=True)
        self._address = address
        self._lock = threading.Lock()
        self._abandoned = False
        self._transport: Transport | None = None
        self._error: DriverError | None = None
        self.done = threading.Event()

    def run(self) -> None:
        try:
            transport = open_transport(self._address)
            with self._lock:
                self._transport = transport
                if self._abandoned:
                    transport.close()
        except DriverError as error:
            self._error = error
        finally:
            self.done.set()

    def result(self) -> Transport:
        """Returns the open transport. Raises DriverError, and RuntimeError after another exception, whose traceback is
        printed."""
        if self._error is not None:
            raise self._error
        if self._transport is None:
            raise RuntimeError(f"{self._address} was not opened: the cause is printed above")
        return self._transport

    def abandon(self) -> None:
        """Closes the transport as soon as it is open."""
        with self._lock:
            self._abandoned = True
            if self._transport is not None:
                self._transport.close()
