"""Frames through shared memory between two real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from core.types import DepthFrame
from drivers.base import BadData, DeviceLost
from drivers.cameras.frame_channel import (
    _FRAME,
    SLOTS,
    FrameReader,
    FrameWriter,
    Notification,
    _FrameNotice,
    slot_bytes,
)

pytestmark = pytest.mark.process


def frame(sequence: int, width: int = 64, height: int = 48) -> DepthFrame:
    depth = np.full((height, width), 1000 + sequence, np.uint16)
    return DepthFrame(
        camera="front", sequence=sequence, t_exposure_ns=sequence, t_arrival_ns=sequence + 5, depth_mm=depth
    )


def pair() -> tuple[FrameReader, FrameWriter]:
    reader = FrameReader("front")
    return reader, FrameWriter(os.dup(reader.child_fd), "front")


def test_a_frame_comes_out_as_it_went_in() -> None:
    reader, writer = pair()
    rng = np.random.Generator(np.random.PCG64(1))
    depth = rng.integers(0, 65536, (48, 64)).astype(np.uint16)
    sent = DepthFrame(
        camera="front",
        sequence=7,
        t_exposure_ns=10**15,
        t_arrival_ns=10**15 + 3,
        depth_mm=depth,
        images_crc=0xFFFF_FFFE,
    )
    writer.write(sent)
    got, notifications = reader.read(1.0)
    assert got is not None
    assert (got.sequence, got.t_exposure_ns, got.t_arrival_ns) == (7, 10**15, 10**15 + 3)
    assert got.images_crc == 0xFFFF_FFFE
    assert np.array_equal(got.depth_mm, depth)
    assert notifications == []


def test_a_notification_that_is_too_large_is_refused_with_its_kind_and_size() -> None:
    """Cut off it would be no JSON, and the reader would take the process for faulty."""
    reader, writer = pair()
    with pytest.raises(BadData, match=r"camera front: the notification 'opened' has 7\d{4} bytes, more than 60000"):
        writer.send("opened", info={"text": "x" * 70_000})
    assert reader.read(0.0) == (None, [])
    writer.send("alive")
    assert reader.read(1.0) == (None, [Notification("alive", {})])


def test_only_the_newest_frame_is_delivered_and_the_others_are_counted() -> None:
    reader, writer = pair()
    for k in range(3):
        writer.write(frame(k))
    got, _ = reader.read(0.0)
    assert got is not None
    assert got.sequence == 2
    assert reader.dropped == 2
    assert reader.read(0.0) == (None, [])


def test_a_slow_reader_never_blocks_the_writer_and_receives_complete_frames() -> None:
    reader, writer = pair()
    for k in range(5000):
        writer.write(frame(k))
    seen = 0
    for _ in range(50):
        got, _ = reader.read(0.0)
        if got is not None:
            assert np.all(got.depth_mm == 1000 + got.sequence)
            seen += 1
    writer.write(frame(6000))
    got, _ = reader.read(1.0)
    assert got is not None
    assert got.sequence == 6000


def test_a_frame_that_was_overwritten_meanwhile_is_not_delivered() -> None:
    reader, writer = pair()
    writer.write(frame(1))
    payload = reader._receive()
    assert isinstance(payload, _FrameNotice)
    for k in range(2, 6):
        writer.write(frame(k))
    assert reader._frame(payload) is None
    assert reader.dropped == 1


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 20), slice(30, 48), slice(47, 48)])
def test_pixels_of_another_frame_under_the_right_marks_are_not_delivered(rows: slice) -> None:
    """What a processor with weak ordering may show of a writer that overtakes: the new pixels, and still the old marks."""
    reader, writer = pair()
    writer.write(frame(1))
    payload = reader._receive()
    assert isinstance(payload, _FrameNotice)
    assert writer._memory is not None
    at = (payload.number % SLOTS) * slot_bytes(64, 48) + 8
    np.ndarray((48, 64), np.uint16, writer._memory, at)[rows] = 1005
    assert reader._frame(payload) is None
    assert reader.dropped == 1


def test_the_size_of_the_image_may_change() -> None:
    reader, writer = pair()
    writer.write(frame(1))
    assert reader.read(1.0)[0] is not None
    writer.write(frame(2, width=128, height=96))
    got, _ = reader.read(1.0)
    assert got is not None
    assert got.depth_mm.shape == (96, 128)


def test_a_reader_that_was_too_slow_for_the_memory_gets_it_later() -> None:
    reader, writer = pair()
    for k in range(2000):
        writer.send("alive", number=k)
    writer.write(frame(1))
    assert reader.read(0.0)[0] is None
    writer.write(frame(2))
    got, _ = reader.read(1.0)
    assert got is not None
    assert got.sequence == 2


def test_texts_have_the_values_they_describe() -> None:
    reader, writer = pair()
    writer.send("opened", device="OAK-D", baseline_m=0.075)
    assert reader.read(1.0) == (None, [Notification("opened", {"device": "OAK-D", "baseline_m": 0.075})])


def test_the_last_notifications_of_a_process_are_received_before_its_end() -> None:
    reader, writer = pair()
    writer.write(frame(3))
    writer.send("failed", cause="the cable is out")
    reader.close_child()
    writer.close()
    got, notifications = reader.read(1.0)
    assert got is not None
    assert got.sequence == 3
    assert notifications == [Notification("failed", {"cause": "the cable is out"})]
    with pytest.raises(DeviceLost, match="has ended"):
        reader.read(1.0)


def test_what_no_reader_supports_is_refused() -> None:
    reader, writer = pair()
    writer._socket.send(b"\xff\xfe")
    with pytest.raises(BadData, match="cannot be decoded"):
        reader.read(1.0)
    writer._socket.send(_FRAME.pack(b"f", 1, 2, 3, 4, 5, 6)[:-1])
    with pytest.raises(BadData, match="cannot be decoded"):
        reader.read(1.0)
    writer._socket.send(b'{"width": 64}')
    with pytest.raises(BadData, match="cannot be decoded"):
        reader.read(1.0)
    writer._socket.send(_FRAME.pack(b"f", 1, 2, 3, 4, 5, 6))
    with pytest.raises(BadData, match="before the memory"):
        reader.read(1.0)


def test_a_slot_holds_its_marks_and_pixels_in_whole_pages() -> None:
    assert slot_bytes(64, 32) == 8192
    assert slot_bytes(640, 480) % 4096 == 0
    assert slot_bytes(640, 480) >= 640 * 480 * 2 + 16


CHILD = textwrap.dedent("""
    import sys, time, numpy as np
    from core.types import DepthFrame
    from drivers.cameras.frame_channel import FrameWriter
    writer = FrameWriter(int(sys.argv[1]), "front")
    writer.send("opened", pid=0)
    for k in range(100000):
        depth = np.full((480, 640), k % 60000 + 1, np.uint16)
        now = time.monotonic_ns()
        writer.write(DepthFrame(camera="front", sequence=k, t_exposure_ns=now, t_arrival_ns=now, depth_mm=depth))
        time.sleep(0.002)
""")


def drain(reader: FrameReader) -> None:
    """Reads until nothing can come any more."""
    while reader.read(5.0) != (None, []):
        pass


def test_frames_of_another_process_and_its_death() -> None:
    reader = FrameReader("front")
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(reader.child_fd)], pass_fds=[reader.child_fd])
    reader.close_child()
    try:
        seen = []
        while len(seen) < 50:
            got, _ = reader.read(60.0)
            if got is not None:
                assert np.all(got.depth_mm == got.sequence % 60000 + 1)
                seen.append(got.sequence)
        assert seen == sorted(set(seen))
        child.send_signal(signal.SIGKILL)
        child.wait(60.0)
        with pytest.raises(DeviceLost, match="its process has ended"):
            drain(reader)
    finally:
        child.kill()
        child.wait()
        reader.close()


def test_the_writer_notices_that_the_service_is_gone() -> None:
    reader, writer = pair()
    reader.close()
    with pytest.raises(DeviceLost, match="the service has ended"):
        writer.write(frame(1))
