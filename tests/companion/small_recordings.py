"""Small recordings for tests: a wall that comes nearer, an attitude that turns, and an extractor that is easy to foresee."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from core.frames import quaternion_from_euler
from core.types import (
    AttitudeSample,
    CameraInfo,
    CameraMount,
    DepthFrame,
    ExtractorState,
    FrameModel,
    FrameStats,
    FreeProfile,
    Ground,
    Intrinsics,
    InvalidCause,
    PoseSample,
    Prism,
)
from drivers.base import Event

MS = 1_000_000
START_NS = 5_000 * MS

INFO = CameraInfo(
    "front",
    Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5),
    CameraMount(roll_rad=0.02, pitch_rad=-0.1, yaw_rad=0.3, x_m=0.2, y_m=-0.05, z_m=0.1),
    ke_per_m=0.003,
)


class Events:
    """An EventSource of a list."""

    def __init__(self, events: Iterable[Event], cameras: tuple[CameraInfo, ...] = (INFO,)) -> None:
        self._events = list(events)
        self.cameras = cameras

    def events(self) -> Iterator[Event]:
        yield from self._events

    def close(self) -> None:
        pass


def depth_image(sequence: int) -> np.ndarray:
    """(48, 64) uint16 mm: a wall 6 m away that comes 0.1 m nearer a frame, noisy, with a hole and far pixels."""
    rng = np.random.default_rng(sequence)
    depth = (6000 - 100 * sequence + rng.normal(0.0, 10.0, (48, 64))).astype(np.uint16)
    depth[10:14, 20:26] = 0
    depth[:3] = 65534
    return depth


def frame(sequence: int, t_ns: int, arrival_ns: int | None = None, camera: str = "front") -> DepthFrame:
    return DepthFrame(
        camera=camera,
        sequence=sequence,
        t_exposure_ns=t_ns,
        t_arrival_ns=t_ns + 40 * MS if arrival_ns is None else arrival_ns,
        depth_mm=depth_image(sequence),
    )


def attitude(t_ns: int, rate_rad_s: float = 0.4, rates: bool = True) -> AttitudeSample:
    """A steady turn about the vertical at a small pitch."""
    yaw = rate_rad_s * (t_ns - START_NS) * 1e-9
    q = quaternion_from_euler(0.0, 0.05, yaw)
    s, c = math.sin(0.05), math.cos(0.05)
    return AttitudeSample(t_ns, t_ns + 5 * MS, q, (-s * rate_rad_s, 0.0, c * rate_rad_s) if rates else None)


def pose(t_ns: int) -> PoseSample:
    dt_s = (t_ns - START_NS) * 1e-9
    return PoseSample(t_ns, t_ns + 10 * MS, (1.0 + 2.0 * dt_s, -3.0, -4.0), (2.0, 0.0, 0.0), 1)


def flight(frames: int = 10, poses: bool = True) -> list[Event]:
    """Frames at 10 Hz between attitudes at 50 Hz and positions at 30 Hz, in the order of arrival."""
    end_ns = START_NS + frames * 100 * MS
    events: list[Event] = [attitude(t) for t in range(START_NS - 40 * MS, end_ns, 20 * MS)]
    events += [frame(i, START_NS + i * 100 * MS + 7 * MS) for i in range(frames)]
    if poses:
        events += [pose(t) for t in range(START_NS - 30 * MS, end_ns, 33 * MS)]
    return sorted(events, key=lambda e: e.t_arrival_ns)


def write_flight(path: Path, events: Iterable[Event] | None = None) -> Path:
    """A log, also without frames."""
    listed = flight() if events is None else list(events)
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (INFO,), t_ns=listed[0].t_arrival_ns if listed else 0)
        for event in listed:
            log.event(event)
    return path


class EasyExtractor:
    """One plane across the view at the median depth; the ground of the state sinks by 1 m a frame. No pixel measured:
    it says nothing."""

    def __init__(self, info: CameraInfo) -> None:
        self.info = info

    def extract(
        self,
        depth: np.ndarray,
        info: CameraInfo,
        R_level_optical: np.ndarray,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        state = state or ExtractorState()
        measured = depth[(depth > 0) & (depth < 65534)]
        if not len(measured):
            return easy_model(1.0, 0.0, valid=False), state
        before = 0.0 if math.isnan(state.ground_height_m) else state.ground_height_m
        after = ExtractorState(before + 1.0, 0.25 * float(R_level_optical[0, 2]))
        return easy_model(float(np.median(measured)) / 1000.0, before), after


def easy_model(x_m: float, ground_m: float, valid: bool = True) -> FrameModel:
    n = 2 if valid else 0
    planes = np.array([[x_m, -1, x_m, 2, -1.5, 0.5], [x_m, 2, x_m + 1, 3, -0.5, 0.5]], np.float32)[:n]
    prism = Prism(
        cluster=3,
        top_m=-1.5,
        bottom_m=0.5,
        closed=False,
        margin_m=0.125,
        vertices_m=np.array([[x_m, -1], [x_m, 2], [x_m + 1, 3]], np.float32),
        plane=np.array([0, 1], np.int32),
    )
    return FrameModel(
        valid=valid,
        cause=InvalidCause.NONE if valid else InvalidCause.NO_MEASUREMENT,
        planes=planes,
        support_px=np.array([700, 9], np.int32)[:n],
        margin_m=np.array([0.1, 0.2], np.float32)[:n],
        flags=np.array([64, 3], np.uint8)[:n],
        cluster=np.array([3, -1], np.int32)[:n],
        prisms=(prism,) if valid else (),
        free=FreeProfile(
            azimuth_edges_rad=np.array([-0.5, 0.0, 0.5], np.float32),
            layer_edges_m=np.array([-2, -1, 0, 1], np.float32),
            free_from_m=np.zeros((2, 3), np.float32),
            free_to_m=np.full((2, 3), x_m if valid else 0.0, np.float32),
            end=np.array([[0, 1, 2], [3, 4, 0]], np.uint8),
        ),
        ground=Ground(
            seen=valid,
            height_m=ground_m,
            slope_x=0.01,
            slope_y=-0.02,
            share=0.25,
            blind_beyond_m=9.0,
            tolerance_m=0.25,
            noise_per_m=0.0625,
            seen_from_m=(1.5, 0.0),
            seen_to_m=(6.0, 0.0),
        ),
        stats=FrameStats(measured_share=0.9, unknown_share=0.1, strips=12, planes=n, prisms=n // 2),
        ke_per_m=0.004,
    )
