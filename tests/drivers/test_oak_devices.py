"""Which of the connected OAK devices is opened: real descriptions of depthai, no device."""

from __future__ import annotations

import os

import pytest

os.environ.setdefault("DEPTHAI_LEVEL", "error")
os.environ.setdefault("DEPTHAI_INSTALL_SIGNAL_HANDLER", "0")

import depthai as dai

from drivers.base import DeviceNotFound
from drivers.cameras.oak_devices import find_device

pytestmark = pytest.mark.process


def device(device_id: str, in_use: bool = False) -> dai.DeviceInfo:
    """As the library describes a device on USB."""
    found = dai.DeviceInfo(device_id)
    found.state = dai.XLinkDeviceState.X_LINK_BOOTED if in_use else dai.XLinkDeviceState.X_LINK_UNBOOTED
    return found


def connect(monkeypatch: pytest.MonkeyPatch, *devices: dai.DeviceInfo) -> None:
    """Connects these devices, in the library's place."""
    monkeypatch.setattr(dai.Device, "getAllConnectedDevices", staticmethod(lambda: list(devices)))
    available = [d for d in devices if d.state != dai.XLinkDeviceState.X_LINK_BOOTED]
    monkeypatch.setattr(dai.Device, "getAllAvailableDevices", staticmethod(lambda: available))


def find(wanted: str) -> str:
    """The id of the device that is opened."""
    return str(find_device("front", wanted, 0.0).getDeviceId())


@pytest.mark.parametrize("wanted", ["", "19443010AA"])
def test_the_requested_device_or_the_only_one_is_opened(wanted: str, monkeypatch: pytest.MonkeyPatch) -> None:
    connect(monkeypatch, device("19443010AA"))
    assert find(wanted) == "19443010AA"


def test_a_device_of_another_id_is_not_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    connect(monkeypatch, device("19443010AA"), device("19443010BB", in_use=True))
    with pytest.raises(DeviceNotFound, match=r"no OAK device 19443010CC \(connected: 19443010AA, 19443010BB\); check"):
        find("19443010CC")


@pytest.mark.parametrize("wanted", ["", "19443010AA"])
def test_a_device_that_another_program_uses_is_named(wanted: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """`no OAK device (available: none); check the cable`."""
    connect(monkeypatch, device("19443010AA", in_use=True))
    with pytest.raises(DeviceNotFound, match=r"camera front: another program uses the OAK 19443010AA, .*; end it"):
        find(wanted)


@pytest.mark.parametrize("in_use", [False, True])
def test_without_an_id_none_of_several_devices_is_opened(in_use: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the camera is restarting, the device of another program would take its place, in another direction."""
    connect(monkeypatch, device("19443010AA"), device("19443010BB", in_use=in_use))
    with pytest.raises(DeviceNotFound, match=r"several OAK devices \(19443010AA, 19443010BB\); set device to one"):
        find("")


def test_a_device_that_becomes_free_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its firmware runs on for a second or two after its process was killed."""
    states = iter([[], [device("19443010AA", in_use=True)], [device("19443010AA")]])
    monkeypatch.setattr(dai.Device, "getAllConnectedDevices", staticmethod(lambda: next(states)))
    assert find_device("front", "", 60.0).getDeviceId() == "19443010AA"
