"""Which reports are a vehicle of the team: a person below or beside one is never taken for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from core.sharing.bodies import Body, MovingReport, are_bodies
from core.sharing.neighbour import NS
from core.sharing.neighbour_map import NeighbourMap
from core.sharing.obstacles import MoverKind
from core.sharing.packet_codec import movers_packet, planes_packet, state_packet
from core.sharing.records import LocalFrame, SharedMover, SharedPlanes
from core.types import PlaneFlags

from .neighbours import FRAME, OWN, header, mover, state

ORIGIN = (0.0, 0.0, 0.0)
PERSON = (0.3, 0.3, 0.9)
VAGUE = replace(FRAME, sigma_m=2.5, sigma_z_m=4.0)
"""With so much uncertainty a person who walks below or beside a vehicle has the place of the vehicle."""


def reported(*movers: SharedMover, frame: LocalFrame = VAGUE, speed_m_s: float = 0.0) -> list[MoverKind]:
    """The kinds of what counts when vehicle 3 reports these beside vehicle 2, which is at x = 30 and flies at that speed."""
    assert OWN.state is not None
    own, found = replace(OWN, state=replace(OWN.state, frame=frame)), NeighbourMap(1)
    flown = replace(state(30.0, frame), velocity_m_s=(speed_m_s, 0.0, 0.0))
    assert found.receive(state_packet(header(1), flown), NS) == ""
    assert found.receive(state_packet(header(1, vehicle=3), state(60.0, frame)), NS) == ""
    assert found.receive(movers_packet(header(2, vehicle=3), movers, ORIGIN), NS) == ""
    return sorted(m.kind for m in found.obstacles(own, NS).movers if (m.sender, m.kind) != (3, MoverKind.VEHICLE))


BOTH = [MoverKind.OBSTACLE, MoverKind.VEHICLE]


def test_a_vehicle_that_has_braked_since_it_was_observed_is_no_obstacle() -> None:
    """Neither another one, nor the own vehicle, which would become an obstacle to itself."""
    body = Body(vehicle=1, centre_m=ORIGIN, radius_m=0.4, margin_m=0.0, velocity_m_s=(0.5, 0.0), is_own=True)
    report = MovingReport(
        centre_m=(0.8, 0.0, 0.0), half_size_m=(0.4, 0.4, 0.2), velocity_m_s=(3.0, 0.0), sigma_m_s=0.3, margin_m=1.0
    )
    assert not body.may_be(report)
    assert body.may_be(replace(report, age_s=0.4))


@pytest.mark.parametrize(
    "child", [{"half_size_m": (0.2, 0.2, 0.5)}, {"centre_m": (0.0, 0.0, -1.9)}, {"centre_m": (1.3, 0.0, -3.0)}]
)
def test_what_size_and_uncertainty_do_not_explain_is_not_the_own_vehicle(
    child: dict[str, tuple[float, float, float]],
) -> None:
    """No obstacle stands for the own vehicle: its radius is 0.4 m, the place of a report is certain to 1 m. A child
    is higher, or below it, or beside it."""
    found = NeighbourMap(1)
    assert found.receive(state_packet(header(1), state(30.0)), NS) == ""
    small = replace(mover(0.0, speed_m_s=0.0), half_size_m=(0.2, 0.2, 0.3))
    for k, one in enumerate([small, replace(small, **child)]):
        assert found.receive(movers_packet(header(2 + k), (one,), ORIGIN), NS) == ""
        kinds = sorted(m.kind for m in found.obstacles(OWN, NS).movers)
        assert kinds == [[MoverKind.VEHICLE], BOTH][k]


def test_a_wide_plane_beside_the_own_vehicle_is_not_the_vehicle() -> None:
    """A hedge of 2 m, 0.8 m high, of which the middle is 0.5 m beside it."""
    found = NeighbourMap(1)
    assert found.receive(state_packet(header(1), state(30.0)), NS) == ""
    hedge = replace(small_plane(-3.4, -2.6), box=np.array([[0.5, -1.0, 0.5, 1.0, -3.4, -2.6]]))
    assert found.receive(planes_packet(header(2), hedge, ORIGIN), NS) == ""
    assert found.obstacles(OWN, NS).ids.tolist() == [5]


@pytest.mark.parametrize("vague", [{"age_s": 2.0}, {"sigma_m_s": 6.0}])
def test_a_report_whose_velocity_is_not_known_does_not_fit_to_every_vehicle(vague: dict[str, float]) -> None:
    """A person stands below a vehicle that flies past at 8 m/s. After two seconds any velocity would fit."""
    body = Body(vehicle=1, centre_m=ORIGIN, radius_m=0.4, margin_m=3.0, velocity_m_s=(8.0, 0.0), is_own=True)
    report = MovingReport(centre_m=(0.8, 0.0, 0.0), half_size_m=(0.2, 0.2, 0.3), velocity_m_s=(0.0, 0.0))
    assert not body.may_be(replace(report, **vague))


@pytest.mark.parametrize("off_m", [(0.0, 0.0, 2.1), (0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, -2.9, 1.0)])
@pytest.mark.parametrize("speed_m_s", [0.0, 1.4])
def test_a_person_below_or_beside_a_neighbour_stays(off_m: tuple[float, float, float], speed_m_s: float) -> None:
    """With the velocity of the vehicle, too."""
    x, y, z = off_m
    person = replace(mover(30.0, speed_m_s=speed_m_s), centre_m=(30.0 + x, y, -3.0 + z), half_size_m=PERSON)
    assert reported(person, speed_m_s=speed_m_s) == BOTH


def test_a_child_that_walks_where_a_neighbour_hovers_stays() -> None:
    child = replace(mover(31.0, speed_m_s=1.2), half_size_m=(0.2, 0.2, 0.55))
    assert reported(child) == BOTH


def test_a_low_thing_below_a_neighbour_stays_where_the_heights_are_known() -> None:
    low = replace(mover(30.0, speed_m_s=0.0), centre_m=(30.0, 0.0, -0.5), half_size_m=(0.3, 0.3, 0.5))
    assert reported(low, frame=FRAME) == BOTH


@pytest.mark.parametrize("speed_m_s", [0.0, 6.0])
def test_a_neighbour_that_others_report_counts_once(speed_m_s: float) -> None:
    assert reported(mover(30.8, speed_m_s=speed_m_s + 0.3), speed_m_s=speed_m_s) == [MoverKind.VEHICLE]


def test_one_report_is_the_vehicle_and_what_is_beside_it_stays() -> None:
    beside = replace(mover(31.5, speed_m_s=0.0), id=5)
    assert reported(mover(30.3, speed_m_s=0.0), beside) == BOTH
    body = Body(vehicle=2, centre_m=ORIGIN, radius_m=0.4, margin_m=3.0, margin_z_m=3.0, velocity_m_s=(0.0, 0.0))
    near, far = (
        MovingReport(centre_m=(x_m, 0.0, 0.0), half_size_m=(0.2, 0.2, 0.2), velocity_m_s=(0.0, 0.0), margin_m=1.0)
        for x_m in (0.3, 1.5)
    )
    assert body.may_be(far)
    assert (body.find([near, far]), body.find([far, near]), body.find([])) == (0, 1, None)


@pytest.mark.parametrize("off_m", [(0.0, 0.0, 0.0), (0.6, 0.0, 0.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("partial", [False, True])
def test_the_visible_part_of_a_person_beside_a_vehicle_stays(off_m: tuple[float, float, float], partial: bool) -> None:
    """Head and shoulders behind a hedge, or above the border of the image. Beside a neighbour, and beside the own vehicle."""
    x, y, z = off_m
    part = replace(mover(30.0, speed_m_s=0.0), half_size_m=(0.3, 0.3, 0.35), partial=partial)
    for place_m, kinds in ((30.0, [MoverKind.VEHICLE]), (0.0, [MoverKind.VEHICLE])):
        found = reported(replace(part, centre_m=(place_m + x, y, -3.0 + z)))
        assert found == (BOTH if partial else kinds)


def test_a_report_that_a_neighbour_does_not_contain_stays() -> None:
    """Its place is uncertain by 0.8 m, and what was reported 1.5 m beside it may be something else."""
    near, beside = mover(30.2, speed_m_s=0.0), mover(31.5, speed_m_s=0.0)
    assert reported(near, frame=FRAME) == [MoverKind.VEHICLE]
    assert reported(beside, frame=FRAME) == BOTH


def small_plane(top_m: float, bottom_m: float, flags: int = 0) -> SharedPlanes:
    """A plane 0.5 m wide 1 m beside vehicle 2."""
    return SharedPlanes(
        ids=np.array([5], np.uint16),
        box=np.array([[31.0, -0.25, 31.0, 0.25, top_m, bottom_m]]),
        margin_m=np.array([0.1]),
        flags=np.array([flags], np.uint8),
        age_s=np.array([0.1]),
    )


FLAGS = [0, PlaneFlags.CUT_LEFT, PlaneFlags.CUT_RIGHT, PlaneFlags.CUT_TOP, PlaneFlags.CUT_BOTTOM]


@pytest.mark.parametrize("flags", FLAGS)
@pytest.mark.parametrize(("top_m", "bottom_m", "stays"), [(-1.8, 0.0, True), (-3.9, -2.1, True), (-3.2, -2.8, False)])
def test_the_planes_of_a_person_who_stands_beside_a_neighbour_stay(
    top_m: float, bottom_m: float, stays: bool, flags: int
) -> None:
    """A plane that the border of the image cuts may be a part of a person, whatever its height."""
    assert OWN.state is not None
    own, found = replace(OWN, state=replace(OWN.state, frame=VAGUE)), NeighbourMap(1)
    assert found.receive(state_packet(header(1), state(30.0, VAGUE)), NS) == ""
    assert found.receive(state_packet(header(1, vehicle=3), state(60.0, VAGUE)), NS) == ""
    planes = small_plane(top_m, bottom_m, int(flags))
    assert found.receive(planes_packet(header(2, vehicle=3), planes, ORIGIN), NS) == ""
    stays = stays or bool(flags)
    assert (5 in found.obstacles(own, NS).ids) is stays
    (body,) = (b for b in found.bodies(own, NS) if b.vehicle == 2)
    assert bool(are_bodies(body, planes.box, planes.flags, planes.margin_m)[0]) is not stays, "so it is sent, too"
