"""Rendered flights with a wrong mount: named, and nothing called free that is not; with the right one: no alarm."""

from __future__ import annotations

import math

import pytest

from benchmarks.scenes.catalogue import camera_pose, make_scene
from benchmarks.self_check.mount_check import HEIGHT_M, SETTLED, slope_scene
from benchmarks.self_check.mount_flights import Errors, MountFlight, hover, turning
from core.self_check.mount_check import MountVerdict
from core.types import CameraMount

WIDTH = 160
REPORTED = (MountVerdict.DEGRADED, MountVerdict.ERROR)


@pytest.mark.parametrize("scene", ["street", "trees"])
@pytest.mark.parametrize(
    "errors",
    [
        Errors(pitch_deg=-5.0),
        Errors(pitch_deg=5.0),
        Errors(pitch_deg=-10.0),
        Errors(roll_deg=10.0),
        Errors(roll_deg=-5.0),
    ],
    ids=str,
)
def test_after_ten_frames_nothing_is_called_free_that_is_not(scene: str, errors: Errors) -> None:
    position, yaw = camera_pose(scene, 1, HEIGHT_M)
    flight = MountFlight(make_scene(scene, 1), errors, width=WIDTH, seed=1)
    late = flight.fly(hover(position, yaw, SETTLED + 4))[SETTLED:]
    assert not [f for f in late if f.valid and f.false_free > 0.0]
    assert all("mount" in f.cause for f in late if not f.valid)


def test_a_sign_fault_of_the_mount_is_named_with_its_size() -> None:
    """The camera looks down by 5 degrees and is configured to look up by 5."""
    position, yaw = camera_pose("street", 1, HEIGHT_M)
    true = CameraMount(pitch_rad=math.radians(-5.0))
    flight = MountFlight(make_scene("street", 1), Errors(pitch_deg=10.0), width=WIDTH, true=true, seed=1)
    frames = flight.fly(turning(position, yaw, seconds=6.0), judge=False)
    assert frames[-1].verdict is MountVerdict.ERROR
    assert not frames[-1].valid
    assert frames[-1].error_deg == pytest.approx((0.0, -10.0), abs=0.5)


@pytest.mark.parametrize(
    "errors",
    [
        Errors(pitch_deg=-1.5),
        *(pytest.param(e, marks=pytest.mark.slow) for e in (Errors(roll_deg=2.0), Errors(pitch_deg=3.0))),
    ],
    ids=str,
)
def test_small_errors_are_named_in_ten_seconds_of_turning_flight(errors: Errors) -> None:
    position, yaw = camera_pose("trees", 1, HEIGHT_M)
    flight = MountFlight(make_scene("trees", 1), errors, width=WIDTH, seed=1)
    frames = flight.fly(turning(position, yaw), judge=False)
    assert any(f.verdict in REPORTED for f in frames)
    assert frames[-1].error_deg == pytest.approx((-errors.roll_deg, -errors.pitch_deg), abs=0.5)


OTHERS = [pytest.param(name, marks=pytest.mark.slow) for name in ("gable", "cylinder_trapezoid_sphere", "gorge")]


@pytest.mark.parametrize("scene", ["street", "trees", "ramp", *OTHERS])
def test_the_right_mount_is_left_alone(scene: str) -> None:
    position, yaw = camera_pose(scene, 1, HEIGHT_M)
    for poses in (hover(position, yaw, 8), turning(position, yaw, seconds=8.0, hz=3.0)):
        flight = MountFlight(make_scene(scene, 1), Errors(), width=WIDTH, seed=1, frame_hz=3.0)
        frames = flight.fly(poses, judge=False)
        assert not [f for f in frames if f.verdict.invalid or f.verdict in REPORTED]


@pytest.mark.parametrize("slope_deg", [-10.0, *(pytest.param(deg, marks=pytest.mark.slow) for deg in (10.0, 5.0))])
def test_true_slopes_are_no_mount_errors(slope_deg: float) -> None:
    """With houses never; in the open frames may be invalid until the vehicle has turned."""
    rise = math.tan(math.radians(slope_deg))
    poses = turning((0.0, 0.0, -HEIGHT_M), 0.0, hz=5.0, ground=lambda x, y: rise * x)
    for houses in (True, False):
        flight = MountFlight(slope_scene(slope_deg, 0.0, houses), Errors(), width=WIDTH, frame_hz=5.0)
        frames = flight.fly(poses, judge=False)
        assert not [f for f in frames if f.verdict in REPORTED]
        assert not frames[-1].verdict.invalid
