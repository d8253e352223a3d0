"""The OAK driver with rectified images: real depthai messages and the real Sync node, without a device."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta

import depthai as dai
import numpy as np
import pytest

from drivers.base import BadData, DeviceLost
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings
from tests.waiting import until

from .oak_host import PERIOD_S, HostLink, HostPairLink, depth_message, group_message, image_message, now, stamp_ns
from .test_device_matches import F_PX, WALL_MM, WIDTH, device_depth, scene
from .test_oak import read_all

pytestmark = pytest.mark.process

SETTINGS = OakSettings(camera="front", first_frame_s=60.0, fps=1.0 / PERIOD_S)
MATRIX = [[F_PX, 0.0, 119.5], [0.0, F_PX, 39.5], [0.0, 0.0, 1.0]]
LEFT, RIGHT = scene(sky_rows=40)
DEPTH = device_depth()
DEPTH[:40] = 2000
"""The device gives the blank sky a depth of 2 m."""


def parts(number: int) -> dict[str, dai.ImgFrame]:
    stamp = now() - timedelta(milliseconds=20)
    return {
        "depth": depth_message(number, pixels=DEPTH, matrix=MATRIX, stamp=stamp),
        "left": image_message(number, LEFT, stamp),
        "right": image_message(number, RIGHT, stamp, dai.ImgFrame.Type.GRAY8),
    }


def test_depth_that_the_images_do_not_confirm_is_unknown() -> None:
    stamps_ns = {}

    def make(number: int) -> dict[str, dai.ImgFrame]:
        found = parts(number)
        stamps_ns[number] = stamp_ns(found["depth"])
        return found

    begun_ns = time.monotonic_ns()
    source = OakSource(SETTINGS, HostPairLink(make))
    source.open()
    try:
        assert not source.info.marks_smooth
        for _ in range(3):
            frame = source.read(60.0)
            assert frame is not None
            assert not frame.depth_mm[:34].any()
            assert np.mean(frame.depth_mm[48:-8, 24:-8] == WALL_MM) > 0.95
            assert frame.images_crc == 0, "the device matches them, and its depth is compared"
            assert frame.t_exposure_ns == stamps_ns[frame.sequence]
            assert begun_ns <= frame.t_arrival_ns <= time.monotonic_ns()
    finally:
        source.close()


@pytest.mark.parametrize("stated", [("left",), ("depth", "left"), ("depth",)])
def test_the_exposure_time_may_be_stated_by_the_image_alone(stated: tuple[str, ...]) -> None:
    """Without it the end of the exposure would count as its middle: in dusk 10 ms later, 0.6 degrees at 60 deg/s."""
    ends_ns = {}

    def make(number: int) -> dai.MessageGroup:
        found = parts(number)
        ends_ns[number] = stamp_ns(found["depth"])
        for name in stated:
            found[name].cam.exposureTimeUs = 20_000
        return group_message(found)

    source = OakSource(SETTINGS, HostLink(make))
    source.open()
    try:
        frame = source.read(60.0)
        assert frame is not None
        assert frame.t_exposure_ns == ends_ns[frame.sequence] - 10_000_000
    finally:
        source.close()


@pytest.mark.parametrize("missing", ["left", "right", "depth"])
def test_a_stream_that_never_comes_is_a_lost_device(missing: str) -> None:
    def without(number: int) -> dict[str, dai.ImgFrame]:
        return {name: message for name, message in parts(number).items() if name != missing}

    source = OakSource(replace(SETTINGS, first_frame_s=0.5), HostPairLink(without))
    with pytest.raises(
        DeviceLost, match=r"no depth frame with both rectified images within 0.5 s; check that the cable"
    ):
        source.open()


def test_streams_of_different_exposures_are_no_frames() -> None:
    def late(number: int) -> dict[str, dai.ImgFrame]:
        found = parts(number)
        found["right"].setTimestamp(found["right"].getTimestamp() - timedelta(seconds=0.5 * PERIOD_S))
        return found

    source = OakSource(replace(SETTINGS, first_frame_s=0.5), HostPairLink(late))
    with pytest.raises(DeviceLost, match="no depth frame with both rectified images"):
        source.open()


def apart(number: int, apart_s: float) -> dict[str, dai.ImgFrame]:
    """Parts whose right image was exposed earlier."""
    found = parts(number)
    found["right"].setTimestamp(found["right"].getTimestamp() - timedelta(seconds=apart_s))
    return found


def test_cameras_that_expose_within_a_fraction_of_a_millisecond_are_one_exposure() -> None:
    source = OakSource(SETTINGS, HostPairLink(lambda k: apart(k, 0.0002)))
    source.open()
    assert source.read(60.0) is not None
    source.close()


@pytest.mark.parametrize("apart_s", [0.003, 0.3 * PERIOD_S])
@pytest.mark.parametrize("on_host", [False, True])
def test_cameras_that_do_not_expose_together_are_refused(apart_s: float, on_host: bool) -> None:
    """In a turn of 60 deg/s the depth of a wall at 5 m is 30 m with exposures 12 ms apart, and 7 m with 5 ms."""
    settings = replace(SETTINGS, first_frame_s=0.5, host_matching=on_host)
    made = [0]

    def make(number: int) -> dict[str, dai.ImgFrame]:
        made[0] = number
        found = apart(number, apart_s)
        found["left"].setTransformation(found["depth"].getTransformation())
        return {name: found[name] for name in settings.streams}

    source = OakSource(settings, HostPairLink(make, streams=settings.streams))
    assert until(lambda: made[0] > 4)  # without any frame it would be a lost device
    with pytest.raises(BadData, match=r"left and right image are exposed (3|12)\.\d ms apart; .* synchron"):
        source.open()


def test_single_images_that_are_exposed_apart_are_left_out() -> None:
    source = OakSource(SETTINGS, HostPairLink(lambda k: apart(k, 0.0 if k % 5 == 0 else 0.003)))
    source.open()
    try:
        found = [source.read(60.0) for _ in range(15)]
        assert {f.sequence % 5 for f in found if f is not None} == {0}
    finally:
        source.close()


@pytest.mark.parametrize("held", ["left", "right"])
def test_a_camera_that_repeats_its_image_is_refused(held: str) -> None:
    """With new stamps, while the other one goes on: in motion the disparity would be that of two moments."""
    rng = np.random.Generator(np.random.PCG64(2))
    noise = [rng.integers(-1, 2, LEFT.shape) for _ in range(5)]

    def make(number: int) -> dict[str, dai.ImgFrame]:
        found = parts(number)
        for name, image in (("left", LEFT), ("right", RIGHT)):
            k = min(number, 3) if name == held else number
            live = np.clip(image.astype(int) + noise[k % 5], 0, 255).astype(np.uint8)
            found[name] = image_message(number, live, found["depth"].getTimestamp())
        return found

    source = OakSource(SETTINGS, HostPairLink(make))
    source.open()
    try:
        with pytest.raises(BadData, match="one of both images is that of an earlier frame"):
            read_all(source)
    finally:
        source.close()


def test_a_stream_that_ends_in_operation_ends_the_frames() -> None:
    """No depth is delivered untested, and none with images of an earlier exposure: the service becomes blind."""

    made = [0]

    def ending(number: int) -> dict[str, dai.ImgFrame]:
        made[0] = number
        return {name: message for name, message in parts(number).items() if number < 4 or name != "right"}

    source = OakSource(SETTINGS, HostPairLink(ending))
    source.open()
    try:
        assert until(lambda: made[0] > 12)
        found = [source.read(0.1) for _ in range(6)]
        assert {f.sequence for f in found if f is not None} <= {0, 1, 2, 3}
    finally:
        source.close()


def cut_short(message: dai.ImgFrame) -> dai.ImgFrame:
    """With half of its bytes."""
    message.setData(bytes(message.getData()[: len(message.getData()) // 2]))
    return message


def changed(name: str, make: Callable[[timedelta], dai.ImgFrame | None]) -> dai.MessageGroup:
    """A group with another message in the place of one, or without it. make: gets the exposure of the group."""
    found = parts(0)
    message = make(found.pop(name).getTimestamp())
    if message is not None:
        found[name] = message
    return group_message(found)


@pytest.mark.parametrize(
    ("name", "make", "cause"),
    [
        ("left", lambda stamp: None, "a frame without its left image"),
        ("depth", lambda stamp: None, "a frame without its depth image"),
        (
            "right",
            lambda stamp: image_message(0, RIGHT[:, : WIDTH // 2].copy(), stamp),
            r"\(80, 120\), for a frame of \(80, 240\)",
        ),
        (
            "left",
            lambda stamp: depth_message(0, pixels=DEPTH, stamp=stamp),
            r"a left image of uint16, .* expected RAW8",
        ),
        (
            "right",
            lambda stamp: image_message(0, RIGHT, stamp - timedelta(seconds=0.18)),
            r"a right image is stamped 0\.1\d\d s",
        ),
        ("right", lambda stamp: cut_short(image_message(0, RIGHT, stamp)), "a right image cannot be read"),
        ("left", lambda stamp: dai.Buffer(), "a left image of type Buffer"),
    ],
)
def test_groups_that_cannot_be_used_name_the_cause_and_the_remedy(
    name: str, make: Callable[[timedelta], dai.ImgFrame | None], cause: str
) -> None:
    changed(name, make)  # an exception inside of a node would end this process
    source = OakSource(SETTINGS, HostLink(lambda k: changed(name, make)))
    with pytest.raises(BadData, match=cause) as error:
        source.open()
    assert "set match_correlation = 0" in str(error.value)


def test_depth_alone_is_refused_where_images_were_requested() -> None:
    with pytest.raises(BadData, match="a frame without its depth image"):
        OakSource(SETTINGS, HostLink(depth_message)).open()
