"""Finds the requested one of the connected Luxonis OAK devices."""

from __future__ import annotations

import time
from typing import Any

from ..base import DeviceNotFound

_POLL_S = 0.2


def find_device(camera: str, device: str, find_s: float) -> Any:
    """The dai.DeviceInfo of a device that no program uses, by polling: the library itself would wait 11 s and then raise.

    device: its id, USB port or address; empty: the only one that is connected, whether it is in use or not. Raises DeviceNotFound after
    find_s seconds, and at once where several are connected."""
    import depthai as dai

    until_s = time.monotonic() + find_s
    while True:
        connected = dai.Device.getAllConnectedDevices()
        ids = ", ".join(d.getDeviceId() for d in connected)
        wanted = [d for d in connected if device in ("", d.getDeviceId(), d.name)]
        if len(wanted) > 1:
            raise DeviceNotFound(f"camera {camera}: several OAK devices ({ids}); set device to one of them")
        if wanted and wanted[0].state != dai.XLinkDeviceState.X_LINK_BOOTED:
            return wanted[0]
        if time.monotonic() >= until_s:
            break
        time.sleep(_POLL_S)
    if wanted:
        raise DeviceNotFound(
            f"camera {camera}: another program uses the OAK {device or ids}, or one that has just ended did; end it, "
            "or unplug the camera and plug it in again"
        )
    raise DeviceNotFound(
        f"camera {camera}: no {f'OAK device {device}' if device else 'OAK device'} (connected: {ids or 'none'}); check the cable, the power "
        "and the udev rule (docs/how-to/connect-oak.md)"
    )
