"""Obstacle distances in the health report: what was sent and what came back."""

from __future__ import annotations

import numpy as np
import pytest

from companion.autopilot.sector_view import FORGOTTEN_NS, SectorView
from companion.viewer.autopilot_view import autopilot_data
from drivers.mavlink.dialect import dialect
from osape_client.proto import osape_v1_pb2 as pb

VALUES = np.full(72, 65535, np.uint16)
VALUES[:3] = [500, 501, 1001]


def filled(view: SectorView, now_ns: int) -> pb.AutopilotHealth:
    health = pb.AutopilotHealth(autopilot="PX4", flight_mode="Position", armed=True)
    view.fill(health, now_ns)
    return health


def test_nothing_sent_is_nothing_reported() -> None:
    health = filled(SectorView(), 10)
    assert not health.HasField("obstacles_sent")
    assert not health.HasField("obstacles_echoed")


def test_what_was_sent_is_reported_until_it_is_too_old() -> None:
    view = SectorView()
    view.sent(VALUES, 1001, 100)
    sent = filled(view, 100 + FORGOTTEN_NS).obstacles_sent
    assert (list(sent.cm), sent.step_deg, sent.clear_cm, sent.body_frame) == (VALUES.tolist(), 5.0, 1001, True)
    assert not filled(view, 101 + FORGOTTEN_NS).HasField("obstacles_sent")


@pytest.mark.parametrize("field", ["angle_offset", "increment_f"])
def test_a_map_whose_directions_are_not_finite_is_not_reported(field: str) -> None:
    view = SectorView()
    echo = dialect.MAVLink_obstacle_distance_message(0, 4, [300] * 72, 5, 20, 1000, 5.0, 12.0, 12)
    setattr(echo, field, float("nan"))
    view.take(echo, 50)
    assert not filled(view, 60).HasField("obstacles_echoed")


def test_px4_sends_its_map_back() -> None:
    view = SectorView()
    echo = dialect.MAVLink_obstacle_distance_message(0, 4, [65535] * 70 + [300, 1001], 5, 20, 1000, 5.0, 12.0, 12)
    view.take(echo, 50)
    echoed = filled(view, 60).obstacles_echoed
    assert (echoed.cm[70], echoed.clear_cm, echoed.first_deg, echoed.step_deg) == (300, 1001, 12.0, 5.0)
    assert echoed.body_frame


def test_ardupilot_answers_with_eight_faces() -> None:
    view = SectorView()
    for face, cm in ((0, 400), (3, 990)):
        view.take(dialect.MAVLink_distance_sensor_message(0, 10, 1000, cm, 0, 10 + face, face, 0), 70)
    view.take(dialect.MAVLink_distance_sensor_message(0, 10, 1000, 150, 0, 0, 0, 0), 70)  # a range finder
    echoed = filled(view, 80).obstacles_echoed
    assert list(echoed.cm) == [400, 65535, 65535, 990, 65535, 65535, 65535, 65535]
    assert echoed.step_deg == 45.0


def test_a_face_that_ardupilot_has_emptied_is_no_obstacle() -> None:
    """Once a face was valid, GCS_MAVLINK::send_proximity goes on to send it with the greatest distance. It was
    shown as an obstacle just beyond that distance."""
    view = SectorView()
    for cm in (400, 1000):
        view.take(dialect.MAVLink_distance_sensor_message(0, 10, 1000, cm, 0, 10, 0, 0), 70)
    view.take(dialect.MAVLink_distance_sensor_message(0, 10, 1000, 300, 0, 11, 1, 0), 70)
    assert list(filled(view, 80).obstacles_echoed.cm)[:2] == [65535, 300]


def test_the_page_gets_null_for_unknown_and_the_ages() -> None:
    view = SectorView()
    view.sent(VALUES, 1001, 1_000_000_000)
    health = pb.Health(t_ns=1_500_000_000, autopilot=filled(view, 1_500_000_000))
    data = autopilot_data(health, 2_000_000_000)
    assert data is not None
    assert (data["mode"], data["armed"], data["age_s"], data["echoed"]) == ("Position", True, 0.5, None)
    assert data["sent"]["cm"][:4] == [500, 501, 1001, None]
    assert data["sent"]["age_s"] == 1.0
    assert autopilot_data(pb.Health(), 0) is None
    health.autopilot.heartbeat_age_ns = 74_000_000_000
    late = autopilot_data(health, 2_000_000_000)
    assert late is not None
    assert late["age_s"] == 73.5, "mode and armed are those of the heartbeat"
