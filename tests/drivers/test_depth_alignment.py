"""Whether the depth of a device is aligned with its left image, from both images."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.open_air.stereo_profiles import OAK
from benchmarks.open_air.stereo_scenes import make_stereo_scene
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from drivers.base import BadData
from drivers.cameras import depth_alignment
from drivers.cameras.depth_alignment import DepthAlignment, alignment_pixels
from drivers.cameras.stereo import MatchParams, depth_mm
from drivers.simulation.stereo.stereo_profiles import StereoCamera
from tests.nightly import nightly

from .test_device_matches import F_B_PX_M, device_depth, scene

Image = NDArray[np.uint8]
MATCH = MatchParams()
VIEW_F_B_PX_M = OAK.view.intrinsics.fx * OAK.view.baseline_m


@cache
def rendered(name: str) -> tuple[Image, Image]:
    R = rotation_from_euler(0.0, 0.0, 0.0) @ R_CAMFRD_OPTICAL
    pair = StereoCamera(OAK).pair(make_stereo_scene(name), R, np.array([0.0, 0.0, -2.0]), 0)
    return pair.left, pair.right


@cache
def matched(name: str, side: str) -> NDArray[np.uint16]:
    """(H, W) uint16 mm as a device matches it, aligned with an image."""
    assert OAK.device is not None
    left, right = rendered(name)
    if side == "left":
        return depth_mm(OAK.device.disparity(left, right), VIEW_F_B_PX_M)
    mirrored = (np.ascontiguousarray(image[:, ::-1]) for image in (right, left))
    return depth_mm(OAK.device.disparity(*mirrored), VIEW_F_B_PX_M)[:, ::-1].copy()


@pytest.mark.parametrize("name", ["street", *nightly("white_room")])
def test_depth_of_the_left_image_settles_and_that_of_the_right_one_is_refused(name: str) -> None:
    check = DepthAlignment("front")
    assert check.due
    check.take(matched(name, "left"), rendered(name), VIEW_F_B_PX_M, MATCH)
    assert check.settled
    assert not check.due
    with pytest.raises(
        BadData, match=r"camera front: the device's depth is aligned with its right image .* set match_on"
    ):
        DepthAlignment("front").take(matched(name, "right"), rendered(name), VIEW_F_B_PX_M, MATCH)


def test_a_flat_wall_decides_nothing_and_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    check = DepthAlignment("front")
    check.take(device_depth(), scene(), F_B_PX_M, MATCH)
    assert not check.settled
    assert not check.due  # not before a second has passed
    monkeypatch.setattr(depth_alignment, "CHECK_AGAIN_NS", 0)
    check.take(device_depth(), scene(), F_B_PX_M, MATCH)
    assert check.due


def test_no_depth_and_blank_images_count_for_nothing() -> None:
    left, right = rendered("street")
    nothing = np.zeros(left.shape, np.uint16)
    assert alignment_pixels(nothing, (left, right), VIEW_F_B_PX_M, 7) == (0, 0)
    blank = np.full(left.shape, 200, np.uint8)
    assert alignment_pixels(matched("street", "left"), (blank, blank), VIEW_F_B_PX_M, 7) == (0, 0)
