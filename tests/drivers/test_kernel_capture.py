"""The stream of a video device through the real linuxpy, whose requests a fake kernel answers."""

from __future__ import annotations

import errno
import time
from pathlib import Path

import pytest

from drivers.base import BadData, DeviceNotFound
from drivers.cameras.kernel_capture import CaptureFormat, LinuxpyCapture

from .fake_v4l2 import HEIGHT, WIDTH, FakeV4l2, fourcc

IMAGE = bytes(range(256)) * 4


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeV4l2:
    return FakeV4l2(tmp_path / "video0").install(monkeypatch)


def wanted(device: FakeV4l2) -> CaptureFormat:
    return CaptureFormat(
        camera="front", device=str(device.path), width=WIDTH, height=HEIGHT, pixel_format="Z16 ", fps=30.0
    )


def test_buffers_come_with_bytes_sequence_stamp_and_fault(device: FakeV4l2) -> None:
    """The kernel clears all of these when the buffer is returned to it."""
    capture = LinuxpyCapture(wanted(device))
    device.frames = [(IMAGE, 7, False), (IMAGE[:600], 9, True)]
    whole, part = capture.read(), capture.read()
    assert (whole.data, whole.sequence, whole.faulty, whole.bytes_per_line) == (IMAGE, 7, False, 2 * WIDTH)
    assert (part.data, part.sequence, part.faulty) == (IMAGE[:600], 9, True)
    assert 0 < whole.stamp_ns <= part.stamp_ns <= time.monotonic_ns()
    assert wanted(device).is_whole(whole)
    assert not wanted(device).is_whole(part)
    capture.close()


def test_a_buffer_that_is_filled_again_does_not_change_what_was_read(device: FakeV4l2) -> None:
    capture = LinuxpyCapture(wanted(device))
    device.frames = [(IMAGE, 0, False), *[(bytes(1024), k, False) for k in range(1, 9)]]
    first = capture.read()
    for _ in range(8):
        capture.read()
    assert first.data == IMAGE
    capture.close()


@pytest.mark.parametrize("unplugged", [False, True])
def test_a_closed_device_holds_neither_descriptors_nor_memory(device: FakeV4l2, unplugged: bool) -> None:
    """Each mapped buffer kept the device open for the kernel: the next opening found it busy."""
    capture = LinuxpyCapture(wanted(device))
    assert device.mappings == 4
    if unplugged:
        device.unplug()
    capture.close()
    capture.close()
    assert (device.descriptors, device.mappings) == (0, 0)


@pytest.mark.parametrize("fails", ["S_FMT", "G_FMT", "S_PARM", "REQBUFS", "QUERYBUF", "QBUF", "STREAMON"])
def test_a_device_that_does_not_start_is_closed_and_the_cause_named(device: FakeV4l2, fails: str) -> None:
    device.fails = {fails: errno.ENOSPC}
    with pytest.raises(DeviceNotFound, match=r"camera front: .*video0 cannot be opened \(No space left on device\)"):
        LinuxpyCapture(wanted(device))
    assert (device.descriptors, device.mappings) == (0, 0)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"pixel_format": fourcc("YUYV")}, "requested 32x16 Z16, the device gives 32x16 YUYV"),
        ({"width": 64}, "requested 32x16 Z16, the device gives 64x16 Z16"),
        ({"bytes_per_line": 32}, "states 32 bytes per line of 32 pixels"),
        ({"pixel_format": fourcc("Q!zz")}, "requested 32x16 Z16, the device gives 32x16 Q!zz"),
        ({"pixel_format": 0}, "requested 32x16 Z16, the device gives 32x16 an unknown format"),
    ],
)
def test_another_format_is_named_also_where_linuxpy_does_not_know_it(
    device: FakeV4l2, change: dict[str, int], cause: str
) -> None:
    for name, value in change.items():
        setattr(device, name, value)
    with pytest.raises(BadData, match=cause):
        LinuxpyCapture(wanted(device))
    assert (device.descriptors, device.mappings) == (0, 0)


@pytest.mark.parametrize(
    ("fails", "number"), [("QUERYCAP", errno.ENOTTY), ("", 0)], ids=["no video device", "the node of its metadata"]
)
def test_what_has_no_images_is_named(device: FakeV4l2, fails: str, number: int) -> None:
    """Each USB camera has a second node for its metadata."""
    device.capabilities &= ~1
    device.fails = {fails: number, "S_FMT": errno.EINVAL}
    with pytest.raises(DeviceNotFound, match=r"camera front: .*video0 delivers no images.*-video-index0"):
        LinuxpyCapture(wanted(device))
    assert device.descriptors == 0


@pytest.mark.parametrize(
    ("fails", "number", "remedy"),
    [
        ("S_FMT", errno.EBUSY, "another program uses it: end that program"),
        (
            "STREAMON",
            errno.ENOSPC,
            "no bandwidth is left on its USB bus: connect it to another controller, or lower fps",
        ),
    ],
)
def test_the_remedy_is_that_of_the_cause(device: FakeV4l2, fails: str, number: int, remedy: str) -> None:
    device.fails = {fails: number}
    with pytest.raises(DeviceNotFound, match=remedy):
        LinuxpyCapture(wanted(device))


def test_a_device_without_permission_names_the_group(device: FakeV4l2, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("linuxpy.io.open", refuse, raising=False)
    with pytest.raises(DeviceNotFound, match=r"\(Permission denied\); add the user to the group video"):
        LinuxpyCapture(wanted(device))
