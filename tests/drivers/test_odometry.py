"""ODOMETRY: what of a message is used, and why one is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from core.types import PoseSample
from drivers.mavlink.dialect import dialect
from drivers.simulation.autopilot import PX4

from .conversation import MS, Conversation, talk

LOCAL_NED, BODY_FRD, MOCAP_NED = 1, 12, 14
EAST = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))
NAN_21 = [math.nan] * 21


@pytest.fixture(scope="module")
def flying() -> Conversation:
    """An autopilot with a synchronised clock, and a position that confirms its odometry."""
    c = talk(PX4, boot_at_ns=0)
    c.run(2.0)
    assert samples(c) == [], "the rate of the first is not known"
    return c


def samples(c: Conversation, **fields: Any) -> list[Any]:
    """The samples of one message. fields: what differs from a flight of 4 m/s ahead, to the east."""
    boot_us = c.autopilots[0].boot_ns(c.now_ns) // 1000
    odometry = dialect.MAVLink_odometry_message(
        boot_us, LOCAL_NED, BODY_FRD, 1.0, 2.0, -3.0, EAST, 4.0, 0.0, 0.0, 0, 0, 0, NAN_21, NAN_21, quality=80
    )
    for name, value in fields.items():
        assert hasattr(odometry, name)
        setattr(odometry, name, value)
    return c.session.receive([(bytes(odometry.pack(dialect.MAVLink(None, 1, 1))), c.now_ns + MS)])


@pytest.mark.parametrize(
    ("fields", "velocity_ned_m_s"),
    [
        ({}, (0.0, 4.0, 0.0)),
        ({"child_frame_id": 8}, (0.0, 4.0, 0.0)),
        ({"child_frame_id": LOCAL_NED}, (4.0, 0.0, 0.0)),
        ({"child_frame_id": 20}, (4.0, 0.0, 0.0)),
        ({"child_frame_id": MOCAP_NED}, None),
        ({"q": tuple(1.04 * c for c in EAST)}, (0.0, 4.0, 0.0)),
        ({"q": tuple(1.06 * c for c in EAST)}, None),
        ({"q": tuple(0.94 * c for c in EAST)}, None),
        ({"q": (0.0, 0.0, 0.0, 0.0)}, None),
        ({"q": (math.nan,) * 4}, None),
        ({"vy": math.nan}, None),
        ({"vz": math.inf}, None),
    ],
)
def test_a_velocity_that_cannot_be_turned_into_ned_is_left_out(
    flying: Conversation, fields: dict[str, Any], velocity_ned_m_s: tuple[float, float, float] | None
) -> None:
    (pose,) = samples(flying, **fields)
    assert isinstance(pose, PoseSample)
    assert pose.position_ned_m == (1.0, 2.0, -3.0)
    expected = None if velocity_ned_m_s is None else pytest.approx(velocity_ned_m_s, abs=0.4)
    assert pose.velocity_ned_m_s == expected


@pytest.mark.parametrize(
    ("fields", "count"),
    [
        ({"quality": -1}, "odometry_unusable"),
        ({"frame_id": MOCAP_NED}, "odometry_unusable"),
        ({"x": math.nan}, "position_non_finite"),
        ({"z": math.inf}, "position_non_finite"),
        ({"time_usec": 1_700_000_000_000_000}, "odometry_unix_time"),
    ],
)
def test_a_message_that_is_refused_is_counted_by_its_cause(
    flying: Conversation, fields: dict[str, Any], count: str
) -> None:
    before = flying.session.status(flying.now_ns).counts.get(count, 0)
    assert samples(flying, **fields) == []
    assert flying.session.status(flying.now_ns).counts[count] == before + 1
