"""A camera that is opened again: it must be the one of the first opening, with the same calibration."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import replace

import numpy as np
import pytest

from companion.cameras.supervisor import CameraSupervisor
from companion.config.camera import CameraConfig
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import BadData, DeviceLost
from drivers.cameras.frame_channel import Notification

pytestmark = pytest.mark.unit

INFO = CameraInfo("front", Intrinsics(64, 48, 60.0, 60.0, 32.0, 24.0))


class Opening:
    """What one process of the camera sends: its description, together with a frame; then it ends."""

    dropped = 0

    def __init__(self, info: CameraInfo = INFO, identity: str = "") -> None:
        depth = np.random.default_rng(time.monotonic_ns()).integers(2000, 3000, (48, 64)).astype(np.uint16)
        now_ns = time.monotonic_ns()
        frame = DepthFrame(camera="front", sequence=0, t_exposure_ns=now_ns, t_arrival_ns=now_ns, depth_mm=depth)
        opened = Notification("opened", {"info": dataclasses.asdict(info), "identity": identity})
        self._batches = [(frame, [opened])]

    def read(self, timeout_s: float) -> tuple[DepthFrame | None, list[Notification]]:
        if not self._batches:
            raise DeviceLost("its process has ended")
        return self._batches.pop(0)


class Opened:
    """A supervised camera, with the descriptions and frames that it passed on."""

    def __init__(self) -> None:
        self.infos: list[CameraInfo] = []
        self.frames: list[DepthFrame] = []
        section = CameraConfig(name="front", kind="simulated")
        self.supervisor = CameraSupervisor(section, self.infos.append, self.frames.append)

    def open(self, opening: Opening) -> None:
        with pytest.raises(DeviceLost):
            self.supervisor._watch(opening)

    def refuse(self, opening: Opening, cause: str) -> None:
        """Neither the description nor a frame is passed on."""
        before = len(self.infos), len(self.frames)
        with pytest.raises(BadData, match=cause):
            self.supervisor._watch(opening)
        assert (len(self.infos), len(self.frames)) == before


def test_a_camera_that_states_its_number_in_the_place_of_one_that_stated_nothing_is_not_used() -> None:
    """As a camera on USB that took the name /dev/video0 of one on the board. The other way was noticed."""
    camera = Opened()
    camera.open(Opening(identity=""))
    camera.refuse(
        Opening(identity="serial 2"), r"another camera \(serial 2\) .* at the start \(one that states no product"
    )
    camera.open(Opening(identity=""))
    assert len(camera.frames) == 2


@pytest.mark.parametrize(
    "changes", [{"cx": 52.0}, {"fx": 61.0}, {"width": 32, "cx": 16.0, "fx": 40.0, "fy": 40.0}], ids=str
)
def test_other_intrinsics_than_at_the_start_are_not_used(changes: dict[str, float]) -> None:
    """Of an OAK that states those of its other camera, or of a calibration file that was exchanged: one of both is wrong, and all
    directions differ."""
    camera = Opened()
    camera.open(Opening())
    other = replace(INFO, intrinsics=replace(INFO.intrinsics, **changes))
    camera.refuse(
        Opening(other), "its intrinsics .* differ from those at the start .* restart the camera and the service"
    )
    camera.open(Opening())


def test_a_greater_error_of_the_rows_and_rounded_intrinsics_are_accepted() -> None:
    """A camera whose rows moved is opened again with a greater bias."""
    camera = Opened()
    camera.open(Opening())
    camera.open(Opening(replace(INFO, bias_per_m=0.02, intrinsics=replace(INFO.intrinsics, cx=32.2))))
    assert len(camera.infos) == len(camera.frames) == 2
