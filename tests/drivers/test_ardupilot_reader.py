"""The fence that ArduPilot makes of eight faces, against what a running one was measured to do."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from drivers.mavlink.ardupilot_faces import FACES, READ_BEFORE, face_of
from drivers.mavlink.dialect import dialect
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader, loiter_speed_m_s

NS = 1_000_000_000
FRONT = (7, 0, 1)


def reader_of(
    faces: dict[int, float], margin_m: float = 2.0, slides: bool = False, backs_up: bool = True
) -> ArduPilotReader:
    reader = ArduPilotReader(margin_m=margin_m, slides=slides, backs_up=backs_up)
    reader.take_faces([faces.get(face, math.inf) for face in range(FACES)], NS)
    return reader


@pytest.mark.parametrize(
    ("wall_m", "least", "most"),
    [
        (0.6, -0.78, -0.5),
        (1.5, -0.78, -0.4),
        (2.5, -0.78, -0.3),
        (3.0, -0.77, -0.2),
        (3.05, -0.3, -0.02),
        (3.1, -0.2, -0.02),
        (3.2, -0.02, 0.03),
        (3.35, 0.08, 0.13),
        (3.5, 0.18, 0.24),
    ],
)
def test_constant_walls_ahead_as_they_were_measured(wall_m: float, least: float, most: float) -> None:
    """AVOID_MARGIN 3 m, stick forward."""
    reader = reader_of(dict.fromkeys(FRONT, wall_m), margin_m=3.0)
    assert least <= loiter_speed_m_s(reader.room_m(0.0, NS)) <= most
    forward, right = reader.velocity_m_s((2.0, 0.0), NS)
    assert least <= forward <= most
    assert abs(right) < 1e-9


@given(
    st.floats(0.0, 360.0, exclude_max=True),
    st.floats(0.65, 12.0),
    st.booleans(),
    st.dictionaries(st.integers(0, 7), st.floats(0.65, 12.0)),
)
@example(angle_deg=0.0, distance_m=2.0, slides=False, others={2: 1.0})
def test_the_fence_is_nowhere_beyond_the_received_obstacles(
    angle_deg: float, distance_m: float, slides: bool, others: dict[int, float]
) -> None:
    """Who stops is let no nearer than that; what pushes the vehicle from behind is another matter. Who slides is limited by
    one line of the fence after the other: sliding along one may lead towards one that was looked at before."""
    faces = {**others, face_of(angle_deg): min(distance_m, others.get(face_of(angle_deg), math.inf))}
    for first, empty, third in READ_BEFORE:  # as they are sent, see the next test
        if first in faces and third in faces:
            faces.setdefault(empty, 12.0)
    reader = reader_of(faces, slides=slides)
    assert reader.room_m(angle_deg, NS) <= distance_m - reader.margin_m + 1e-6
    wanted = (3.0 * math.cos(math.radians(angle_deg)), 3.0 * math.sin(math.radians(angle_deg)))
    forward, right = reader_of(faces, slides=slides, backs_up=False).velocity_m_s(wanted, NS)
    assert math.hypot(forward, right) <= 3.0 + 1e-9
    if not slides:
        towards = (forward * wanted[0] + right * wanted[1]) / 3.0
        assert towards <= max(0.0, loiter_speed_m_s(distance_m - reader.margin_m)) + 1e-9


@pytest.mark.parametrize(
    ("faces", "angle_deg", "fence_m"),
    [
        ({1: 4.0, 7: 10.0}, 30.0, 7.56),
        ({1: 4.0, 7: 10.0, 0: 12.0}, 30.0, 3.83),
        ({1: 2.0, 7: 10.0}, 30.0, 5.61),
        ({0: 4.0, 6: 10.0}, 0.0, 5.28),
        ({0: 4.0, 6: 10.0, 7: 12.0}, 0.0, 3.70),
        ({7: 4.0, 1: 10.0}, 330.0, 3.83),  # face 1 is read before face 7
    ],
)
def test_a_face_that_is_read_later_opens_the_fence_beyond_an_empty_one(
    faces: dict[int, float], angle_deg: float, fence_m: float
) -> None:
    """docs/research/autopilot-measurements.md: its corner replaces that of a nearer obstacle, unless the face between them has a
    distance."""
    reader = reader_of(faces, backs_up=False)
    assert reader.room_m(angle_deg, NS) + reader.margin_m == pytest.approx(fence_m, abs=0.01)


@given(
    st.floats(0.0, 360.0, exclude_max=True),
    st.booleans(),
    st.dictionaries(st.integers(0, 7), st.floats(0.65, 12.0)),
)
@example(angle_deg=0.0, slides=False, others={0: 2.0, 2: 1.0})
def test_what_is_within_the_margin_pushes_away_from_itself_and_no_faster_than_measured(
    angle_deg: float, slides: bool, others: dict[int, float]
) -> None:
    wanted = (3.0 * math.cos(math.radians(angle_deg)), 3.0 * math.sin(math.radians(angle_deg)))
    limited = reader_of(others, slides=slides, backs_up=False).velocity_m_s(wanted, NS)
    pushed = reader_of(others, slides=slides).velocity_m_s(wanted, NS)
    push = (pushed[0] - limited[0], pushed[1] - limited[1])
    middles = [math.radians(45.0 * face) for face, m in others.items() if m < 2.1]
    if not middles:
        assert push == (0.0, 0.0)
    for axis in (0, 1):
        fastest = max(abs(limited[axis]), 0.78)  # one breach; two on one side push no faster than the stronger
        assert abs(pushed[axis]) <= fastest
    # a push leads away from something: the fence of a face reaches two and a half faces to either side
    if math.hypot(*push) > 1e-9:
        bearing = math.atan2(push[1], push[0])
        assert any(math.cos(bearing - middle) < math.cos(math.radians(20.0)) for middle in middles)


def test_an_obstacle_behind_pushes_slowly_towards_the_one_ahead() -> None:
    """Wall ahead at the margin, another one metre to the right: backing away from that one's corner leads forward. With
    AVOID_BACKUP_SPD 0 the vehicle stands."""
    wall = {0: 2.0, 2: 1.0}
    forward, right = reader_of(wall).velocity_m_s((3.0, 0.0), NS)
    assert 0.1 < forward < 0.2
    assert -0.5 < right < -0.3
    assert reader_of(wall, backs_up=False).velocity_m_s((3.0, 0.0), NS) == (0.0, 0.0)


def test_a_vehicle_that_already_flies_away_is_not_pushed() -> None:
    behind = {4: 1.0}
    assert reader_of(behind).velocity_m_s((2.0, 0.0), NS)[0] == 2.0
    assert reader_of(behind).velocity_m_s((0.0, 0.0), NS)[0] > 0.3


def test_one_face_closes_the_two_beside_it_and_leaves_the_rest() -> None:
    reader = reader_of({0: 3.0})
    assert reader.room_m(0.0, NS) == pytest.approx(3.0 * math.cos(math.radians(22.5)) - 2.0)
    for angle_deg in (-60.0, -30.0, 30.0, 60.0):
        assert math.isfinite(reader.room_m(angle_deg, NS))
    for angle_deg in (75.0, 120.0, 180.0, 270.0):
        assert reader.room_m(angle_deg, NS) == math.inf


def test_two_faces_close_the_one_between_them() -> None:
    assert reader_of({7: 5.0, 1: 5.0}).room_m(0.0, NS) == pytest.approx(5.0 * math.cos(math.radians(22.5)) - 2.0)
    assert reader_of({6: 5.0, 2: 5.0}).room_m(0.0, NS) == math.inf


def test_sliding_and_stopping_take_away_what_leads_towards_a_wall() -> None:
    """A wall to the right, half a metre beyond the margin."""
    wall = {2: 2.5 / math.cos(math.radians(22.5))}
    slides, stops = (reader_of(wall, slides=s).velocity_m_s((0.5, 2.0), NS) for s in (True, False))
    for forward, right in (slides, stops):
        assert right < 0.6
        assert math.hypot(forward, right) < 0.7


def test_an_empty_message_and_silence_are_no_obstacle() -> None:
    reader = reader_of({})
    assert reader.healthy(NS)
    assert all(reader.room_m(d, NS) == math.inf for d in range(0, 360, 5))
    reader = reader_of({0: 1.0})
    assert reader.room_m(0.0, NS) < 0.0
    assert reader.room_m(0.0, NS + NS // 2 + 1) == math.inf  # it fails open
    assert reader.velocity_m_s((3.0, 0.0), 2 * NS) == (3.0, 0.0)


def test_its_low_pass_sees_a_new_obstacle_late_and_one_after_nothing_at_once() -> None:
    far, near = [12.0] + [math.inf] * 7, [3.0] + [math.inf] * 7
    reader = ArduPilotReader(filter_hz=0.25)
    reader.take_faces(far, NS)
    late = []
    for tenth in range(1, 40):
        reader.take_faces(near, NS + tenth * NS // 10)
        late.append(reader.room_m(0.0, NS + tenth * NS // 10))
    settled = 3.0 * math.cos(math.radians(22.5)) - 2.0
    assert late[4] > settled + 3.0  # half a second later it still thinks of 7 m
    assert late[-1] == pytest.approx(settled, abs=0.1)
    fresh = ArduPilotReader(filter_hz=0.25)
    fresh.take_faces([math.inf] * 8, NS)
    fresh.take_faces(near, 2 * NS)
    assert fresh.room_m(0.0, 2 * NS) == pytest.approx(settled)


def front_message(right_m: float, left_m: float, behind_m: float = 9.0) -> Any:
    """The nose and what is to the right of it at one distance, the left of the front face at another; inf: nothing behind."""
    distances = [65535] * 72
    distances[:5], distances[68:] = [round(100 * right_m)] * 5, [round(100 * left_m)] * 4
    if math.isfinite(behind_m):
        distances[36] = round(100 * behind_m)
    return dialect.MAVLink_obstacle_distance_message(0, 0, distances, 5, 20, 1200, 5.0, 0.0, 12)


@pytest.mark.parametrize(
    ("one_pass", "filter_hz", "counts_m"),
    [(False, 0.0, 3.0), (False, 1.0, 3.0), (True, 0.0, 3.0), (True, 1.0, 8.0)],
)
def test_the_low_pass_takes_the_first_setting_of_the_front_face(
    one_pass: bool, filter_hz: float, counts_m: float
) -> None:
    """The second setting follows within the same millisecond. Without a value in another face there is one setting."""
    reader = ArduPilotReader(one_pass=one_pass, filter_hz=filter_hz)
    for tenth in range(50):
        reader.read(front_message(right_m=8.0, left_m=3.0), NS + tenth * NS // 10)
    assert reader.faces_m(6 * NS - NS // 10)[0] == 3.0
    room_m = counts_m * math.cos(math.radians(22.5)) - reader.margin_m
    assert reader.room_m(0.0, 6 * NS - NS // 10) == pytest.approx(room_m)
    alone = ArduPilotReader(one_pass=one_pass, filter_hz=filter_hz)
    alone.read(front_message(right_m=8.0, left_m=3.0, behind_m=math.inf), NS)
    assert alone.room_m(0.0, NS) == pytest.approx(3.0 * math.cos(math.radians(22.5)) - alone.margin_m)
