"""Real and photoreal recordings, the whole way: the floor is floor, and what stands on it is seen.

What each asserts was measured with some room to spare; the figures of the day are in the messages of the assertions.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.cli import main
from companion.pipeline.encode import prisms_from_message
from companion.pipeline.results import PrismsResult
from core.frames import R_CAMFRD_OPTICAL, rotation_from_quaternion
from core.types import FAR_MM, CameraInfo, DepthFrame, FrameModel
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb

CHECKOUT = Path(__file__).resolve().parent.parent.parent.parent
NEAR_M = 4.0
LOW_M = 0.1
"""A plane whose top is lower than this above the floor is the floor taken for an obstacle."""
COUNTS = {"rs_d435_handheld": 100, "o3d_livingroom_sim": 5, "cape_tunnel": 1}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """A frame with what was made of it; floor_m: measured height of the camera above the floor."""

    depth: DepthFrame
    result: PrismsResult
    floor_m: float

    @property
    def model(self) -> FrameModel:
        assert self.result.model is not None
        return self.result.model

    def planes(self) -> Floats:
        """(N, 6) about the camera: a, b horizontally, then top and bottom ABOVE the floor."""
        assert self.result.transform is not None
        x, y, z = self.result.transform.translation_m
        p = self.model.planes.astype(np.float64) - np.array([x, y, x, y, z, z])
        p[:, 4:6] = self.floor_m - p[:, 4:6]
        return p

    def points(self, info: CameraInfo) -> Floats:
        """(M, 3) every second measured pixel about the camera: horizontally as the planes, height above the floor."""
        assert self.result.attitude is not None
        k, depth = info.intrinsics, self.depth.depth_mm[::2, ::2] / 1000.0
        v, u = np.mgrid[0 : k.height : 2, 0 : k.width : 2]
        good = (depth > info.min_range_m) & (depth < info.max_range_m)
        rays = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(u.shape)], axis=-1)[good]
        R = rotation_from_quaternion(self.result.attitude.q_ned_frd_wxyz) @ R_CAMFRD_OPTICAL
        ned = (rays * depth[good][:, None]) @ R.T
        ned[:, 2] = self.floor_m - ned[:, 2]
        return ned


@dataclass(frozen=True)
class Replayed:
    """A recording after import and replay by the commands. used: decisions that say so; offset: of the exposures, in the report."""

    info: CameraInfo
    used: int
    frames: list[Frame]
    offset: dict[str, Any]


@pytest.fixture(scope="session", params=COUNTS)
def replayed(
    request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Replayed]:
    name = str(request.param)
    folder = tmp_path_factory.mktemp(name)
    config = CHECKOUT / "configs" / ("default.toml" if name == "cape_tunnel" else "indoor.toml")
    recording, log = folder / "in.mcap", folder / "out.mcap"
    assert main(["import", str(shared_data / name), "-o", str(recording), "-c", str(config), "--no-tlog"]) == 0
    with contextlib.redirect_stdout(io.StringIO()) as report:
        assert main(["replay", str(recording), "-o", str(log), "--json"]) == 0
    (offset,) = json.loads(report.getvalue())["exposure_offsets"]
    with (shared_data / name / "frames.csv").open() as file:
        floors = [float(row["ground_height_m"]) for row in csv.DictReader(file)]
    with McapRecording(log) as source:
        (info,) = source.cameras
        depths = [event for event in source.events() if isinstance(event, DepthFrame)]
        logged = [item.message for item in source.messages("prisms", "decision")]
    result = [prisms_from_message(m) for m in logged if isinstance(m, pb.PrismsFrame)]
    used = sum(m.used for m in logged if isinstance(m, pb.FrameDecision))
    frames = [Frame(*three) for three in zip(depths, result, floors, strict=True)]
    return name, Replayed(info, used, frames, offset)


def test_the_right_mount_is_left_alone(replayed: tuple[str, Replayed]) -> None:
    """The check of the mount makes no frame invalid."""
    name, recording = replayed
    assert [frame.result.cause_text for frame in recording.frames] == [""] * COUNTS[name]


def test_every_frame_is_used_and_gives_a_result(replayed: tuple[str, Replayed]) -> None:
    name, got = replayed
    assert len(got.frames) == got.used == COUNTS[name]
    assert all(frame.result.valid for frame in got.frames)
    assert all(frame.depth.depth_mm.max() < FAR_MM for frame in got.frames), "no file has far pixels"


def test_the_offset_of_the_exposures_is_not_reported(replayed: tuple[str, Replayed]) -> None:
    """The attitude is derived from the images: the offset is 0."""
    _, got = replayed
    assert got.offset["warning"] == ""
    if got.offset["offset_ms"] is not None:
        assert abs(got.offset["offset_ms"]) < 3.0


def test_the_floor_lies_where_it_was_measured(replayed: tuple[str, Replayed]) -> None:
    _, got = replayed
    assert all(frame.model.ground.seen for frame in got.frames)
    errors_m = [abs(frame.model.ground.height_m - frame.floor_m) for frame in got.frames]
    assert max(errors_m) < 0.03, "measured: 12 mm at most (D435), under 1 mm (simulated room), 10 mm (tunnel)"


def is_floor(plane: Floats, points: Floats) -> bool:
    """True if nothing that is higher than the floor was measured within 0.1 m of the middle of a plane."""
    middle = 0.5 * (plane[0:2] + plane[2:4])
    near = np.hypot(*(points[:, 0:2] - middle).T) < 0.1
    return not np.any(points[near, 2] > LOW_M)


def test_the_floor_is_no_obstacle(replayed: tuple[str, Replayed]) -> None:
    """No plane near is as low as the floor, except short ones at the lower end of what stands there."""
    name, got = replayed
    clean, low_m, all_m = 0, 0.0, 0.0
    for frame in got.frames:
        planes = frame.planes()
        near = nearest_m(planes) < NEAR_M
        low = near & (planes[:, 4] < LOW_M)
        length_m = np.hypot(planes[:, 2] - planes[:, 0], planes[:, 3] - planes[:, 1])
        clean += not any(is_floor(plane, frame.points(got.info)) for plane in planes[low])
        low_m += float(length_m[low].sum())
        all_m += float(length_m[near].sum())
    share = clean / len(got.frames)
    assert share >= 0.9, f"{name}: the floor is clean in {share:.2f} of the frames; measured: 0.97 (D435), 1 (others)"
    assert low_m <= 0.005 * all_m, f"{name}: {low_m:.2f} of {all_m:.1f} m of planes; measured: 0.001"


def test_what_stands_on_the_floor_is_seen(replayed: tuple[str, Replayed]) -> None:
    """In every direction in which many pixels lie well above the floor, a plane stands no farther than they do."""
    name, got = replayed
    seen = wanted = 0
    for frame in got.frames:
        azimuth_rad, range_m = obstacles(frame.points(got.info))
        planes = frame.planes()
        reach_m = range_m + 0.1 + 0.05 * range_m
        seen += int(np.count_nonzero(first_plane_m(planes, azimuth_rad) <= reach_m))
        wanted += len(azimuth_rad)
        assert np.any((nearest_m(planes) < NEAR_M) & (planes[:, 4] > 0.3)), frame.result.sequence
    assert wanted > 30 * len(got.frames)
    share = seen / max(wanted, 1)
    assert share >= 0.97, f"{name}: seen in {share:.3f} of {wanted} directions; measured: 0.987 (D435), 0.99 (room), 1"


def nearest_m(planes: Floats) -> Floats:
    """(N,) horizontal distance from the camera to each plane."""
    a, edge = planes[:, 0:2], planes[:, 2:4] - planes[:, 0:2]
    t = np.clip(-(a * edge).sum(axis=1) / np.maximum((edge * edge).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(a + t[:, None] * edge, axis=1))


def obstacles(points: Floats, pixels: int = 40) -> tuple[Floats, Floats]:
    """Directions of one degree with many pixels 0.3..1.2 m above the floor and near: (azimuth, range) of the `pixels`-th
    nearest of them."""
    range_m = np.hypot(points[:, 0], points[:, 1])
    chosen = (points[:, 2] > 0.3) & (points[:, 2] < 1.2) & (range_m < NEAR_M)
    azimuth_deg = np.floor(np.degrees(np.arctan2(points[chosen, 1], points[chosen, 0]))).astype(int)
    found = []
    for degree in np.unique(azimuth_deg):
        ranges = np.sort(range_m[chosen][azimuth_deg == degree])
        if len(ranges) >= pixels:
            found.append((np.radians(degree + 0.5), ranges[pixels - 1]))
    table = np.array(found).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def first_plane_m(planes: Floats, azimuth_rad: Floats) -> Floats:
    """(A,) horizontal range at which a ray from the camera meets the first plane; inf: none."""
    direction = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], axis=-1)[:, None, :]
    a, edge = planes[None, :, 0:2], (planes[:, 2:4] - planes[:, 0:2])[None]
    cross = direction[..., 0] * edge[..., 1] - direction[..., 1] * edge[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[..., 0] * edge[..., 1] - a[..., 1] * edge[..., 0]) / cross
        s = (a[..., 0] * direction[..., 1] - a[..., 1] * direction[..., 0]) / cross
    meets = (np.abs(cross) > 1e-12) & (t > 0.0) & (s >= 0.0) & (s <= 1.0)
    return np.asarray(np.where(meets, t, np.inf).min(axis=1, initial=np.inf))
