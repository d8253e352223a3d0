"""The motion of the vehicle, by which the obstacle output moves what it remembers."""

from __future__ import annotations

from companion.autopilot.vehicle_motion import VehicleMotion
from core.types import AttitudeSample, PoseSample

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
