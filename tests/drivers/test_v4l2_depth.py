"""The V4L2 driver behind a fake stream: a pipe for readiness, buffers as the kernel fills them."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.types import FAR_MM, SATURATED_MM, Intrinsics, is_measured
from drivers.base import BadData, DeviceLost, DeviceNotFound
from drivers.cameras.kernel_capture import CaptureFormat, RawBuffer
from drivers.cameras.kernel_stamps import AHEAD_NS, KernelStamps
from drivers.cameras.v4l2_depth import V4l2Settings, V4l2Source, depth_from_buffer
from drivers.cameras.whole_buffers import MOST_IN_A_ROW

SIZE = Intrinsics(32, 16, 30.0, 30.0, 15.5, 7.5)
SETTINGS = V4l2Settings(camera="front", device="/dev/video9", intrinsics=SIZE, exposure_latency_s=0.012)


class FakeStream:
    """Readable while buffers wait."""

    def __init__(self) -> None:
        self._out, self._in = os.pipe()
        self.buffers: list[RawBuffer | OSError] = []
        self.closed = 0

    def __call__(self, wanted: CaptureFormat) -> FakeStream:
        return self

    def fill(self, item: RawBuffer | OSError) -> None:
        self.buffers.append(item)
        os.write(self._in, b".")

    def fileno(self) -> int:
        return self._out

    def read(self) -> RawBuffer:
        os.read(self._out, 1)
        item = self.buffers.pop(0)
        if isinstance(item, OSError):
            raise item
        return item

    def close(self) -> None:
        self.closed += 1


def pixels(value: int = 1234) -> np.ndarray:
    return (np.arange(16 * 32, dtype=np.uint16) + value).reshape(16, 32)


def buffer(sequence: int = 0, **changes: Any) -> RawBuffer:
    content: dict[str, Any] = {
        "data": pixels(1000 + sequence).tobytes(),
        "bytes_per_line": 64,
        "stamp_ns": time.monotonic_ns() - 5_000_000,
    }
    content |= changes
    return RawBuffer(sequence=sequence, **content)


def opened(settings: V4l2Settings = SETTINGS) -> tuple[V4l2Source, FakeStream]:
    stream = FakeStream()
    source = V4l2Source(settings, stream)
    source.open()
    return source, stream


def test_a_frame_is_exposed_before_the_kernels_stamp() -> None:
    source, stream = opened()
    b = buffer(7)
    stream.fill(b)
    frame = source.read(1.0)
    assert frame is not None
    assert frame.t_exposure_ns == b.stamp_ns - 12_000_000
    assert frame.t_arrival_ns >= b.stamp_ns
    assert frame.sequence == 7
    assert np.array_equal(frame.depth_mm, pixels(1007))
    assert source.info.intrinsics == SIZE
    assert not source.info.marks_smooth
    assert source.info.bias_per_m * 2.0**2 == pytest.approx(0.02 * 2.0)  # 2 % at 2 m


def test_the_newest_of_several_buffers_is_delivered() -> None:
    source, stream = opened()
    for k in range(3):
        stream.fill(buffer(k))
    frame = source.read(1.0)
    assert frame is not None
    assert frame.sequence == 2
    assert source.read(0.0) is None


def test_silence_ends_with_the_time_out() -> None:
    source, _ = opened()
    begun = time.monotonic()
    assert source.read(0.05) is None
    assert time.monotonic() - begun >= 0.05


def test_a_buffer_that_the_driver_calls_faulty_is_left_out() -> None:
    source, stream = opened()
    stream.fill(buffer(0))
    stream.fill(buffer(1, faulty=True))
    frame = source.read(1.0)
    assert frame is not None
    assert frame.sequence == 0


def short(sequence: int) -> RawBuffer:
    """A buffer of which a part arrived. Old kernels do not mark it, where the camera uses bulk transfers as a D400 does."""
    return buffer(sequence, data=pixels(1000 + sequence).tobytes()[:600])


def test_a_buffer_that_was_filled_in_part_is_left_out() -> None:
    """One of them ended the camera's process, with a remedy for another size."""
    source, stream = opened()
    for item in (short(0), buffer(1), short(2)):
        stream.fill(item)
    frame = source.read(1.0)
    assert frame is not None
    assert frame.sequence == 1
    stream.fill(short(3))
    assert source.read(0.0) is None


def test_buffers_that_are_always_filled_in_part_name_the_causes() -> None:
    source, stream = opened()
    for k in range(MOST_IN_A_ROW):
        stream.fill(short(k) if k % 2 else buffer(k, faulty=True))
    with pytest.raises(
        BadData, match=r"the last 10 images arrived in part only; check the cable.*set width_px and height_px"
    ):
        source.read(0.0)


def test_a_whole_buffer_ends_the_number_of_those_filled_in_part() -> None:
    source, stream = opened()
    for k in range(3 * MOST_IN_A_ROW):
        stream.fill(buffer(k) if k % MOST_IN_A_ROW == MOST_IN_A_ROW - 1 else short(k))
    frame = source.read(0.0)
    assert frame is not None
    assert frame.sequence == 3 * MOST_IN_A_ROW - 1


def test_an_unplugged_device_is_lost() -> None:
    source, stream = opened()
    stream.fill(OSError(errno.ENODEV, "No such device"))
    with pytest.raises(DeviceLost, match=r"/dev/video9 was lost \(No such device\); check cable"):
        source.read(1.0)
    source.close()
    source.close()
    assert stream.closed == 1


@pytest.mark.parametrize("off_s", [-10.0, 3.0])
def test_stamps_of_another_clock_are_refused(off_s: float) -> None:
    source, stream = opened()
    stream.fill(buffer(0, stamp_ns=time.monotonic_ns() + round(off_s * 1e9)))
    with pytest.raises(BadData, match="does not use the monotonic clock"):
        source.read(1.0)


def test_a_buffer_that_waited_keeps_its_stamp() -> None:
    """The process was stopped for 3 s after its first frame."""
    source, stream = opened()
    stream.fill(buffer(0))
    assert source.read(1.0) is not None
    old = buffer(1, stamp_ns=time.monotonic_ns() - 3 * 10**9)
    stream.fill(old)
    frame = source.read(1.0)
    assert frame is not None
    assert frame.t_exposure_ns == old.stamp_ns - 12_000_000


def test_a_stamp_a_little_ahead_is_now() -> None:
    now_ns = 10**10
    assert KernelStamps("front").accepted_ns(now_ns + AHEAD_NS, now_ns) == now_ns
    with pytest.raises(BadData, match="does not use the monotonic clock"):
        KernelStamps("front").accepted_ns(now_ns + AHEAD_NS + 1, now_ns)
    source, stream = opened()
    ahead_ns = time.monotonic_ns() + 4_000_000
    stream.fill(buffer(0, stamp_ns=ahead_ns))
    frame = source.read(1.0)
    assert frame is not None
    assert frame.t_exposure_ns <= frame.t_arrival_ns - round(SETTINGS.exposure_latency_s * 1e9)
    assert frame.t_exposure_ns <= ahead_ns - round(SETTINGS.exposure_latency_s * 1e9)


def test_padded_lines_are_cut() -> None:
    rows = np.zeros((16, 40), np.uint16)
    rows[:, :32] = pixels()
    for data in (rows.tobytes(), rows.tobytes()[:-16]):  # the last line may have no padding
        assert np.array_equal(depth_from_buffer(buffer(data=data, bytes_per_line=80), SETTINGS), pixels())


def test_a_depth_of_65_m_is_no_statement_that_all_before_is_free() -> None:
    units = np.full((16, 32), FAR_MM, np.uint16)
    assert not depth_from_buffer(buffer(data=units.tobytes()), SETTINGS).any()


def test_units_become_millimetres_and_what_does_not_fit_is_unknown() -> None:
    settings = V4l2Settings(camera="a", device="x", intrinsics=SIZE, depth_unit_mm=0.25)
    units = np.full((16, 32), 8002, np.uint16)
    units[0, 0] = 0
    mm = depth_from_buffer(buffer(data=units.tobytes()), settings)
    assert mm[0, 0] == 0
    assert mm[1, 1] == 2001
    coarse = V4l2Settings(camera="a", device="x", intrinsics=SIZE, depth_unit_mm=10.0)
    assert depth_from_buffer(buffer(data=units.tobytes()), coarse)[1, 1] == 0


@pytest.mark.parametrize("unit_mm", [1.0, 0.1, 0.25, 0.5, 10.0])
def test_the_greatest_value_is_no_distance_in_any_unit(unit_mm: float) -> None:
    """Some sensors write it where nothing is measured. With units of 0.1 mm it was 6.55 m: farther than the range, so free."""
    settings = V4l2Settings(camera="a", device="x", intrinsics=SIZE, depth_unit_mm=unit_mm)
    units = np.full((16, 32), 5000, np.uint16)
    units[3] = SATURATED_MM
    mm = depth_from_buffer(buffer(data=units.tobytes()), settings)
    assert not is_measured(mm[3]).any()
    assert not (mm[3] == FAR_MM).any()
    assert (mm[4] == round(5000 * unit_mm)).all()


def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    settings = V4l2Settings(camera="front", device=str(tmp_path / "video7"), intrinsics=SIZE)
    with pytest.raises(DeviceNotFound, match="check that it is connected, and set device to a path"):
        V4l2Source(settings).open()
    with pytest.raises(DeviceNotFound, match="call open"):
        V4l2Source(settings).read(0.1)


def test_a_file_that_is_no_camera(tmp_path: Path) -> None:
    (tmp_path / "video7").write_bytes(b"")
    settings = V4l2Settings(camera="front", device=str(tmp_path / "video7"), intrinsics=SIZE)
    with pytest.raises(DeviceNotFound, match=r"it is no camera.* in /dev/v4l/by-path"):
        V4l2Source(settings).open()
