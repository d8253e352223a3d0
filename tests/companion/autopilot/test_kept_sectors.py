"""A sector that one frame does not see: when it stays as it was, and when it is unseen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.autopilot.obstacle_distance import UNKNOWN
from companion.autopilot.obstacle_report import CameraUse
from companion.autopilot.polar_histogram import SECTORS, SectorScan, SectorState, centres_rad
from companion.autopilot.report_builder import ObstacleReportBuilder
from companion.autopilot.seen_sectors import SectorSight, SeenSectors
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.types import AttitudeSample, FrameModel

from ..hovering import CLEAR_CM, after_ten, one_frame, pole, seeing
from ..report_chain import ARDUPILOT, AVOID, CAMERA, CLEAR, NS, PX4, Chain, Sees, frame
from ..sector_models import model

BLOCKED = model(free_to_m=4.0, view_deg=72.0)


@pytest.mark.parametrize(("autopilot", "unseen"), [(PX4, UNKNOWN), (ARDUPILOT, 370)])
def test_a_sector_that_one_frame_does_not_see_stays_as_it_was(autopilot: object, unseen: int) -> None:
    chain = seeing()
    one_frame(chain, BLOCKED)
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, CLEAR)
    assert chain.ahead(autopilot) == CLEAR_CM
    one_frame(chain, BLOCKED)
    one_frame(chain, BLOCKED)
    assert chain.ahead(autopilot) == unseen
    for _ in range(5):  # and it does not come back by what was seen before
        one_frame(chain, BLOCKED)
        assert chain.ahead(autopilot) == unseen


@pytest.mark.parametrize(("autopilot", "unseen"), [(PX4, UNKNOWN), (ARDUPILOT, 370)])
def test_a_sector_that_every_second_frame_does_not_see_is_unseen_from_the_second_loss_on(
    autopilot: object, unseen: int
) -> None:
    chain = seeing()
    one_frame(chain, BLOCKED)
    assert chain.ahead(autopilot) == CLEAR_CM
    for _ in range(5):
        one_frame(chain, CLEAR)
        assert chain.ahead(autopilot) == CLEAR_CM
        one_frame(chain, BLOCKED)
        assert chain.ahead(autopilot) == unseen


def test_a_sector_is_kept_again_after_three_frames_that_saw_it() -> None:
    chain = seeing()
    one_frame(chain, BLOCKED)
    for frames, ahead in ((2, UNKNOWN), (3, CLEAR_CM)):
        for _ in range(frames):
            one_frame(chain, CLEAR)
        one_frame(chain, BLOCKED)
        assert chain.ahead() == ahead


def ends_at(free_to_m: float) -> FrameModel:
    """Nothing but free space, to the same distance everywhere."""
    return replace(model(free_to_m=free_to_m, view_deg=72.0), planes=CLEAR.planes, support_px=CLEAR.support_px)


def test_a_sector_lost_at_another_place_is_kept_after_one_frame_that_saw_it() -> None:
    chain = seeing()
    for free_to_m, ahead in ((5.0, CLEAR_CM), (7.0, CLEAR_CM), (5.0, UNKNOWN), (8.0, UNKNOWN)):
        one_frame(chain, ends_at(free_to_m))
        assert chain.ahead() == ahead, "two of eight frames"
        one_frame(chain, CLEAR)
        assert chain.ahead() == CLEAR_CM


def test_two_losses_of_all_rays_in_a_row_are_never_kept() -> None:
    chain = seeing()
    one_frame(chain, ends_at(5.0))
    assert chain.ahead() == CLEAR_CM
    for free_to_m in (7.0, 9.0, 4.0):
        one_frame(chain, ends_at(free_to_m))
        assert chain.ahead() == UNKNOWN
    # and then three frames must see it again, wherever it was lost
    one_frame(chain, CLEAR)
    one_frame(chain, ends_at(6.0))
    assert chain.ahead() == UNKNOWN


def test_a_sector_lost_at_the_same_place_again_is_not_kept() -> None:
    chain = seeing()
    for n, free_to_m in enumerate((5.0, 5.3)):
        one_frame(chain, ends_at(free_to_m))
        assert chain.ahead() == (CLEAR_CM if n == 0 else UNKNOWN)
        one_frame(chain, CLEAR)


def test_a_kept_sector_is_gone_when_no_further_frame_comes() -> None:
    chain = seeing()
    one_frame(chain, BLOCKED)
    assert chain.ahead() == CLEAR_CM
    chain.fly(0.04, frames=False)
    assert chain.ahead() == CLEAR_CM
    chain.fly(0.02, frames=False)
    assert chain.ahead() == UNKNOWN, "160 ms after it was last seen"
    assert not chain.report().blind


def test_a_sector_is_not_kept_after_a_missing_frame() -> None:
    chain = seeing()
    chain.fly(0.1, frames=False)
    one_frame(chain, BLOCKED)
    assert chain.ahead() == UNKNOWN


def test_confirm_px_0_keeps_nothing() -> None:
    chain = Chain(CLEAR, replace(AVOID, confirm_px=0))
    for _ in range(10):
        one_frame(chain, CLEAR)
    one_frame(chain, BLOCKED)
    assert chain.ahead() == UNKNOWN


def scan_of(state: SectorState, distance_m: float = np.inf, heights: range = range(0)) -> SectorScan:
    """All sectors alike. heights: of AVOID.slices, those at which no ray was seen."""
    whole = np.full(SECTORS, state, np.uint8)
    lacking = np.zeros((SECTORS, AVOID.slices, AVOID.rays), np.bool_)
    lacking[:, list(heights)] = True
    return SectorScan(whole, np.full(SECTORS, distance_m), np.full(SECTORS, 12.0), centres_rad(), lacking)


def taken(
    lost: dict[str, object],
    distance_m: float = np.inf,
    speed_m_s: float | None = 0.0,
    frames: int = 5,
    found: SectorScan | None = None,
) -> SectorScan:
    """Frames at 10 Hz that see all sectors, then one that sees none. lost: what differs in its SectorSight; found: its scan,
    None: without any plane."""
    kept, nowhere = SeenSectors(AVOID), np.zeros(SECTORS, np.bool_)
    state = SectorState.CLEAR if distance_m == np.inf else SectorState.OBSTACLE
    for n in range(1, frames + 1):
        t_ns = n * NS // 10
        before = SectorSight(np.full(SECTORS, t_ns), nowhere, 0.0, speed_m_s, t_ns)
        kept.take(scan_of(state, distance_m), before)
    t_ns = (frames + 1) * NS // 10
    now = SectorSight(np.full(SECTORS, t_ns), nowhere, 0.0, speed_m_s, t_ns)
    return kept.take(scan_of(SectorState.UNSEEN) if found is None else found, replace(now, **lost))


@pytest.mark.parametrize(("speed_m_s", "state"), [(0.0, SectorState.CLEAR), (2.0, SectorState.UNSEEN)])
def test_a_sector_lost_nearer_by_the_way_flown_is_lost_at_the_same_place(speed_m_s: float, state: SectorState) -> None:
    kept, nowhere = SeenSectors(AVOID), np.zeros(SECTORS, np.bool_)
    for n, ends_m in enumerate((12.0, 12.0, 12.0, 5.0, 12.0, 4.3), 1):
        found = replace(
            scan_of(SectorState.CLEAR if ends_m == 12.0 else SectorState.UNSEEN), free_m=np.full(SECTORS, ends_m)
        )
        taken = kept.take(found, SectorSight(np.full(SECTORS, n * NS // 10), nowhere, 0.0, speed_m_s, n * NS // 10))
    assert (taken.state == state).all()


ALL, UPPER, LOWER = range(10), range(4), range(5, 10)


def after(
    *frames: range | None, interval_ns: int = NS // 12, speed_m_s: float = 0.0, down_m_s: float | None = 0.0
) -> SectorState:
    """State of the sectors after these frames, in order. Each names the heights that it does not see; None: it sees all, and
    an empty range is a loss with another cause than its rays."""
    kept, nowhere, state = SeenSectors(AVOID), np.zeros(SECTORS, np.bool_), SectorState.UNSEEN
    for n, heights in enumerate(frames, 1):
        t_ns = n * interval_ns
        found = scan_of(SectorState.CLEAR) if heights is None else scan_of(SectorState.UNSEEN, heights=heights)
        now = SectorSight(np.full(SECTORS, t_ns), nowhere, 0.0, speed_m_s, t_ns, down_m_s)
        state = SectorState(int(kept.take(found, now).state[0]))
    return state


@pytest.mark.parametrize("interval_ns", [NS // 15, NS // 12, NS // 10])
def test_two_losses_in_a_row_at_different_heights_are_two_mismatches(interval_ns: int) -> None:
    """Holes and mismatches are at another place in each frame; a thing is at the same heights in both."""
    assert after(None, None, None, UPPER, LOWER, interval_ns=interval_ns) == SectorState.CLEAR
    assert after(None, None, None, LOWER, UPPER, interval_ns=interval_ns) == SectorState.CLEAR


@pytest.mark.parametrize(
    ("first", "second"),
    [(UPPER, UPPER), (ALL, UPPER), (UPPER, ALL), (ALL, ALL), (UPPER, range(1, 5)), (range(2, 6), range(4, 8))],
)
def test_two_losses_in_a_row_with_heights_in_common_are_an_unseen_sector(first: range, second: range) -> None:
    assert after(None, None, None, first, second) == SectorState.UNSEEN


def test_a_loss_without_rays_that_lack_is_no_mismatch() -> None:
    """The ground within the band of height ends a sector although its rays were seen."""
    assert after(None, None, None, UPPER, range(0)) == SectorState.UNSEEN
    assert after(None, None, None, range(0), UPPER) == SectorState.UNSEEN


def test_the_third_loss_in_a_row_is_never_kept() -> None:
    assert after(None, None, None, UPPER, LOWER, UPPER) == SectorState.UNSEEN
    assert after(None, None, None, UPPER, LOWER, None, UPPER) == SectorState.UNSEEN, "three frames must see it again"


def test_a_second_loss_is_kept_only_after_three_frames_that_saw_the_sector() -> None:
    assert after(None, None, None, UPPER, None, LOWER, UPPER) == SectorState.UNSEEN


def test_other_heights_do_not_keep_a_sector_after_one_frame_that_saw_it() -> None:
    assert after(None, None, None, UPPER, None, LOWER) == SectorState.UNSEEN


@pytest.mark.parametrize("period", [2, 3, 4, 5, 6])
def test_what_is_lost_again_and_again_is_an_unseen_sector(period: int) -> None:
    """At heights that alternate: in eight frames in a row at most two losses are bridged."""
    frames: list[range | None] = [None, None, None]
    states = []
    for n in range(24):
        frames.append((UPPER, LOWER)[(n // period) % 2] if n % period == 0 else None)
        states.append((frames[-1] is not None, after(*frames)))
    kept = [lost and state == SectorState.CLEAR for lost, state in states]
    assert all(sum(kept[n : n + 8]) <= 2 for n in range(len(kept) - 7))


@pytest.mark.parametrize(
    ("speed_m_s", "state"), [(0.0, SectorState.CLEAR), (2.0, SectorState.CLEAR), (8.0, SectorState.UNSEEN)]
)
def test_a_kept_sector_is_clear_only_as_far_as_it_was_seen(speed_m_s: float, state: SectorState) -> None:
    """The vehicle has flown 0.17 or 0.67 m towards the end of what was seen free."""
    assert after(None, None, None, UPPER, speed_m_s=speed_m_s) == state


@pytest.mark.parametrize(
    ("down_m_s", "state"), [(0.5, SectorState.CLEAR), (-1.2, SectorState.UNSEEN), (None, SectorState.UNSEEN)]
)
def test_heights_are_not_compared_in_a_climb_or_descent(down_m_s: float | None, state: SectorState) -> None:
    """0.04 m and 0.1 m between two frames; half of a height is 0.08 m."""
    assert after(None, None, None, UPPER, LOWER, down_m_s=down_m_s) == state


def test_a_second_loss_after_a_missing_frame_is_not_kept() -> None:
    assert after(None, None, None, UPPER, LOWER, interval_ns=NS // 6) == SectorState.UNSEEN


def test_a_sector_that_a_blind_camera_covers_is_not_kept() -> None:
    blind = np.arange(SECTORS) < 3
    state = taken({"blind": blind}).state
    assert (state[blind] == SectorState.UNSEEN).all()
    assert (state[~blind] == SectorState.CLEAR).all()


@pytest.mark.parametrize(("later_ms", "state"), [(40, SectorState.CLEAR), (60, SectorState.UNSEEN)])
def test_what_was_seen_is_kept_by_its_exposure_not_by_its_arrival(later_ms: int, state: SectorState) -> None:
    """Frames that were delayed arrive one after the other. The sector was seen 140 or 160 ms before this exposure."""
    exposed_ns = np.full(SECTORS, 6 * NS // 10 + later_ms * NS // 1000)
    assert (taken({"exposed_ns": exposed_ns}).state == state).all()


def states_at(*times_ms: int, blind_until_ms: int = 0) -> SectorState:
    """State after frames at these times, of which the last does not see the sectors and the others do. A blind camera covers
    them, too, until the given time."""
    kept, state = SeenSectors(AVOID), SectorState.UNSEEN
    for t_ms in times_ms:
        t_ns, blind = t_ms * NS // 1000, np.full(SECTORS, t_ms <= blind_until_ms)
        found = scan_of(SectorState.UNSEEN if t_ms == times_ms[-1] else SectorState.CLEAR)
        state = SectorState(int(kept.take(found, SectorSight(np.full(SECTORS, t_ns), blind, 0.0, 0.0, t_ns)).state[0]))
    return state


def test_frames_before_a_missing_one_do_not_count_in_a_row() -> None:
    assert states_at(100, 200, 300, 400, 500) == SectorState.CLEAR
    assert states_at(100, 200, 400, 500) == SectorState.UNSEEN


def test_frames_that_saw_a_sector_beside_a_blind_camera_do_not_count_in_a_row() -> None:
    assert states_at(100, 200, 300, 400) == SectorState.CLEAR
    assert states_at(100, 200, 300, 400, blind_until_ms=100) == SectorState.UNSEEN


@pytest.mark.parametrize(("frames", "state"), [(2, SectorState.UNSEEN), (3, SectorState.CLEAR)])
def test_a_sector_is_kept_only_after_three_frames(frames: int, state: SectorState) -> None:
    assert (taken({}, frames=frames).state == state).all()


@pytest.mark.parametrize(("speed_m_s", "left_m"), [(0.0, 5.0), (8.0, 4.2), (None, 3.0)])
def test_a_kept_distance_is_shortened_by_the_way_flown(speed_m_s: float | None, left_m: float) -> None:
    """Without a velocity by the greatest plausible speed, 20 m/s."""
    assert taken({}, 5.0, speed_m_s).distance_m == pytest.approx(left_m)


def test_a_nearer_plane_in_a_kept_sector_counts() -> None:
    """The sector is not seen now, but a plane 3 m away is."""
    assert taken({}, 5.0, found=scan_of(SectorState.UNSEEN, 3.0)).distance_m == pytest.approx(3.0)
    assert taken({}, 5.0, found=scan_of(SectorState.UNSEEN, 7.0)).distance_m == pytest.approx(5.0)


def test_a_camera_that_goes_blind_ends_what_it_shares_with_another_one() -> None:
    both = TwoCameras()
    both.fly(10, CLEAR, CLEAR)
    assert both.ahead() == CLEAR_CM
    both.fly(1, None, BLOCKED)
    assert both.ahead() != CLEAR_CM


class TwoCameras:
    """Two cameras that look into the same sectors, each with frames at 10 Hz. No attitude is missing, the vehicle hovers."""

    def __init__(self) -> None:
        self.sees = {name: Sees(CLEAR) for name in ("a", "b")}
        self.infos = tuple(replace(CAMERA, camera=name) for name in self.sees)
        self.pipeline = Pipeline(self.infos, lambda info: self.sees[info.camera])
        self.builder = ObstacleReportBuilder(AVOID, CameraUse(cameras=tuple(self.sees), timeout_s=0.3))
        for info in self.infos:
            self.builder.announce(info)
        self.now_ns, self.sequence = 10 * NS, 0

    def fly(self, frames: int, *found: FrameModel | None) -> None:
        """found: of each camera; None: its frames are not valid."""
        for _ in range(frames):
            self.now_ns += NS // 10
            self.sequence += 1
            sample = AttitudeSample(self.now_ns, self.now_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            self.pipeline.handle(sample)
            self.builder.samples([sample])
            for (name, sees), shown in zip(self.sees.items(), found, strict=True):
                sees.found = replace(CLEAR, valid=False) if shown is None else shown
                image = replace(frame(self.sequence, self.now_ns, self.now_ns), camera=name)
                for output in self.pipeline.handle(image):
                    if isinstance(output, PrismsResult):
                        self.builder.result(output)
            self.ahead()

    def ahead(self) -> int:
        values = self.builder.decide(PX4, self.now_ns).values
        assert values is not None
        return int(values[0])


def test_a_sector_that_was_never_seen_is_not_seen() -> None:
    chain = Chain(BLOCKED)
    for _ in range(8):
        chain.fly(0.1)
        assert chain.ahead() == UNKNOWN


def test_an_obstacle_that_one_frame_loses_stays_where_it_was() -> None:
    chain = after_ten(pole(5.0, 500))
    assert chain.ahead() == 470
    one_frame(chain, BLOCKED)
    assert chain.ahead() == 470


def test_what_was_seen_is_not_kept_when_the_vehicle_turns() -> None:
    chain = seeing()
    chain.yaw_rad = 0.05
    one_frame(chain, BLOCKED)
    assert chain.ahead() == UNKNOWN
