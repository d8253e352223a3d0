"""The stream of reduced depth images: sent only with a subscriber, subsampled, at most at the configured rate."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq

from companion.live.depth_preview import WIDTH_PX, DepthPreviews, subsample
from companion.streams.publication import PublicationStamps
from core.types import DepthFrame
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import until

pytestmark = pytest.mark.process

Context = zmq.Context[zmq.Socket[bytes]]


@pytest.fixture
def context() -> Iterator[Context]:
    context: Context = zmq.Context()
    yield context
    context.destroy(linger=0)


@pytest.fixture
def address(tmp_path: Path) -> str:
    return f"ipc://{tmp_path}/depth"


@pytest.fixture
def previews(context: Context, address: str) -> Iterator[DepthPreviews]:
    previews = DepthPreviews(PublicationStamps("this boot"), 0.02)
    previews.open(address, context)
    yield previews
    previews.close()


def frame(sequence: int, camera: str = "front") -> DepthFrame:
    depth_mm = np.random.default_rng(sequence).integers(0, 65536, (480, 640), dtype=np.uint16)
    t_ns = time.monotonic_ns()
    return DepthFrame(
        camera=camera, sequence=sequence, t_exposure_ns=t_ns - 40_000_000, t_arrival_ns=t_ns, depth_mm=depth_mm
    )


def listener(context: Context, address: str) -> zmq.Socket[bytes]:
    subscriber = context.socket(zmq.SUB)
    subscriber.connect(address)
    subscriber.setsockopt(zmq.SUBSCRIBE, b"")
    return subscriber


@pytest.mark.parametrize(
    ("shape", "small"),
    [
        ((480, 640), (240, 320)),
        ((240, 320), (240, 320)),
        ((400, 641), (133, 213)),
        ((1, 1), (1, 1)),
        ((2, 1280), (1, 320)),
    ],
)
def test_pixels_are_picked_and_never_blended(shape: tuple[int, int], small: tuple[int, int]) -> None:
    depth_mm = np.arange(shape[0] * shape[1], dtype=np.uint32).reshape(shape).astype(np.uint16)
    got = subsample(depth_mm)
    assert got.shape == small
    assert got.shape[1] <= WIDTH_PX
    step = -(-shape[1] // WIDTH_PX)
    for v, u in ((0, 0), (small[0] - 1, small[1] - 1), (small[0] // 2, small[1] // 3)):
        cell = depth_mm[v * step : (v + 1) * step, u * step : (u + 1) * step]
        assert got[v, u] in cell


def test_nothing_is_made_without_a_listener_and_again_when_it_has_gone(
    context: Context, address: str, previews: DepthPreviews
) -> None:
    for k in range(3):
        previews.show(frame(k, f"camera {k}"))
    assert not until(lambda: previews.sent, 0.1)
    subscriber = listener(context, address)

    def shown() -> bool:
        previews.show(frame(7, f"camera {time.monotonic_ns()}"))
        return previews.sent > 0

    assert until(shown)
    subscriber.close(0)

    def quiet() -> bool:
        before = previews.sent
        previews.show(frame(8, f"camera {time.monotonic_ns()}"))
        return previews.sent == before

    assert until(quiet)


def test_a_listener_gets_each_camera_no_more_often_than_asked(
    context: Context, address: str, previews: DepthPreviews
) -> None:
    subscriber = listener(context, address)

    def all_shown() -> bool:
        for camera in ("front", "rear"):
            previews.show(frame(3, camera))
        return previews.sent >= 2

    assert until(all_shown)
    for k in range(20):
        previews.show(frame(k))
    assert previews.sent == 2, "the next of each is due after 50 s"
    got = {}
    while len(got) < 2 and subscriber.poll(60_000):
        message = pb.DepthPreview.FromString(subscriber.recv())
        got[message.camera] = message
    assert set(got) == {"front", "rear"}
    preview = got["front"]
    sent = frame(3).depth_mm
    assert (preview.schema_version, preview.sequence, preview.width_px, preview.height_px) == (1, 3, 320, 240)
    assert np.array_equal(np.frombuffer(preview.depth_mm, "<u2").reshape(240, 320), subsample(sent))
    assert 40_000_000 <= preview.publication.age_ns < 60_000_000_000
    assert preview.publication.boot_id == "this boot"


FLOOD = """
import sys, zmq
socket = zmq.Context().socket(zmq.XSUB)
socket.connect(sys.argv[1])
number = 0
while True:
    socket.send(b"\\1%d" % number)
    socket.send(b"\\0%d" % number)
    number += 1
"""


def test_a_flood_of_subscriptions_ends_the_stream_and_does_not_hold_the_pipeline(
    address: str, previews: DepthPreviews
) -> None:
    """They come faster than they are read: without a limit the pipeline's thread would read for ever."""
    floods = [subprocess.Popen([sys.executable, "-c", FLOOD, address]) for _ in range(2)]
    shows = threading.Thread(target=lambda: until(lambda: previews.show(frame(1)) or previews.fault), daemon=True)
    try:
        shows.start()
        assert until(lambda: "more than 1000 times" in previews.fault)
        shows.join()
    finally:
        for flood in floods:
            flood.kill()
            flood.wait()
    previews.show(frame(2))
    assert previews.sent == 0


def test_without_an_address_there_is_none(context: Context) -> None:
    previews = DepthPreviews(PublicationStamps(""))
    previews.open("", context)
    previews.show(frame(1))
    assert previews.sent == 0
    previews.close()
