"""When the place of a neighbour's frame is replaced by a fit, and when a fit is dropped. The fits are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import core.sharing.neighbour as neighbour_module
from core.sharing.alignment import Fit, FitResult
from core.sharing.neighbour import KEEP_FIT_NS, NS
from core.sharing.neighbour_map import NeighbourMap, OwnState
from core.sharing.obstacles import PlacementState
from core.sharing.packet_codec import planes_packet, state_packet
from core.sharing.params import SharingParams
from core.sharing.placement import Floats, Placement

from .neighbours import FRAME, OWN, filled_map, header, state, state_at, wall, wall_packet

NO_PLANES = np.zeros((0, 6))


class Fits:
    """Gives fits instead of computing them. next: shift north in metres, a result, or an error."""

    def __init__(self) -> None:
        self.next: float | FitResult | Exception = 0.0

    def fit(self, other_box: Floats, own_box: Floats, prior: Placement) -> Fit:
        if isinstance(self.next, Exception):
            raise self.next
        if isinstance(self.next, FitResult):
            return Fit(self.next, prior)
        x, y, z = prior.at_m
        placement = replace(prior, at_m=(x + self.next, y, z), sigma_m=0.3, sigma_yaw_rad=0.01, refined=True)
        return Fit(FitResult.ACCEPTED, placement)


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> Fits:
    found = Fits()
    monkeypatch.setattr(neighbour_module, "fit", found.fit)
    return found


class Aligned:
    """A map with one neighbour, whose wall is at 10 m, and fits every two seconds from 2 s on."""

    def __init__(self, fits: Fits, found: NeighbourMap | None = None) -> None:
        self.map, self.now_ns, self._fits = found or filled_map(), 0, fits

    def fit(self, *results: float | FitResult | Exception, own: OwnState = OWN) -> None:
        for result in results:
            self.now_ns += 2 * NS
            self._fits.next = result
            self.map.align(NO_PLANES, own, self.now_ns)

    def north_m(self, own: OwnState = OWN) -> list[float]:
        """Shift of each published wall, to 0.1 m."""
        return [round(float(x) - 10.0, 1) for x in self.map.obstacles(own, self.now_ns).planes[:, 0]]

    def placement(self) -> PlacementState:
        return self.map.obstacles(OWN, self.now_ns).neighbours[0].placement


def test_one_fit_does_not_count_and_two_that_agree_do(fits: Fits) -> None:
    one = Aligned(fits)
    one.fit(0.5)
    assert (one.placement(), one.north_m()) == (PlacementState.BY_POSITION, [0.0])
    one.fit(0.7)
    assert (one.placement(), one.north_m()) == (PlacementState.ALIGNED, [0.7])
    assert one.map.obstacles(OWN, one.now_ns).aligned.tolist() == [1]


def test_two_fits_that_differ_do_not_count(fits: Fits) -> None:
    one = Aligned(fits)
    one.fit(0.0, 2.0, 0.0, 2.0)
    assert one.placement() is PlacementState.BY_POSITION


@pytest.mark.parametrize("between", [FitResult.AMBIGUOUS, FitResult.TOO_LITTLE])
def test_the_two_fits_must_be_consecutive(fits: Fits, between: FitResult) -> None:
    one = Aligned(fits)
    one.fit(0.5, between, 0.5)
    assert one.placement() is PlacementState.BY_POSITION


def test_an_alignment_follows_fits_that_agree_with_it(fits: Fits) -> None:
    one = Aligned(fits)
    one.fit(0.5, 0.5, 0.9, 1.3)
    assert one.north_m() == [1.3]


@pytest.mark.parametrize("wrong", [5.0, FitResult.AMBIGUOUS, FitResult.INCONSISTENT, FitResult.AGAINST_POSITION])
def test_two_contradictions_in_a_row_drop_an_alignment(fits: Fits, wrong: float | FitResult) -> None:
    one = Aligned(fits)
    one.fit(0.5, 0.5, wrong, 0.5, wrong)
    assert one.placement() is PlacementState.ALIGNED
    one.fit(FitResult.INCONSISTENT)
    assert one.placement() is PlacementState.BY_POSITION


def test_too_few_planes_are_no_contradiction_but_thirty_seconds_are(fits: Fits) -> None:
    one = Aligned(fits)
    one.fit(0.5, 0.5)
    begun_ns = one.now_ns
    while one.now_ns + 2 * NS <= begun_ns + KEEP_FIT_NS:
        one.fit(FitResult.TOO_LITTLE)
        assert one.placement() is PlacementState.ALIGNED
    one.fit(FitResult.TOO_LITTLE)
    assert one.placement() is PlacementState.BY_POSITION


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("singular"), ValueError("empty"), ZeroDivisionError()])
def test_a_fit_that_cannot_be_computed_is_reported(fits: Fits, error: Exception) -> None:
    one = Aligned(fits)
    one.fit(error)
    assert one.map.obstacles(OWN, one.now_ns).neighbours[0].fit == "failed"
    assert one.placement() is PlacementState.BY_POSITION


def test_without_align_nothing_is_fitted(fits: Fits) -> None:
    found = NeighbourMap(1, SharingParams(align=False))
    found.receive(state_at(0), NS)
    found.receive(wall_packet(1), NS)
    one = Aligned(fits, found)
    one.fit(0.5, 0.5)
    assert one.map.obstacles(OWN, one.now_ns).neighbours[0].fit == ""


@pytest.mark.parametrize("kind", ["section", "origin"])
def test_a_jump_of_the_own_position_drops_all_alignments(fits: Fits, kind: str) -> None:
    """Also those of frames that the neighbour has left."""
    one = Aligned(fits)
    one.fit(0.5, 0.5)
    sent_ms = one.now_ns // 1_000_000
    one.map.receive(planes_packet(header(sent_ms, section=1), wall(1), (0.0, 0.0, 0.0)), one.now_ns)
    one.map.receive(state_packet(header(sent_ms + 1, section=1), state()), one.now_ns)
    assert one.north_m() == [0.0, 0.5]  # the new frame by position, the old one as it was aligned
    one.fit(0.7, 0.7)
    assert one.north_m() == [0.7, 0.5]
    assert OWN.state is not None
    moved = replace(FRAME, altitude_m=FRAME.altitude_m + 1.0)
    jumped = replace(OWN, section=2) if kind == "section" else replace(OWN, state=replace(OWN.state, frame=moved))
    assert one.north_m(jumped) == [0.0, 0.0]


@pytest.mark.parametrize("jumped", [replace(OWN, section=2), replace(OWN, estimate=(1,))], ids=["section", "estimate"])
def test_no_vehicle_is_aligned_after_a_jump_of_the_own_position(fits: Fits, jumped: OwnState) -> None:
    """What is observed at the place of an aligned vehicle is not sent."""
    one = Aligned(fits)
    one.fit(0.5, 0.5)
    one.map.receive(state_at(one.now_ns // 1_000_000), one.now_ns)
    assert [body.is_aligned for body in one.map.bodies(OWN, one.now_ns)] == [False, True]
    assert [body.is_aligned for body in one.map.bodies(jumped, one.now_ns)] == [False, False]


def test_a_loss_of_the_own_position_drops_all_alignments(fits: Fits) -> None:
    """It may have jumped meanwhile."""
    one = Aligned(fits)
    one.fit(0.5, 0.5)
    assert one.north_m(replace(OWN, state=None)) == []
    assert one.placement() is PlacementState.BY_POSITION


def test_a_fit_before_a_jump_of_the_own_position_confirms_none_after_it(fits: Fits) -> None:
    one = Aligned(fits)
    one.fit(0.5)
    after = replace(OWN, section=OWN.section + 1)
    one.fit(0.5, own=after)
    assert one.north_m(after) == [0.0]
    one.fit(0.5, own=after)
    assert one.north_m(after) == [0.5]


def test_a_jump_of_the_neighbour_begins_without_alignment(fits: Fits) -> None:
    """A single fit after it does not count: the fit before belongs to another frame."""
    one = Aligned(fits)
    one.fit(0.5)
    sent_ms = one.now_ns // 1_000_000
    one.map.receive(state_packet(header(sent_ms, section=1), state()), one.now_ns)
    one.map.receive(planes_packet(header(sent_ms + 1, section=1), wall(1), (0.0, 0.0, 0.0)), one.now_ns)
    one.fit(0.5)
    assert one.north_m()[0] == 0.0
    one.fit(0.5)
    assert one.north_m()[0] == 0.5


def test_an_alignment_of_a_former_frame_ends_as_that_of_the_present_one(fits: Fits) -> None:
    """Nothing confirms it any more. Its planes then stand by position, with a larger margin."""
    found = NeighbourMap(1, SharingParams(expire_s=300.0))
    assert found.receive(state_at(0), NS) == ""
    assert found.receive(wall_packet(1), NS) == ""
    one = Aligned(fits, found)
    one.fit(0.7, 0.7)
    confirmed_ns = one.now_ns
    sent_ms = one.now_ns // 1_000_000
    assert one.map.receive(state_packet(header(sent_ms, section=1), state()), one.now_ns) == ""
    one.now_ns = confirmed_ns + KEEP_FIT_NS
    assert one.map.obstacles(OWN, one.now_ns).aligned.tolist() == [1]
    one.now_ns += 1
    got = one.map.obstacles(OWN, one.now_ns)
    assert (got.aligned.tolist(), one.north_m()) == ([0], [0.0])
