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
