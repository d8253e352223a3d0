"""Addresses of a link, and what opening them reports."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from drivers.base import BadData, DeviceNotFound
from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.open_transport import open_transport
from drivers.mavlink.udp_line import UdpLine
from drivers.simulation.autopilot_link import PtyEnd
from tests.ports import free_port

pytestmark = pytest.mark.process


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("serial:/dev/serial/by-id/usb-x:57600", Address("serial", "/dev/serial/by-id/usb-x", 57600)),
        ("serial:/dev/ttyAMA0", Address("serial", "/dev/ttyAMA0", 921600)),
        (
            "serial:/dev/serial/by-path/pci-0:1.2:1.0",
            Address("serial", "/dev/serial/by-path/pci-0:1.2:1.0", 921600),
        ),
        (
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0:57600",
            Address("serial", "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0", 57600),
        ),
        ("udpin:0.0.0.0:14540", Address("udpin", "0.0.0.0", 14540)),
        ("tcp:host:5760", Address("tcp", "host", 5760)),
        ("udpout:[fe80::1%eth0]:14550", Address("udpout", "[fe80::1%eth0]", 14550)),
    ],
)
def test_addresses(text: str, address: Address) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize(
    "text",
    ["", "ttyACM0", "udp:1.2.3.4:14550", "udpin:0.0.0.0", "tcp:host:0", "tcp:::1:5760", "tcp:[::1]", "serial:ttyS0"],
)
def test_a_wrong_address_names_the_forms_there_are(text: str) -> None:
    with pytest.raises(ValueError, match="expected serial:/dev/serial/by-id"):
        parse_address(text)


@pytest.mark.parametrize("baud", ["abc", "", "57600baud", "57.6k", "-1", "921600 "])
def test_a_baud_rate_that_is_no_number_is_named(baud: str) -> None:
    """It was taken for a part of the device's name: no such file, plug it in."""
    for place in ("/dev/ttyUSB0", "/dev/serial/by-id/usb-x", "/dev/serial/by-path/pci-0:1.2:1.0"):
        with pytest.raises(ValueError, match=f'the baud rate is "{baud}", expected 1200 to 12000000, such as 921600'):
            parse_address(f"serial:{place}:{baud}")


def test_failures_to_open_name_cause_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(DeviceNotFound, match=r"No such file or directory; plug it in"):
        open_transport(Address("serial", str(tmp_path / "none"), 57600))
    with pytest.raises(DeviceNotFound, match="the other end listens there"):
        open_transport(Address("tcp", "127.0.0.1", 1))
    held = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    try:
        with pytest.raises(DeviceNotFound, match="end the other program on this port"):
            open_transport(Address("udpin", "127.0.0.1", held.port))
    finally:
        held.close()


def test_udp_and_tcp_over_ipv6() -> None:
    listening = UdpLine(parse_address(f"udpin:[::1]:{free_port()}"))
    sending = UdpLine(parse_address(f"udpout:[::1]:{listening.port}"))
    try:
        sending.write(b"heartbeat")
        ((data, _),) = listening.read(60.0)
        listening.answer(0)
        listening.write(b"answer")
        assert (data, sending.read(60.0)[0][0]) == (b"heartbeat", b"answer")
    finally:
        listening.close()
        sending.close()
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as server:
        line = open_transport(parse_address(f"tcp:[::1]:{server.getsockname()[1]}"))
        end, _ = server.accept()
        line.write(b"heartbeat")
        assert end.recv(100) == b"heartbeat"
        end.close()
        line.close()


def test_a_port_that_another_program_holds() -> None:
    end = PtyEnd()
    first = open_transport(Address("serial", end.device, 57600))
    try:
        with pytest.raises(DeviceNotFound, match="another program holds"):
            open_transport(Address("serial", end.device, 57600))
    finally:
        first.close()
        end.close()


def test_a_rate_that_no_port_supports() -> None:
    end = PtyEnd()
    with pytest.raises(BadData, match="choose a rate that the port supports"):
        open_transport(Address("serial", end.device, -5))
    end.close()
