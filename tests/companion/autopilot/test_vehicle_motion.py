"""The motion of the vehicle, by which the obstacle output moves what it remembers."""

from __future__ import annotations

import math

import pytest

from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.surroundings import Surroundings
from companion.autopilot.vehicle_motion import VehicleMotion
from companion.config.guard import GuardParams
from companion.config.sync import SyncParams
from companion.guard.assessment import PathAssessor
from companion.guard.braking import braking_of
from companion.guard.path_sight import path_sight
from companion.guard.velocity_hold import VelocityHold
from companion.pipeline.pipeline import Pipeline
from core.types import AttitudeSample, PoseSample

from ..report_chain import AVOID, CAMERA, Chain
from ..sector_models import model, wall_at

MS = 1_000_000


def test_the_distance_flown_is_known_in_fast_flight_without_timesync() -> None:
    """A constant error of the timestamps does not change it. Without a position remembered obstacles would stay behind."""
    motion = VehicleMotion()
    places = []
    for k in range(10):
        t_ns = 1000 * MS + 100 * k * MS
        north_m = 15.0 * 0.1 * k
        motion.samples(
            [
                AttitudeSample(t_ns, t_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 30 * MS),
                PoseSample(t_ns, t_ns, (north_m, 0.0, -5.0), (15.0, 0.0, 0.0), stamp_error_ns=30 * MS),
            ]
        )
        here = motion.catch_up(t_ns)
        assert here is not None
        assert here.position_ned_m is not None
        places.append(here.position_ned_m[0])
    assert abs(places[-1] - places[0] - 13.5) < 1e-6


def test_a_late_copy_does_not_bring_an_earlier_velocity_back() -> None:
    """A router, or another route of UDP, delivers a position of 0.4 s ago: the vehicle has gained 2 m/s since."""
    motion = VehicleMotion()
    for t_ms, north_m_s in ((1000, 1.0), (1400, 3.0), (1000, 1.0), (1010, 1.0)):
        motion.samples([PoseSample(t_ms * MS, 1400 * MS, (0.0, 0.0, -5.0), (north_m_s, 0.0, 0.0))])
        motion.catch_up(1400 * MS)
    assert motion.velocity_ned_m_s(1410 * MS) == (3.0, 0.0, 0.0)
    assert motion.newest_pose is not None
    assert motion.newest_pose.t_ns == 1400 * MS
    # stamps that step back by more than a second are those of an autopilot that has restarted
    motion.samples([PoseSample(100 * MS, 1500 * MS, (0.0, 0.0, -5.0), (0.5, 0.0, 0.0))])
    motion.catch_up(1500 * MS)
    assert motion.newest_pose is not None
    assert motion.newest_pose.t_ns == 100 * MS


def test_an_old_velocity_is_not_the_present_one() -> None:
    motion = VehicleMotion()
    motion.samples([PoseSample(1000 * MS, 1000 * MS, (0.0, 0.0, -5.0), (3.0, 0.0, 0.0))])
    motion.catch_up(1000 * MS)
    assert motion.velocity_ned_m_s(1500 * MS) == (3.0, 0.0, 0.0)
    assert motion.velocity_ned_m_s(1501 * MS) is None


@pytest.mark.parametrize("yaw_deg", [0.0, 120.0])
@pytest.mark.parametrize("use_pose", [True, False])
def test_what_a_frame_without_a_position_shows_comes_nearer_by_the_velocity(use_pose: bool, yaw_deg: float) -> None:
    """As in fast flight without TIMESYNC: the frame has no position, but the velocity of the vehicle is known. The wall was
    sent, and the path seen free, farther by the distance flown since the exposure: 2 m at 10 m/s and 0.2 s."""
    chain = Chain(model(wall_at(0.0, 9.0, 12.0), free_to_m=8.5, view_deg=72.0))
    chain.pipeline = Pipeline((CAMERA,), lambda info: chain.sees, SyncParams(use_pose=use_pose))
    sights: list[Surroundings] = []
    seen = CameraUse(cameras=("front",), timeout_s=0.3, observer=sights.append)
    chain.builder = ObstacleReportBuilder(AVOID, seen)
    chain.builder.announce(CAMERA)
    chain.yaw_rad = math.radians(yaw_deg)
    chain.position, speed = (0.0, 0.0, -5.0), 10.0
    chain.speed = (speed * math.cos(chain.yaw_rad), speed * math.sin(chain.yaw_rad), 0.0)
    for _ in range(4):
        chain.fly(0.1)
        chain.report()
    chain.fly(0.2, frames=False)
    assert chain.newest().frame == ("ned" if use_pose else "level")
    report = chain.report()
    assert report.values is not None
    assert report.values[0] == pytest.approx(100 * (9.0 - 2.0 - AVOID.radius_m), abs=3)
    sight = path_sight(sights[-1], AVOID, GuardParams())
    assert min(sight.obstacle_m, sight.weak_obstacle_m) == pytest.approx(7.0, abs=0.03)
    assert sight.free_m <= 6.5


def test_the_distance_flown_counts_from_the_exposure_and_not_from_the_arrival() -> None:
    """At 10 m/s and with frames that arrive 0.2 s after their exposure a wall was sent 2 m too far."""
    chain = Chain(model(wall_at(0.0, 9.0, 12.0), free_to_m=8.5, view_deg=72.0))
    chain.pipeline = Pipeline((CAMERA,), lambda info: chain.sees, SyncParams(use_pose=False))
    chain.position, chain.speed = (0.0, 0.0, -5.0), (10.0, 0.0, 0.0)
    chain.fly(0.3, frames=False)
    for _ in range(4):
        chain.fly(0.1, frames=False)
        chain.expose(late_ns=200 * MS)
    ahead_cm = chain.ahead()
    assert ahead_cm is not None
    assert abs(ahead_cm - 100 * (9.0 - 0.3 - 2.0)) < 10


def test_the_guard_subtracts_the_distance_flown_since_the_exposure_where_position_and_velocity_are_lost() -> None:
    """It flies by the last velocity for up to 2 s. What the newest frame shows is as at its exposure, 0.2 s ago."""
    chain = Chain(model(wall_at(0.0, 9.0, 12.0), free_to_m=8.5, view_deg=72.0))
    sights: list[Surroundings] = []
    chain.builder = ObstacleReportBuilder(
        AVOID, CameraUse(cameras=("front",), timeout_s=0.3, observer=lambda s: sights.append(held.held(s)))
    )
    chain.builder.announce(CAMERA)
    chain.position, chain.speed, held = (0.0, 0.0, -5.0), (10.0, 0.0, 0.0), VelocityHold()
    guard = GuardParams(enabled=True)
    assessor = PathAssessor(guard, braking_of(guard, AVOID), AVOID)
    for k in range(16):
        chain.position = chain.position if k < 8 else None
        chain.fly(0.1)
        chain.report()
        assessor.take(path_sight(sights[-1], AVOID, guard))
    chain.fly(0.2, frames=False)
    chain.report()
    assert sights[-1].views
    assert sights[-1].velocity_ned_m_s == (10.0, 0.0, 0.0)
    assessor.take(path_sight(sights[-1], AVOID, guard))
    verdict = assessor.verdict(chain.now_ns)
    assert verdict is not None
    assert verdict.speed_m_s is None, "it is not measured any more"
    assert verdict.room_m <= 8.5 - 2.0
