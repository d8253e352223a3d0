"""Restarts of cameras and links leave no descriptor, thread or memory behind."""

from __future__ import annotations

import os
import pty
import sys
import threading
import tty
from pathlib import Path
from typing import NamedTuple

import pytest

from companion.cameras.supervisor import CameraSupervisor
from companion.config.camera import CameraConfig
from companion.config.service import SupervisorParams
from drivers.mavlink import link as link_module
from drivers.mavlink.address import Address
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from tests.waiting import until

from ..watched_camera import CAMERA

pytestmark = pytest.mark.soak

RESTARTS = 200
QUICK = SupervisorParams(first_backoff_s=0.0, longest_backoff_s=0.1)


class Held(NamedTuple):
    """What this process holds."""

    descriptors: int
    threads: int
    memory_bytes: int

    @classmethod
    def now(cls) -> Held:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return cls(len(os.listdir("/proc/self/fd")), threading.active_count(), pages * os.sysconf("SC_PAGE_SIZE"))

    def within(self, before: Held) -> bool:
        """Two descriptors differ while a process is being started."""
        held = self.descriptors <= before.descriptors + 2 and self.threads <= before.threads
        return held and self.memory_bytes - before.memory_bytes < 2e6


def test_a_camera_that_is_restarted_again_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3]))
    script = tmp_path / "camera.py"
    script.write_text(CAMERA)
    section, command = CameraConfig(name="front", kind="simulated"), (sys.executable, str(script), "exits:3")
    camera = CameraSupervisor(section, lambda info: None, lambda frame: None, QUICK, command)
    camera.open()
    try:
        assert until(lambda: camera.status.starts > 20)
        before = Held.now()
        assert until(lambda: camera.status.starts > RESTARTS, 3600.0)
        assert until(lambda: Held.now().within(before)), (before, Held.now())
    finally:
        camera.close()


def test_a_serial_line_that_is_lost_again_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_module, "FIRST_BACKOFF_S", 0.01)
    monkeypatch.setattr(link_module, "LONGEST_BACKOFF_S", 0.01)
    place = tmp_path / "usb-autopilot"
    link = MavlinkLink(Address("serial", str(place), 921600), MavlinkSession(), lambda samples: None)
    link.open()
    before: Held | None = None
    for number in range(RESTARTS):
        own, theirs = pty.openpty()
        tty.setraw(theirs)
        place.unlink(missing_ok=True)
        place.symlink_to(os.ttyname(theirs))
        assert until(lambda: link.state.open)
        if number == 5:
            before = Held.now()
        if number == RESTARTS - 1:
            assert before is not None
            assert until(lambda before=before: Held.now().within(before)), (before, Held.now())
        os.close(own)
        os.close(theirs)
        assert until(lambda number=number: link.state.losses > number)
    link.close()
