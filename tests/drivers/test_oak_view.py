"""The view that an OAK states for its images: real messages of depthai, without a device."""

from __future__ import annotations

import math
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
BASELINE_CM = 7.5
IMAGES = ("depth", "left", "right")
Stated = dict[str, dai.ImgTransformation]


def view(cx_px: float = CENTRE_PX[0], cy_px: float = CENTRE_PX[1], **pose: float) -> dai.ImgTransformation:
    """A rectified view. pose: x_cm of its place, right of the left camera, and turned_deg about the vertical axis."""
    found = dai.ImgTransformation(WIDTH, HEIGHT, [[F_PX, 0.0, cx_px], [0.0, F_PX, cy_px], [0.0, 0.0, 1.0]])
    if pose:
        a = math.radians(pose.get("turned_deg", 0.0))
        R = [[math.cos(a), 0.0, math.sin(a)], [0.0, 1.0, 0.0], [-math.sin(a), 0.0, math.cos(a)]]
        place = dai.Point3f(pose["x_cm"], 0.0, 0.0)
        found.setExtrinsics(dai.Extrinsics(R, place, dai.CameraBoardSocket.CAM_A))
    return found


def stated(**changes: dai.ImgTransformation) -> Stated:
    """What a device states: the same rectified view for all three images, each with its pose."""
    left = view(x_cm=0.0)
    return {"depth": left, "left": left, "right": view(x_cm=BASELINE_CM), **changes}


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
    [
        stated(),
        {name: view() for name in IMAGES},
        {"depth": view()},
        stated(depth=view(cx_px=CENTRE_PX[0] + 0.3, x_cm=0.1)),
    ],
    ids=["with poses", "without poses", "the depth alone", "rounded"],
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


def test_an_image_of_another_size_or_with_a_distortion_is_refused() -> None:
    larger = dai.ImgTransformation(2 * WIDTH, 2 * HEIGHT, view().getIntrinsicMatrix())
    refused({"depth": view(), "left": larger}, "differ by inf px")
    bent = view()
    bent.setDistortionCoefficients([-0.17, 0.02, 0.0, 0.0, 0.0])
    refused(dict.fromkeys(IMAGES, bent), "states a distortion for its depth image")


@pytest.mark.parametrize(
    ("depth", "cause"),
    [
        (view(x_cm=BASELINE_CM), r"seen 7\.5 cm and 0\.00 degrees from its rectified left image"),
        (view(x_cm=0.0, turned_deg=0.8), r"seen 0\.0 cm and 0\.80 degrees"),
        (view(x_cm=math.nan), "seen nan cm"),
    ],
    ids=["of the right camera", "not rectified", "no number"],
)
def test_a_depth_that_is_stated_to_be_seen_from_elsewhere_is_refused(depth: dai.ImgTransformation, cause: str) -> None:
    refused(stated(depth=depth), cause)


def test_the_pose_is_not_compared_where_it_refers_to_different_cameras() -> None:
    other = view()
    other.setExtrinsics(dai.Extrinsics(np.eye(3).tolist(), dai.Point3f(9.0, 0.0, 0.0), dai.CameraBoardSocket.CAM_C))
    camera = source(stated(depth=other))
    camera.open()
    camera.close()
