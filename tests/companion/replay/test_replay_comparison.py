"""What the check of `companion replay` compares, and what it names."""

from __future__ import annotations

import pytest

from companion.replay.compare import WAITING, Comparison, first_difference
from osape_client.proto import osape_v1_pb2 as pb


def message(**fields) -> pb.PrismsFrame:
    return pb.PrismsFrame(camera="c", sequence=1, t_exposure_ns=2, **fields)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ({"ke_per_m": 1.0}, {"ke_per_m": 1.0}, None),
        ({"ke_per_m": float("nan")}, {"ke_per_m": float("nan")}, None),
        ({"ke_per_m": 0.0}, {"ke_per_m": -0.0}, ("ke_per_m", "0.0", "-0.0")),
        ({"frame": "ned"}, {"frame": "level"}, ("frame", "'ned'", "'level'")),
        ({"ground": pb.Ground(seen=True)}, {}, ("ground", "present", "absent")),
        ({}, {"stats": pb.FrameStats()}, ("stats", "absent", "present")),
        ({"prisms": [pb.Prism()]}, {"prisms": []}, ("prisms (length)", "1", "0")),
        ({"prisms": [pb.Prism(plane=[1])]}, {"prisms": [pb.Prism(plane=[2])]}, ("prisms[0].plane[0]", "1", "2")),
    ],
)
def test_the_first_difference_is_named(a, b, expected):
    assert first_difference(message(**a), message(**b)) == expected


def test_pairs_come_in_any_order():
    comparison = Comparison()
    for sequence in (1, 2, 3):
        comparison.computed(pb.PrismsFrame(camera="c", sequence=sequence))
    for sequence in (3, 1, 4):
        comparison.logged(pb.PrismsFrame(camera="c", sequence=sequence))
    assert (comparison.compared, comparison.different, comparison.passed) == (2, 0, True)
    assert comparison.only_computed == comparison.gaps == (("c", 2, 0),)
    assert comparison.only_logged == (("c", 4, 0),)


def test_what_is_missing_at_the_end_of_a_camera_is_no_gap():
    comparison = Comparison()
    for camera, sequence in (("a", 1), ("b", 1), ("a", 2), ("b", 2), ("c", 1)):
        comparison.computed(pb.PrismsFrame(camera=camera, sequence=sequence, t_exposure_ns=sequence))
    for camera, sequence in (("a", 1), ("b", 2)):
        comparison.logged(pb.PrismsFrame(camera=camera, sequence=sequence, t_exposure_ns=sequence))
    assert comparison.only_computed == (("b", 1, 1), ("a", 2, 2), ("c", 1, 1))
    assert comparison.gaps == (("b", 1, 1), ("c", 1, 1))


def test_a_check_without_counterparts_keeps_a_bounded_number_of_messages():
    """Of a log without depth images it kept all results: 2 GB for an hour of flight."""
    comparison = Comparison()
    for sequence in range(3 * WAITING):
        comparison.logged(pb.PrismsFrame(camera="a", sequence=sequence, t_exposure_ns=sequence))
        comparison.computed(pb.PrismsFrame(camera="b", sequence=sequence, t_exposure_ns=sequence))
    assert len(comparison._logged) == len(comparison._computed) == WAITING
    assert comparison.only_logged == tuple(("a", k, k) for k in range(3 * WAITING))
    assert comparison.only_computed == tuple(("b", k, k) for k in range(3 * WAITING))
    comparison.logged(pb.PrismsFrame(camera="b", sequence=0, t_exposure_ns=0))  # later than any log has it
    assert comparison.compared == 0
    assert ("b", 0, 0) in comparison.only_logged
    assert ("b", 0, 0) in comparison.gaps
