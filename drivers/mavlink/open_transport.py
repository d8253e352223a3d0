"""Opens the transport of an address."""

from __future__ import annotations

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
