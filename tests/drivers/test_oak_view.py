"""The view that an OAK states for its images: real messages of depthai, without a device."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import depthai as dai
import numpy as np
import pytest

from drivers.base import BadData
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings

from .oak_host import PERIOD_S, HostLink, depth_message, group_message, image_message, now
from .test_device_matches import F_PX, HEIGHT, WIDTH, device_depth, scene

pytestmark = pytest.mark.process

SETTINGS = OakSettings(camera="front", first_frame_s=60.0, fps=1.0 / PERIOD_S)
CENTRE_PX = (119.5, 39.5)
LEFT, RIGHT = scene()
IMAGES = ("depth", "left", "right")
Stated = dict[str, dai.ImgTransformation]


def view(cx_px: float = CENTRE_PX[0], cy_px: float = CENTRE_PX[1]) -> dai.ImgTransformation:
    """A rectified view."""
    return dai.ImgTransformation(WIDTH, HEIGHT, [[F_PX, 0.0, cx_px], [0.0, F_PX, cy_px], [0.0, 0.0, 1.0]])


def stated(**changes: dai.ImgTransformation) -> Stated:
    """What a device states: the same rectified view for all three images."""
    return {**{name: view() for name in IMAGES}, **changes}


def source(found: Stated, settings: OakSettings = SETTINGS) -> OakSource:
    """A driver whose device states this."""

    def make(number: int) -> dai.MessageGroup | dai.ImgFrame:
        stamp = now() - timedelta(milliseconds=20)
        parts = {
            "depth": depth_message(number, pixels=device_depth(), stamp=stamp),
            "left": image_message(number, LEFT, stamp),
            "right": image_message(number, RIGHT, stamp),
        }
        for name, transformation in found.items():
            parts[name].setTransformation(transformation)
        wanted = {name: parts[name] for name in settings.streams}
        return group_message(wanted) if len(wanted) > 1 else wanted["depth"]

    return OakSource(settings, HostLink(make))


def refused(found: Stated, cause: str, settings: OakSettings = SETTINGS) -> None:
    with pytest.raises(BadData, match=cause):
        source(found, settings).open()


@pytest.mark.parametrize(
    "found",
    [stated(), {"depth": view()}, stated(depth=view(cx_px=CENTRE_PX[0] + 0.3))],
    ids=["all images", "the depth alone", "rounded"],
)
def test_one_view_for_all_images_is_accepted(found: Stated) -> None:
    camera = source(found)
    camera.open()
    assert camera.info.intrinsics.cx == pytest.approx(CENTRE_PX[0], abs=0.31)
    camera.close()


@pytest.mark.parametrize("name", ["left", "right"])
@pytest.mark.parametrize("on_host", [False, True])
def test_intrinsics_of_the_cameras_before_the_rectification_are_refused(name: str, on_host: bool) -> None:
    """The published device: 20 px between the principal points of both cameras, 2.5 degrees of all directions."""
    settings = replace(SETTINGS, host_matching=on_host)
    refused(
        stated(**{name: view(cx_px=CENTRE_PX[0] - 20.3, cy_px=CENTRE_PX[1] + 11.6)}), r"differ by 20\.3 px", settings
    )


def test_an_image_of_another_size_is_refused() -> None:
    larger = dai.ImgTransformation(2 * WIDTH, 2 * HEIGHT, view().getIntrinsicMatrix())
    refused({"depth": view(), "left": larger}, "differ by inf px")


def test_a_distortion_and_a_pose_are_not_judged() -> None:
    """The firmware may keep those of the camera before the rectification; the intrinsics are compared, and the images show the
    alignment."""
    bent = view()
    bent.setDistortionCoefficients([-0.17, 0.02, 0.0, 0.0, 0.0])
    bent.setExtrinsics(dai.Extrinsics(np.eye(3).tolist(), dai.Point3f(9.0, 0.0, 0.0), dai.CameraBoardSocket.CAM_C))
    camera = source(stated(depth=bent))
    camera.open()
    camera.close()
