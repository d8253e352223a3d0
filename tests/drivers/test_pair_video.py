"""Side-by-side images of a device behind a fake stream of the kernel's driver."""

from __future__ import annotations

import errno
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from core.types import UNKNOWN_MM
from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.cameras import zed_uvc
from drivers.cameras.kernel_capture import RawBuffer
from drivers.cameras.pair_video import DeviceVideo, StampedImage, image_from_buffer, pair_format
from drivers.cameras.row_alignment import MEASUREMENTS
from drivers.cameras.stereo import MatchParams, StereoDepth
from drivers.cameras.whole_buffers import MOST_IN_A_ROW
from drivers.cameras.zed_uvc import ZedSettings, ZedSource, halves
from tests.nightly import nightly

from .test_v4l2_depth import FakeStream
from .zed_images import CALIBRATION, side_by_side

WANTED = pair_format("front", "/dev/video5", (672, 376), 15.0)
SETTINGS = ZedSettings(camera="front", device="/dev/video5", calibration=Path("SN2.conf"))


@cache
def sent(seed: int, black_rows: int = 0) -> bytes:
    """A live image of a wall at 6 m as a ZED sends it, above black rows."""
    noise = np.random.Generator(np.random.PCG64(seed)).normal(0.0, 2.0, (376, 1344))
    grey = np.clip(cv2.cvtColor(side_by_side(6.0), cv2.COLOR_BGR2GRAY) + noise, 16, 235).astype(np.uint8)
    grey[376 - black_rows :] = 16
    return np.dstack([grey, np.full_like(grey, 128)]).tobytes()


def buffer(data: bytes, faulty: bool = False) -> RawBuffer:
    return RawBuffer(data, 2 * 1344, 0, time.monotonic_ns() - 8_000_000, faulty)


def decoded(data: bytes) -> NDArray[np.uint8]:
    rows = np.frombuffer(data, np.uint8).reshape(376, 1344, 2)
    return np.asarray(cv2.cvtColor(rows, cv2.COLOR_YUV2BGR_YUYV), np.uint8)


def without_packet(data: bytes, lost: int = 2024) -> bytes:
    """What the kernel's driver makes of it: what follows moves up, and the buffer states fewer bytes."""
    begin = 100 * 2 * 1344 + 400
    return data[:begin] + data[begin + lost :]


def test_both_eyes_are_requested_side_by_side() -> None:
    assert (WANTED.width, WANTED.height, WANTED.pixel_format) == (1344, 376, "YUYV")


def test_the_newest_image_is_delivered_with_its_stamp() -> None:
    stream = FakeStream()
    video = DeviceVideo(WANTED, stream)
    for k in range(3):
        stream.fill(newest := buffer(sent(k)))
    taken = video.read(1.0)
    assert taken is not None
    image, stamp_ns = taken
    assert np.array_equal(image, decoded(newest.data))
    assert stamp_ns == newest.stamp_ns
    video.close()
    assert stream.closed == 1


def test_a_whole_image_is_delivered_although_a_newer_one_arrived_in_part() -> None:
    stream = FakeStream()
    video = DeviceVideo(WANTED, stream)
    stream.fill(whole := buffer(sent(0)))
    stream.fill(buffer(without_packet(sent(1))))
    taken = video.read(1.0)
    assert taken is not None
    assert taken[1] == whole.stamp_ns


def test_padded_rows_are_cut() -> None:
    data = sent(0)
    rows = np.zeros((376, 2752), np.uint8)
    rows[:, :2688] = np.frombuffer(data, np.uint8).reshape(376, 2688)
    for padded in (rows.tobytes(), rows.tobytes()[:-64]):  # the last line may have no padding
        assert np.array_equal(image_from_buffer(RawBuffer(padded, 2752, 0, 1), WANTED), decoded(data))


def test_an_unplugged_device_is_lost() -> None:
    stream = FakeStream()
    video = DeviceVideo(WANTED, stream)
    stream.fill(OSError(errno.ENODEV, "No such device"))
    with pytest.raises(
        DeviceLost, match=r"camera front: /dev/video5 was lost \(No such device\); check cable and power"
    ):
        video.read(1.0)


class Fed(DeviceVideo):
    """A device that fills one buffer for each read, until it is silent."""

    def __init__(self, buffers: list[RawBuffer]) -> None:
        self._stream = FakeStream()
        self._waiting = list(buffers)
        super().__init__(WANTED, self._stream)

    def read(self, timeout_s: float) -> StampedImage | None:
        if self._waiting:
            self._stream.fill(replace(self._waiting.pop(0), stamp_ns=time.monotonic_ns() - 8_000_000))
        return super().read(timeout_s)


@pytest.mark.parametrize(("faulty", "black_rows"), [(False, 120), (True, 0), *nightly((False, 0), (True, 120))])
def test_an_image_that_lost_a_packet_is_left_out_whatever_it_ends_with(black_rows: int, faulty: bool) -> None:
    """With black rows at its end nothing in the image shows it: it was measured too far by more than a fifth in places."""
    whole, torn = sent(5, black_rows), without_packet(sent(5, black_rows))
    mixed = decoded(torn + whole[-2024:])  # what was measured before: the buffer with its old end
    depth_mm = StereoDepth(CALIBRATION).depth(*halves(mixed))[110 : 376 - black_rows]
    assert np.mean(depth_mm > 1.2 * 6000) > 0.01
    opening = [buffer(sent(k)) for k in range(MEASUREMENTS)]
    source = ZedSource(
        SETTINGS, lambda _: Fed([*opening, buffer(whole), buffer(torn, faulty), buffer(whole)]), CALIBRATION
    )
    source.open()
    assert [source.read(0.0) is not None for _ in range(4)] == [True, True, False, True]


def test_images_that_always_arrive_in_part_name_the_cause() -> None:
    torn = [buffer(without_packet(sent(0)))] * MOST_IN_A_ROW
    source = ZedSource(SETTINGS, lambda _: Fed([*[buffer(sent(k)) for k in range(MEASUREMENTS)], *torn]), CALIBRATION)
    source.open()
    assert source.read(0.0) is not None
    assert [source.read(0.0) for _ in range(MOST_IN_A_ROW - 1)] == [None] * (MOST_IN_A_ROW - 1)
    with pytest.raises(BadData, match="camera front: the last 10 images arrived in part only; check the cable"):
        source.read(0.0)


def test_silence_ends_with_the_time_out() -> None:
    """It took 5 s, so that the supervision took the process for one that hangs, and ended it before it could name a cause."""
    source = ZedSource(SETTINGS, lambda _: Fed([buffer(sent(k)) for k in range(MEASUREMENTS)]), CALIBRATION)
    source.open()
    assert source.read(0.0) is not None
    assert source.read(0.05) is None
    assert source.read(0.05) is None


@pytest.mark.parametrize("torn", [0, 2])
def test_a_device_that_sends_no_image_at_its_opening_is_lost(torn: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zed_uvc, "FIRST_IMAGE_S", 0.2)
    source = ZedSource(SETTINGS, lambda _: Fed([buffer(without_packet(sent(0)))] * torn), CALIBRATION)
    with pytest.raises(DeviceLost, match="camera front: /dev/video5 delivers no images; use a USB 3 port and cable"):
        source.open()
    with pytest.raises(DeviceNotFound, match=r"not open; call open\(\) first"):
        source.read(0.0)


@pytest.mark.parametrize("grey", [0, 16, 255])
def test_black_and_saturated_rows_are_unknown_and_never_sky(grey: int) -> None:
    """The end of an image that may not have arrived, or of a night: neither measured nor marked as a surface without texture."""
    image = decoded(sent(5))
    image[200:] = grey
    depth_mm = StereoDepth(CALIBRATION, MatchParams(mark_smooth=True)).depth(*halves(image))
    assert np.count_nonzero(depth_mm[:180] != UNKNOWN_MM) > 50_000
    assert (depth_mm[225:] == UNKNOWN_MM).all()
