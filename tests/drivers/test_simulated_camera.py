"""The endless flight, the simulated camera on it, and the file of its rendered frames."""

from __future__ import annotations

import dataclasses
import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from core.frames import R_CAMFRD_OPTICAL
from core.types import CameraInfo
from drivers.base import DeviceLost, DeviceNotFound
from drivers.simulation import camera as simulated_camera
from drivers.simulation import frame_store
from drivers.simulation.camera import SimulatedDepthSource, Simulation
from drivers.simulation.flight import SimulatedFlight
from drivers.simulation.flights import FLIGHTS, flight_plan
from drivers.simulation.frame_store import FrameStore
from drivers.simulation.looping_flight import NS, LoopingFlight
from drivers.simulation.source import camera_info, look

INFO = camera_info(64, 48)


class Clock:
    """A clock that only `wait` moves."""

    def __init__(self, now_ns: int = 77_123_456_789) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)


def short(name: str = "street", seconds: float = 1.0) -> LoopingFlight:
    """A flight whose leg ends early: quick to render."""
    flight = LoopingFlight(flight_plan(name))
    flight.leg_ns = round(seconds * NS)
    return flight


def camera(
    clock: Clock, flight: LoopingFlight | None = None, info: CameraInfo = INFO, **how: object
) -> SimulatedDepthSource:
    simulation = dataclasses.replace(Simulation(fps=10.0), **how)
    return SimulatedDepthSource(flight or short(), info, simulation, clock, clock.wait)


@pytest.mark.parametrize("render", ["depth", "stereo"])
def test_only_rendered_stereo_marks(render: str) -> None:
    assert not camera(Clock(), render=render).info.marks_smooth
    marked = camera(Clock(), info=dataclasses.replace(INFO, marks_smooth=True), render=render, mark_smooth=True)
    assert marked.info.marks_smooth is (render == "stereo")


# ---- the flight -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(FLIGHTS))
def test_a_flight_there_and_back_never_jumps(name: str) -> None:
    """Over both ends, in steps of 10 ms: no faster than 6 m/s and 4 rad/s anywhere."""
    flight = LoopingFlight(flight_plan(name))
    for end_ns in (flight.leg_ns, 2 * flight.leg_ns, 7 * flight.leg_ns):
        states = [flight.state(end_ns + k * NS // 100) for k in range(-30, 31)]
        for a, b in pairwise(states):
            assert np.linalg.norm(np.subtract(b.position_ned_m, a.position_ned_m)) < 0.06
            assert np.abs(np.subtract(b.euler_rad, a.euler_rad)).max() < 0.04


@pytest.mark.parametrize("at_s", [3.3, 13.7, 1_000_017.2])
def test_rates_and_velocities_are_those_of_the_motion_both_ways(at_s: float) -> None:
    flight, h_ns = LoopingFlight(flight_plan("demo")), 100_000
    t_ns = round(at_s * NS)
    before, now, after = (flight.state(t_ns + k * h_ns) for k in (-1, 0, 1))
    W = now.R_ned_frd.T @ (after.R_ned_frd - before.R_ned_frd) / (2e-9 * h_ns)
    np.testing.assert_allclose((W[2, 1], W[0, 2], W[1, 0]), now.rates_frd_rad_s, atol=1e-4)
    v = np.subtract(after.position_ned_m, before.position_ned_m) / (2e-9 * h_ns)
    np.testing.assert_allclose(v, now.velocity_ned_m_s, atol=1e-4)


def test_the_way_back_is_the_way_there() -> None:
    flight = LoopingFlight(flight_plan("demo"))
    assert flight.state(12 * NS).position_ned_m == flight.state(8 * NS).position_ned_m
    assert flight.on_path(20 * NS) == (0, False)
    assert flight.on_path(10 * NS) == (10 * NS, False)
    assert flight.on_path(11 * NS) == (9 * NS, True)


def test_no_attitude_is_sent_in_the_spans_of_the_plan() -> None:
    flight = LoopingFlight(flight_plan("broken"))
    hidden = [flight.hides_attitude(round(s * NS)) for s in (3.5, 3.7, 4.5, 4.7, 7.3, 7.5, 8.3, 8.5)]
    assert hidden == [False, True, True, False, False, True, True, False]


# ---- the camera -------------------------------------------------------------------------------------------------------


def test_a_frame_that_was_fetched_before_it_arrived_is_that_of_its_exposure() -> None:
    """Beside a camera that fetches at once; also after a frame was not fetched in time, and after it was closed and opened."""
    clock = Clock()
    source = camera(clock)
    plain = SimulatedDepthSource(short(), INFO, Simulation(fps=10.0), clock)
    source.open()
    plain.open()
    kept = []
    for k, wait_s in enumerate((0.0, 0.0, 0.25, 0.0, 0.03, 0.0, 0.31, 0.0)):
        clock.wait(wait_s)
        if k == 4:
            source.close()
            source.open()
        frame = source.read(0.02) or source.read(0.2)
        same = plain.read(0.0)
        assert frame is not None
        assert same is not None
        assert frame.sequence == same.sequence
        np.testing.assert_array_equal(frame.depth_mm, same.depth_mm)
        kept.append((frame, same))
    for frame, same in kept:  # what was handed out is not written over
        np.testing.assert_array_equal(frame.depth_mm, same.depth_mm)


def test_the_next_frame_is_fetched_before_its_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, get = Clock(), FrameStore.get
    fetched_ns: list[int] = []

    def timed(self: FrameStore, i: int) -> np.ndarray | None:
        fetched_ns.append(clock.now_ns)
        return get(self, i)

    source = camera(clock)
    source.open()
    monkeypatch.setattr(FrameStore, "get", timed)
    for k in range(5):
        frame = source.read(0.2)
        assert frame is not None
        assert len(fetched_ns) == k + 1
        assert fetched_ns[-1] == frame.t_exposure_ns - simulated_camera.AHEAD_NS
        assert frame.t_arrival_ns == frame.t_exposure_ns


def test_a_frame_shows_what_is_seen_at_its_exposure_also_on_the_way_back() -> None:
    clock, flight = Clock(), LoopingFlight(flight_plan("street"))
    source = camera(clock, flight)
    source.open()
    seen: set[bool] = set()
    while len(seen) < 2:
        frame = source.read(1.0)
        assert frame is not None
        clock.wait(0.71)
        seen.add(flight.on_path(frame.t_exposure_ns)[1])
        state = flight.state(frame.t_exposure_ns)
        truth = look(flight.plan.scene, INFO, state.R_ned_frd @ R_CAMFRD_OPTICAL, np.array(state.position_ned_m))
        both = (truth.depth_m < INFO.max_range_m) & (frame.depth_mm > 0)
        assert both.mean() > 0.3
        exact_mm = 1000.0 * truth.depth_m[both]
        assert np.median(np.abs(exact_mm - frame.depth_mm[both]) / exact_mm) < 0.02


def test_frames_come_once_newest_first_and_on_one_grid() -> None:
    clock = Clock()
    with camera(clock, latency_s=0.02) as source:
        frames = [source.read(1.0) for _ in range(25)]
        stamps = [f.t_exposure_ns for f in frames if f is not None]
        assert [b - a for a, b in pairwise(stamps)] == [NS // 10] * 24
        assert all(f is not None and 0 <= f.t_arrival_ns - f.t_exposure_ns - 20_000_000 < 1000 for f in frames)
        assert source.read(0.0) is None
        clock.wait(0.35)
        newest = source.read(0.0)
        assert newest is not None
        assert newest.t_exposure_ns == stamps[-1] + 3 * NS // 10
        assert newest.sequence == stamps[-1] // (NS // 10) + 3


def test_a_lap_has_no_gap_and_the_next_one_shows_the_same() -> None:
    clock = Clock()
    with camera(clock) as source:
        frames = [source.read(1.0) for _ in range(45)]
    images = [f.depth_mm for f in frames if f is not None]
    assert len(images) == 45
    for before, after in zip(images[:20], images[20:40], strict=True):
        assert np.count_nonzero(before != after) <= 2  # the pixels that tell the legs apart


def test_no_image_is_delivered_twice() -> None:
    """Of a live camera, two equal images are a fault. Each leg delivers the rendered images of the one before."""
    clock = Clock()
    source = camera(clock, short(seconds=0.5))
    source.open()
    images = []
    while len(images) < 40:  # eight legs
        frame = source.read(1.0)
        assert frame is not None
        images.append(frame.depth_mm.tobytes())
    assert len(set(images)) == len(images)


def test_a_camera_that_is_opened_again_goes_on_in_the_same_flight() -> None:
    clock = Clock()
    first, second = camera(clock), camera(clock)
    first.open()
    second.open()
    a, b = first.read(1.0), second.read(0.0)
    assert a is not None
    assert b is not None
    assert (a.sequence, a.t_exposure_ns) == (b.sequence, b.t_exposure_ns)
    np.testing.assert_array_equal(a.depth_mm, b.depth_mm)


def test_what_fails_in_the_plan_fails_each_time(tmp_path: Path) -> None:
    clock = Clock(0)
    with camera(clock, LoopingFlight(flight_plan("broken"))) as source:
        frames = [source.read(0.11) for _ in range(121)]
    missing = {f"{k}" for k in range(50, 54)} | {f"{120 - k}" for k in range(50, 54)}
    there = {str(f.sequence) for f in frames if f is not None}
    assert not there & missing
    blind = [f.sequence for f in frames if f is not None and not f.depth_mm.any()]
    assert blind == [*range(10, 18), *range(103, 111)]


def test_the_cable_is_a_file(tmp_path: Path) -> None:
    cable = tmp_path / "cable"
    source = camera(Clock(), cable=cable)
    with pytest.raises(DeviceNotFound, match="unplugged"):
        source.open()
    cable.touch()
    source.open()
    assert source.read(1.0) is not None
    cable.unlink()
    with pytest.raises(DeviceLost, match=r"unplugged, since .*cable does not exist; make the file to plug it in"):
        source.read(1.0)
    source.close()
    source.close()
    with pytest.raises(DeviceNotFound, match="open"):
        source.read(0.0)


def test_each_frame_is_rendered_once_also_over_restarts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered: list[int] = []
    render = SimulatedFlight.frame

    def counted(self: SimulatedFlight, index: int, camera_number: int = 0) -> object:
        rendered.append(index)
        return render(self, index, camera_number)

    monkeypatch.setattr(SimulatedFlight, "frame", counted)
    for _ in range(2):
        with camera(Clock(), folder=tmp_path) as source:
            kept = source.read(1.0)
    assert rendered == list(range(11))
    with camera(Clock()) as source:
        fresh = source.read(1.0)
    assert kept is not None
    assert fresh is not None
    np.testing.assert_array_equal(kept.depth_mm, fresh.depth_mm)
    with camera(Clock(), folder=tmp_path, seed=1) as source:
        assert len(rendered) == 33
    assert len(list(tmp_path.iterdir())) == 2


def test_all_can_be_rendered_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shares: list[float] = []
    camera(Clock(), folder=tmp_path).render_all(shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    monkeypatch.setattr(SimulatedFlight, "frame", lambda *_: pytest.fail("a frame was rendered again"))
    with camera(Clock(), folder=tmp_path) as source:
        assert source.read(1.0) is not None


def test_opening_ends_although_not_all_is_rendered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    render = SimulatedFlight.frame

    def slow(self: SimulatedFlight, index: int, camera_number: int = 0) -> object:
        clock.wait(6.0)
        return render(self, index, camera_number)

    monkeypatch.setattr(SimulatedFlight, "frame", slow)
    with camera(clock, folder=tmp_path) as source:
        (file,) = tmp_path.iterdir()
        assert simulated_camera.RENDER_S == 20.0
        marks = np.fromfile(file, np.uint64, 11)
        assert np.count_nonzero(marks) == 4
        assert source.read(1.0) is not None


# ---- the file ---------------------------------------------------------------------------------------------------------


def image(k: int) -> np.ndarray:
    return np.full((6, 8), k, np.uint16)


def test_a_store_gives_back_what_was_put(tmp_path: Path) -> None:
    for folder in (tmp_path, None):
        store = FrameStore(folder, "a", 5, 6, 8)
        store.put(0, image(7))
        store.put(3, None)
        assert [store.holds(i) for i in range(5)] == [True, False, False, True, False]
        first = store.get(0)
        assert first is not None
        np.testing.assert_array_equal(first, image(7))
        assert not first.flags.writeable
        assert store.get(3) is None
        with pytest.raises(KeyError):
            store.get(1)
    again = FrameStore(tmp_path, "a", 5, 6, 8)
    assert [again.holds(i) for i in range(5)] == [True, False, False, True, False]


def test_a_damaged_frame_is_not_there(tmp_path: Path) -> None:
    store = FrameStore(tmp_path, "a", 3, 6, 8)
    for i in range(3):
        store.put(i, image(i))
    (file,) = tmp_path.iterdir()
    data = bytearray(file.read_bytes())
    data[4096 + 96 + 5] ^= 1
    file.write_bytes(data)
    again = FrameStore(tmp_path, "a", 3, 6, 8)
    assert [again.holds(i) for i in range(3)] == [True, False, True]


def test_where_nothing_can_be_written_frames_are_held_in_memory(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = FrameStore(tmp_path / "file" / "folder", "a", 3, 6, 8)
    assert not store.kept
    store.put(1, image(1))
    assert store.holds(1)


def test_room_is_bounded_and_the_oldest_files_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"1000 frames of 1280x960 pixels take 2458 MB, more than 1000; .*width_px"):
        FrameStore(tmp_path, "a", 1000, 960, 1280)
    one = 4096 + 2 * 3 * 6 * 8
    monkeypatch.setattr(frame_store, "MOST_BYTES", 2 * one)
    held = FrameStore(tmp_path, "a", 3, 6, 8)
    held.put(0, image(0))
    os.utime(next(tmp_path.iterdir()), (0, 0))
    for name in ("b", "c"):
        FrameStore(tmp_path, name, 3, 6, 8)
    assert sorted(f.stem for f in tmp_path.iterdir()) == ["b", "c"]
    assert held.get(0) is not None
