"""Points for ArduPilot's five layers: the middle one equals OBSTACLE_DISTANCE, and no near obstacle above or below is
lost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from companion.autopilot.obstacle_distance import UNKNOWN, for_reader, obstacle_distance_message
from companion.autopilot.obstacle_distance_3d import NO_POINTS, level_points, obstacle_points_messages, other_points
from companion.autopilot.sender import messages_of
from companion.autopilot.view_free import View
from companion.config.avoidance import AvoidParams
from companion.pipeline.transform import LevelTransform
from drivers.mavlink.ardupilot_faces import face_of
from drivers.mavlink.dialect import dialect
from drivers.simulation.firmware_models.ardupilot import ArduPilotReader
from drivers.simulation.firmware_models.ardupilot_layers import LAYERS, MIDDLE, ArduPilotLayers, layer_of

from ..report_chain import ARDUPILOT, FAULTS, PX4, Chain, broken
from ..report_chain import AVOID as SENDS
from ..sector_models import model, wall_at

AVOID = AvoidParams(radius_m=0.0, points=True)
POINTS = replace(SENDS, points=True)
HERE = LevelTransform(0.0, (0.0, 0.0, 0.0))
MS = 1_000_000


def read(points_m: np.ndarray, avoid: AvoidParams = AVOID, at_once: bool = False) -> ArduPilotLayers:
    """The scan as ArduPilot has it after the next one began."""
    layers = ArduPilotLayers(ArduPilotReader(), at_once)
    for k in range(2):
        for message in obstacle_points_messages(points_m, 1000 + k, avoid):
            layers.read(message, k * MS)
    return layers


@given(st.lists(st.sampled_from([21, 150, 777, 1199, 1201, UNKNOWN]), min_size=72, max_size=72), st.booleans())
def test_the_middle_layer_equals_obstacle_distance(cm: list[int], at_once: bool) -> None:
    values = for_reader(np.array(cm, np.uint16), AVOID, "ArduPilot")
    flat = ArduPilotReader()
    flat.read(obstacle_distance_message(values, 0, AVOID), MS)
    layers = read(level_points(values, AVOID), at_once=at_once).layers_m(MS)
    assert layers[MIDDLE] == pytest.approx(flat.faces_m(MS), abs=1e-5)
    assert all(m == math.inf for layer in (0, 1, 3, 4) for m in layers[layer])


@given(
    st.lists(
        st.tuples(
            *[st.floats(-9.0, 9.0)] * 4,
            st.floats(-7.0, 6.0),
            st.floats(0.05, 5.0),
            st.floats(0.0, 0.3),
        ),
        min_size=1,
        max_size=4,
    ),
    st.sampled_from([0.0, 0.4]),
)
@example(walls=[(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0)], radius_m=0.0)  # in no layer
def test_nothing_above_or_below_is_lost(
    walls: list[tuple[float, float, float, float, float, float, float]], radius_m: float
) -> None:
    """Every point of every plane that lies in an outer layer: its face there is sent at its distance or
    nearer."""
    avoid = replace(AVOID, radius_m=radius_m)
    planes = np.array([(ax, ay, bx, by, top, top + high) for ax, ay, bx, by, top, high, _ in walls])
    found = replace(model(*map(tuple, planes)), margin_m=np.array([w[-1] for w in walls], np.float32))
    report = read(other_points([View(found, HERE)], avoid), avoid).layers_m(MS)
    nearest = np.full((LAYERS, 8), np.inf)
    for plane, margin in zip(found.planes.astype(float), found.margin_m, strict=True):
        for share in np.linspace(0.0, 1.0, 97):
            x, y = plane[0:2] + share * (plane[2:4] - plane[0:2])
            azimuth, step_m = math.degrees(math.atan2(y, x)), math.hypot(*(plane[2:4] - plane[0:2])) / 64
            # near the border of a face an obstacle may be in the next face, and closes both
            if abs((azimuth + 22.5) % 45.0 - 22.5) > 22.0 - math.degrees(step_m / max(0.01, math.hypot(x, y))):
                continue
            for z in np.linspace(plane[4], plane[5], 25):
                elevation = math.degrees(math.atan2(-z, math.hypot(x, y)))
                off_edge = min(abs(elevation - edge) for edge in (-45.0, -15.0, 15.0, 45.0))
                if off_edge > 0.6 and abs(elevation) < 88.0:
                    place = layer_of(elevation), face_of(azimuth % 360.0)
                    nearest[place] = min(nearest[place], math.hypot(x, y, z) - margin - radius_m)
    for layer in (0, 1, 3, 4):
        for face in range(8):
            if nearest[layer, face] < avoid.max_distance_m - 0.4:
                assert report[layer][face] <= max(nearest[layer, face], avoid.min_distance_m + 0.01) + 0.01
    assert report[MIDDLE] == [math.inf] * 8  # is sent by the sectors alone


@pytest.mark.parametrize(("near", "far", "empty"), [(45.0, 315.0, 0), (0.0, 270.0, 7)])
def test_an_empty_face_that_would_open_the_fence_of_a_layer_gets_the_farthest_distance(
    near: float, far: float, empty: int
) -> None:
    """As in the middle layer: tests/companion/autopilot/test_sectors_autopilots.py."""
    planes = [(*wall_at(near, 4.0)[:4], -4.0, -3.0), (*wall_at(far, 7.0)[:4], -6.0, -5.0)]
    report = read(other_points([View(model(*planes), HERE)], AVOID)).layers_m(MS)
    assert report[3][empty] == pytest.approx(AVOID.max_distance_m - 0.01)
    assert [m for layer in report for m in layer].count(math.inf) == LAYERS * 8 - 3
    alone = read(other_points([View(model(*planes[:1]), HERE)], AVOID)).layers_m(MS)
    assert alone[3][empty] == math.inf


def test_a_branch_above_the_band_is_sent_in_the_upper_layer_and_not_ahead() -> None:
    branch = (4.0, -1.0, 4.0, 1.0, -4.0, -3.0)  # 4 m ahead, from 3 to 4 m above
    report = read(other_points([View(model(branch), HERE)], AVOID)).layers_m(MS)
    assert report[3][0] == pytest.approx(5.0, abs=0.05)
    assert [m for layer in report for m in layer].count(math.inf) == LAYERS * 8 - 1
    behind = read(other_points([View(replace(model(branch), valid=False), HERE)], AVOID)).layers_m(MS)
    assert all(m == math.inf for layer in behind for m in layer)


def test_no_obstacle_is_a_message_too_which_keeps_proximity_healthy() -> None:
    (message,) = obstacle_points_messages(NO_POINTS, 5, AVOID)
    fence = ArduPilotReader()
    layers = ArduPilotLayers(fence)
    layers.read(message, MS)
    assert fence.healthy(MS)
    assert all(m == math.inf for layer in layers.layers_m(MS) for m in layer)


def test_a_scan_counts_once_the_next_one_begins() -> None:
    fence = ArduPilotReader()
    layers = ArduPilotLayers(fence)
    near = obstacle_points_messages(np.array([[3.0, 0.0, 0.0], [0.0, 3.0, 0.0]]), 7, AVOID)
    for message in near:
        layers.read(message, MS)
    assert fence.faces_m(MS)[0] == math.inf
    layers.read(obstacle_points_messages(NO_POINTS, 8, AVOID)[0], 60 * MS)
    assert fence.faces_m(60 * MS)[0] == pytest.approx(3.0)
    assert fence.faces_m(60 * MS)[2] == pytest.approx(3.0)
    assert layers.layers_m(561 * MS)[MIDDLE][0] == math.inf  # it fails open, half a second later


def kinds_sent_to(chain: Chain, autopilot: str) -> list[str]:
    now = ARDUPILOT if autopilot == "ArduPilot" else replace(PX4, kind=autopilot)
    return [m.get_type() for m in messages_of(chain.report(now), autopilot, POINTS, chain.now_ns)]


def test_points_are_sent_to_ardupilot_only_and_only_where_enabled() -> None:
    chain = Chain(model(wall_at(0.0, 5.0), free_to_m=4.5, view_deg=72.0), POINTS)
    chain.fly(1.0)
    assert set(kinds_sent_to(chain, "ArduPilot")) == {"OBSTACLE_DISTANCE_3D"}
    assert kinds_sent_to(chain, "PX4") == kinds_sent_to(chain, "ArduPilot or PX4") == ["OBSTACLE_DISTANCE"]
    report = chain.report(ARDUPILOT)
    assert [m.get_type() for m in messages_of(report, "ArduPilot", SENDS, 0)] == ["OBSTACLE_DISTANCE"]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_blind_service_sends_the_wall_as_points_and_no_older_points(fault: str) -> None:
    branch = (4.0, -1.0, 4.0, 1.0, -4.0, -3.0)
    chain = Chain(replace(model(branch, free_to_m=13.0, view_deg=72.0)), POINTS)
    chain.fly(1.0)
    assert len(chain.report(ARDUPILOT).points_m) == 1
    broken(chain, fault, 0.4)
    report = chain.report(ARDUPILOT)
    flat, fence = ArduPilotReader(), ArduPilotReader()
    flat.read(obstacle_distance_message(report.values, 0, POINTS), MS)
    layers = ArduPilotLayers(fence)
    for k in range(2):
        for message in messages_of(report, "ArduPilot", POINTS, (1000 + k) * MS):
            layers.read(message, (1 + k) * MS)
    assert fence.faces_m(2 * MS) == pytest.approx(flat.faces_m(MS), abs=1e-5)
    assert fence.faces_m(2 * MS)[0] == pytest.approx(3.2)
    assert len(report.points_m) == 0
    assert layers.layers_m(2 * MS)[3] == [math.inf] * 8


def test_golden_bytes() -> None:
    values = np.full(72, UNKNOWN, np.uint16)
    values[0], values[18] = 250, 1201
    points = np.concatenate([level_points(values, AVOID), [[3.0, -1.0, -4.0]]])
    packer = dialect.MAVLink(None, 1, 196)
    assert [m.pack(packer).hex() for m in obstacle_points_messages(points, 0x01020304, AVOID)] == [
        "fd1c00000001c41d2b0004030201000020400000000000000000cdcc4c3e00004041ffff040c7d1c",
        "fd1c00000001c41d2b000403020100004040000080bf000080c0cdcc4c3e00004041ffff040ce75c",
    ]
