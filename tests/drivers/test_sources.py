"""What every depth camera's driver and every recording promises, the same for all: the contracts of `drivers.base`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from companion.log.log_writer import write_recording
from core.types import DepthFrame
from drivers.base import DepthSource, DeviceLost, DeviceNotFound, EventSource
from drivers.cameras.oak import OakSource
from drivers.cameras.oak_pipeline import OakSettings
from drivers.cameras.v4l2_depth import V4l2Source
from drivers.cameras.zed_uvc import ZedSettings, ZedSource
from drivers.logs.reader import McapRecording
from drivers.simulation.camera import SimulatedDepthSource, Simulation
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flights import flight_plan
from drivers.simulation.looping_flight import LoopingFlight
from drivers.simulation.source import camera_info
from osape_client.proto import osape_v1_pb2 as pb

from .oak_host import DEVICE_ALONE, HostLink, depth_message
from .test_v4l2_depth import SETTINGS, FakeStream, buffer
from .zed_images import CALIBRATION, side_by_side

pytestmark = pytest.mark.process

FRAMES = 4
Camera = tuple[DepthSource, Callable[[], None]]
"""A source, and what lets its device deliver one more frame."""


def at_the_end(stop: Callable[[], None]) -> Callable[[], None]:
    """For a device that delivers by itself: what stops it where its last frame is due."""
    left = iter(range(FRAMES))

    def more() -> None:
        if next(left) == FRAMES - 1:
            stop()

    return more


def oak(folder: Path) -> Camera:
    """A pipeline on the host, which stops."""
    link = HostLink(depth_message)
    return OakSource(OakSettings(camera="front", match=DEVICE_ALONE, first_frame_s=60.0, find_s=0.1), link), at_the_end(
        link.stop
    )


def zed(folder: Path) -> Camera:
    """A video file, which ends."""
    path = folder / "pair.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (1344, 376))
    image = side_by_side()
    for _ in range(FRAMES):
        writer.write(image)
    writer.release()
    settings = ZedSettings(camera="front", device=str(path), calibration=Path("SN2.conf"))
    return ZedSource(settings, calibration=CALIBRATION), lambda: None


def v4l2(folder: Path) -> Camera:
    """A pipe that is readable while buffers wait."""
    stream, filled = FakeStream(), iter(range(FRAMES))
    return V4l2Source(SETTINGS, stream), lambda: stream.fill(buffer(next(filled)))


def simulated(folder: Path) -> Camera:
    """The simulated camera, with a cable that is pulled after the frames."""
    flight = LoopingFlight(flight_plan("street"))
    flight.leg_ns = 500_000_000
    (folder / "cable").touch()
    simulation = Simulation(fps=10.0, cable=folder / "cable", folder=folder / "frames")
    info = camera_info(64, 48, camera="front")
    source = SimulatedDepthSource(flight, info, simulation, time.monotonic_ns, time.sleep)
    return source, at_the_end((folder / "cable").unlink)


@pytest.mark.parametrize("make", [oak, zed, v4l2, simulated])
def test_a_camera(make: Callable[[Path], Camera], tmp_path: Path) -> None:
    source, more = make(tmp_path)
    with pytest.raises(DeviceNotFound, match="call open"):
        source.read(0.1)
    source.open()
    try:
        k = source.info.intrinsics
        assert source.info.camera == "front"
        assert 0.0 < source.info.min_range_m < source.info.max_range_m
        frames = []
        for _ in range(2):
            more()
            frames.append(source.read(60.0))
        for frame in frames:
            assert isinstance(frame, DepthFrame)
            assert frame.camera == "front"
            assert frame.depth_mm.shape == (k.height, k.width)
            assert not frame.depth_mm.flags.writeable
            assert 0 < frame.t_exposure_ns <= frame.t_arrival_ns <= time.monotonic_ns()
        first, second = frames
        assert first.sequence < second.sequence
        assert first.t_exposure_ns < second.t_exposure_ns
        assert first.depth_mm is not second.depth_mm
        assert ended(source, more)
    finally:
        source.close()
        source.close()
    with pytest.raises(DeviceNotFound, match="call open"):
        source.read(0.1)


def ended(source: DepthSource, more: Callable[[], None]) -> bool:
    """Whether a device that delivers no more is reported after its last frame: as silent or as lost, never by an old frame."""
    for _ in range(FRAMES - 2):
        more()
    newest_ns = 0
    for _ in range(FRAMES + 1):
        try:
            frame = source.read(0.3)
        except DeviceLost:
            return True
        if frame is None:
            return True
        assert frame.t_exposure_ns > newest_ns
        newest_ns = frame.t_exposure_ns
    return False


def flown() -> SimulatedFlight:
    return SimulatedFlight("street", width=64, height=48, duration_s=0.4)


def recorded(folder: Path) -> McapRecording:
    write_recording(flown(), folder / "flight.mcap", pb.RunInfo())
    return McapRecording(folder / "flight.mcap")


@pytest.mark.parametrize("make", [lambda folder: flown(), recorded])
def test_a_recording(make: Callable[[Path], EventSource], tmp_path: Path) -> None:
    source = make(tmp_path)
    names = {info.camera: info.intrinsics for info in source.cameras}
    events = list(source.events())
    arrivals = [event.t_arrival_ns for event in events]
    assert arrivals == sorted(arrivals)
    frames = [event for event in events if isinstance(event, DepthFrame)]
    assert len(frames) > 3
    assert {type(event).__name__ for event in events} == {"DepthFrame", "AttitudeSample", "PoseSample"}
    for frame in frames:
        assert frame.depth_mm.shape == (names[frame.camera].height, names[frame.camera].width)
        assert frame.t_exposure_ns <= frame.t_arrival_ns
    assert [event.t_arrival_ns for event in source.events()] == arrivals  # it can be read again
