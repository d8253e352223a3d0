"""What a camera process reports of an opened camera."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import dataclass, replace

import pytest

from companion.cameras import worker
from companion.cameras.worker import description
from companion.config.camera import CameraConfig
from core.types import CameraInfo, DepthFrame, Intrinsics
from drivers.base import DeviceLost
from drivers.cameras.frame_channel import FrameReader

INFO = CameraInfo("front", Intrinsics(640, 400, 450.0, 450.0, 320.0, 200.0), bias_per_m=0.03)
SECTION = CameraConfig(name="front", kind="oak", width_px=640, height_px=400, masks="0,300 100,399")


@dataclass
class Source:
    """A camera that is lost after its opening."""

    notice: str
    info: CameraInfo = INFO
    identity: str = ""

    def open(self) -> None:
        pass

    def read(self, timeout_s: float) -> DepthFrame | None:
        raise DeviceLost("camera front: unplugged")

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("configured_per_m", "notice", "expected_per_m"),
    [
        (None, "", 0.03),
        (0.01, "", 0.01),
        (0.05, "", 0.05),
        (0.01, "camera front: the rows differ", 0.03),
        (0.05, "camera front: the rows differ", 0.05),
    ],
)
def test_a_configured_bias_does_not_hide_that_a_camera_is_misaligned(
    configured_per_m: float | None, notice: str, expected_per_m: float
) -> None:
    """It was measured before the camera was bent."""
    section = replace(SECTION, bias_per_m=configured_per_m)
    assert description(section, Source(notice)).bias_per_m == expected_per_m


@pytest.mark.parametrize(("configured_m", "expected_m"), [(None, 0.7), (0.4, 0.7), (1.0, 1.0)])
def test_a_configured_range_begins_at_the_least_depth_that_the_driver_can_measure(
    configured_m: float | None, expected_m: float
) -> None:
    """Of an OAK at 1280 x 800, whose search of 96 disparities ends at 0.7 m."""
    section = replace(SECTION, min_range_m=configured_m)
    source = Source("", replace(INFO, min_range_m=max(0.7, configured_m or 0.0)))
    assert description(section, source).min_range_m == expected_m


@pytest.mark.parametrize("size_px", [(1280, 800), (640, 480), (320, 400)])
def test_images_of_another_size_than_the_masks_were_drawn_in_are_refused(size_px: tuple[int, int]) -> None:
    """The masks hid other parts of the image than those that show the vehicle, and these were measured."""
    section = replace(SECTION, width_px=size_px[0], height_px=size_px[1])
    text = rf"its images have 640x400 pixels, {size_px[0]}x{size_px[1]} are configured: .* width_px = 640 and height_px = 400"
    with pytest.raises(ValueError, match=f"camera front: {text}"):
        description(section, Source(""))


def test_simulated_images_have_three_quarters_of_their_width() -> None:
    info = replace(INFO, intrinsics=Intrinsics(160, 120, 120.0, 120.0, 80.0, 60.0))
    section = CameraConfig(name="front", kind="simulated", width_px=160)
    assert description(section, Source("", info)).intrinsics == info.intrinsics


def test_a_greatest_range_below_the_least_depth_of_the_camera_is_named_with_its_remedy() -> None:
    """The cause was "camera info: range 0.7..0.6 m"."""
    section = replace(SECTION, min_range_m=0.1, max_range_m=0.6)
    with pytest.raises(ValueError, match=r"^max_range_m = 0\.6 is not greater than .*, 0\.7 m; raise it$"):
        description(section, Source("", replace(INFO, min_range_m=0.7)))


def test_the_cause_of_a_loss_is_reported_before_the_camera_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library of a lost device may wait for it for ever: the cause was then never reported."""
    reader = FrameReader("front")
    received: list[str] = []

    class Closing(Source):
        """Reports what the service has received when it is closed."""

        def close(self) -> None:
            received.extend(str(n.payload["cause"]) for n in reader.read(0.0)[1] if n.kind == "failed")

    monkeypatch.setattr(worker, "make_source", lambda section: Closing(""))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    section = {"name": "front", "kind": "oak", "height_px": 400}
    assert worker.main([str(os.dup(reader.child_fd)), json.dumps(section)]) == 1
    assert received == ["camera front: unplugged"]
    reader.close()
