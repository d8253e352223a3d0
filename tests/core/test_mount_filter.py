"""The filter distinguishes a mount error from terrain while the vehicle turns, and reports when it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core.frames import rotation_from_euler
from core.self_check.mount_check import (
    MountState,
    MountVerdict,
    checked,
    confirmed_by_ground,
    due,
    rotation_about,
    settled,
)
from core.self_check.mount_cues import NO_CUES, MountCues, Walls
from core.self_check.mount_filter import FilterState, MountFilter, slope_rows
from core.self_check.mount_params import MountCheckParams
from core.types import CameraMount

from ..nightly import nightly

NS = 1_000_000_000
P = MountCheckParams()


def run(
    mount_deg: tuple[float, float],
    terrain_deg: tuple[float, float],
    headings_deg: np.ndarray,
    walls: Walls = Walls.UNDECIDED,
    noise_deg: float = 0.1,
    jumps_deg: np.ndarray | None = None,
    stamps_ns: np.ndarray | None = None,
) -> list[MountState]:
    """States of a level vehicle that measures the slope ten times a second at these headings; mount: roll, pitch error, true
    minus configured; terrain: slope north, east. jumps_deg: error of the autopilot's heading in each measurement; stamps_ns: of
    the newest jump of the heading in each."""
    rng = np.random.default_rng(1)
    state, states = MountState(), []
    delta = np.radians([*mount_deg, 0.0])
    for i, heading in enumerate(np.radians(headings_deg)):
        R = rotation_from_euler(0.0, 0.0, heading)
        level = rotation_from_euler(0.0, 0.0, -heading) @ R
        s = slope_rows(level, heading) @ np.array([*delta, *np.radians(terrain_deg)])
        s += np.radians(rng.normal(0.0, noise_deg, 2))
        cues = MountCues(True, *s.tolist(), 2.0, walls=walls)
        estimated = heading + (0.0 if jumps_deg is None else math.radians(jumps_deg[i]))
        R_estimated = rotation_from_euler(0.0, 0.0, estimated)
        jump_ns = 0 if stamps_ns is None else int(stamps_ns[i])
        state = checked(state, i * NS // 10, cues, R_estimated, estimated, P, jump_ns)
        states.append(state)
    return states


JUMPED = np.arange(400) >= 100
"""After ten seconds the heading jumps; the vehicle does not turn."""
STILL = np.zeros(400)


@pytest.mark.parametrize("jump_deg", [30.0, *nightly(60.0, 90.0), 180.0])
@pytest.mark.parametrize("slope_deg", [2.0, *nightly(3.0, 5.0), 8.0])
def test_a_jump_of_the_heading_makes_no_mount_error_of_the_terrain(slope_deg: float, jump_deg: float) -> None:
    states = run((0.0, 0.0), (slope_deg, 0.0), STILL, jumps_deg=jump_deg * JUMPED, stamps_ns=NS * JUMPED)
    assert {s.verdict for s in states} <= {MountVerdict.UNKNOWN, MountVerdict.UNVERIFIED_SLOPE}
    assert min(np.degrees(states[-1].error_sd_rad)) > 5.0


@pytest.mark.parametrize("jump_deg", [45.0, *nightly(90.0, 180.0)])
def test_a_jump_of_the_heading_verifies_no_mount(jump_deg: float) -> None:
    """The terrain compensates the error of the mount. Only a turn of the vehicle shows it."""
    states = run((0.0, 5.0), (-5.0, 0.0), STILL, jumps_deg=jump_deg * JUMPED, stamps_ns=NS * JUMPED)
    assert {s.verdict for s in states} == {MountVerdict.UNKNOWN}
    headings = np.concatenate((STILL, np.linspace(0.0, 180.0, 200), np.full(300, 180.0)))
    jumped = np.arange(len(headings)) >= 100
    turned = run((0.0, 5.0), (-5.0, 0.0), headings, jumps_deg=jump_deg * jumped, stamps_ns=NS * jumped)[-1]
    assert turned.verdict is MountVerdict.ERROR
    assert np.degrees(turned.error_rad) == pytest.approx((0.0, 5.0), abs=0.7)


def test_gaps_of_the_attitude_are_no_evidence_of_the_mount() -> None:
    """In each the heading may have jumped. The same terrain after many of them says nothing new."""
    states = run((0.0, 0.0), (5.0, 0.0), np.zeros(1000), stamps_ns=1 + np.arange(1000))
    assert {s.verdict for s in states} <= {MountVerdict.UNKNOWN, MountVerdict.UNVERIFIED_SLOPE}
    assert min(np.degrees(states[-1].error_sd_rad)) > 9.9  # of 10 at the start
    assert max(map(abs, np.degrees(states[-1].error_rad))) < 0.1


def test_what_a_turn_has_shown_of_the_mount_outlives_a_jump() -> None:
    headings = np.concatenate((np.linspace(0.0, 120.0, 150), np.full(150, 120.0)))
    jumped = np.arange(300) >= 200
    for mount_deg, verdict in (((0.0, 0.0), MountVerdict.VERIFIED), ((0.0, 5.0), MountVerdict.ERROR)):
        states = run(mount_deg, (3.0, 0.0), headings, jumps_deg=70.0 * jumped, stamps_ns=NS * jumped)
        assert {s.verdict for s in states[190:]} == {verdict}


def test_ground_of_before_a_jump_confirms_no_mount() -> None:
    params = MountCheckParams(degraded_deg=3.0)
    level = run((0.0, 0.0), (0.0, 0.0), np.zeros(50))[-1]
    assert confirmed_by_ground(level, np.eye(3), 0.0, params)
    assert not confirmed_by_ground(level, np.eye(3), 0.0, params, NS)


def test_a_mount_error_is_measured_by_turning() -> None:
    state = run((0.0, 1.5), (0.0, 0.0), np.linspace(0.0, 90.0, 100))[-1]
    assert state.verdict is MountVerdict.DEGRADED
    assert np.degrees(state.error_rad) == pytest.approx((0.0, 1.5), abs=0.4)
    assert max(np.degrees(state.error_sd_rad)) < 0.4


def test_a_large_error_makes_frames_invalid_within_ten_measurements() -> None:
    for walls in Walls:
        states = run((0.0, 5.0), (0.0, 0.0), np.zeros(15), walls)
        if walls is not Walls.VERTICAL:
            assert all(s.verdict.invalid for s in states[9:]), walls


def test_walls_that_lean_give_the_error_without_turning() -> None:
    state = run((-6.0, 0.0), (0.0, 0.0), np.zeros(20), Walls.LEANING)[-1]
    assert state.verdict is MountVerdict.ERROR
    assert np.degrees(state.error_rad) == pytest.approx((-6.0, 0.0), abs=0.5)
    assert np.degrees(state.corrected(CameraMount(roll_rad=math.radians(6.0)))[0]) == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("slope", [(10.0, 0.0), (0.0, -7.0), (5.0, 5.0)])
def test_terrain_is_no_mount_error(slope: tuple[float, float]) -> None:
    still = run((0.0, 0.0), slope, np.zeros(30), Walls.VERTICAL)
    assert not any(s.verdict.invalid or s.verdict is MountVerdict.DEGRADED for s in still)
    turning = run((0.0, 0.0), slope, np.linspace(0.0, 120.0, 120))
    assert not any(s.verdict in (MountVerdict.DEGRADED, MountVerdict.ERROR) for s in turning)
    assert not turning[-1].verdict.invalid


def test_a_change_of_terrain_is_no_mount_error() -> None:
    """Level ground, then a slope of 8 degrees, while the vehicle weaves."""
    headings = 45.0 * np.sin(np.arange(300) / 15.0)
    state = MountState()
    for i, heading in enumerate(np.radians(headings)):
        R = rotation_from_euler(0.0, 0.0, heading)
        terrain = np.radians([0.0, 8.0]) if i > 150 else np.zeros(2)
        s = slope_rows(np.eye(3), heading)[:, 3:] @ terrain
        state = checked(state, i * NS // 10, MountCues(True, *s.tolist(), 2.0), R, heading, P)
        assert state.verdict not in (MountVerdict.DEGRADED, MountVerdict.ERROR), i
    assert not state.verdict.invalid


@pytest.mark.parametrize("sway_deg", [30.0, 60.0])
def test_rolling_terrain_is_no_mount_error(sway_deg: float) -> None:
    """Its slope of 8 degrees turns once in 13 s while the vehicle weaves: for a while a wrong mount explains it as well."""
    phase = np.arange(600) / 20.0
    state = MountState()
    for i, heading in enumerate(np.radians(sway_deg) * np.sin(phase)):
        R = rotation_from_euler(0.0, 0.0, heading)
        s = slope_rows(np.eye(3), heading)[:, 3:] @ (np.radians(8.0) * np.array([np.sin(phase[i]), np.cos(phase[i])]))
        state = checked(state, i * NS // 10, MountCues(True, *s.tolist(), 2.0), R, heading, P)
        assert state.verdict is not MountVerdict.ERROR, i


def estimated(mount_deg: float, verdict: MountVerdict, confirmations: int = 0) -> MountState:
    """The state in which the pitch error of the mount is known to 0.1 degrees, on terrain that is not known."""
    sds = np.radians([0.1, 0.1, 3.0, 10.0, 10.0])
    known = FilterState(
        (0.0, math.radians(mount_deg), 0.0, 0.0, 0.0), tuple(np.diag(sds**2)[np.triu_indices(5)].tolist())
    )
    return MountState(t_ns=0, measurements=50, verdict=verdict, confirmations=confirmations, filter=known)


def after(state: MountState, slope_deg: float, frames: int = 10) -> list[MountState]:
    """The states of a vehicle that does not turn and measures this slope ahead."""
    states = []
    for i in range(1, frames + 1):
        cues = MountCues(True, math.radians(slope_deg), 0.0, 2.0)
        state = checked(state, i * NS // 10, cues, np.eye(3), 0.0, P)
        states.append(state)
    return states


@pytest.mark.parametrize(("mount_deg", "kept"), [(2.7, True), (2.2, False)])
def test_a_reported_error_is_kept_down_to_four_fifths_of_the_threshold(mount_deg: float, kept: bool) -> None:
    """From one confirmation on: frames do not become valid and invalid again with the noise of the estimate."""
    states = after(estimated(mount_deg, MountVerdict.ERROR), mount_deg)
    assert all(s.verdict is MountVerdict.ERROR for s in states[:2])
    assert (states[-1].verdict is MountVerdict.ERROR) is kept
    assert all(s.verdict is not MountVerdict.ERROR for s in after(estimated(2.7, MountVerdict.DEGRADED, 99), 2.7))


@pytest.mark.parametrize("mount_deg", [-6.0, 6.0])
def test_a_slope_is_not_the_terrains_where_the_mount_is_wrong_to_either_side(mount_deg: float) -> None:
    """Ground that appears inclined by 5 degrees: the terrain compensates the error, or exceeds it."""
    states = after(estimated(mount_deg, MountVerdict.UNKNOWN), 5.0)
    assert all(s.verdict.invalid for s in states[2:])


def test_a_verdict_changes_only_after_measurements_in_a_row_that_agree() -> None:
    valid, steep, wrong = MountVerdict.VERIFIED, MountVerdict.UNVERIFIED_SLOPE, MountVerdict.ERROR
    twice = MountState(verdict=valid, pending=MountVerdict.DEGRADED, streak=2)
    assert settled(twice, steep) == (valid, steep, 1)
    assert settled(MountState(verdict=valid, pending=steep, streak=2), wrong) == (wrong, wrong, 0), "both invalidate"
    assert settled(MountState(verdict=steep, pending=MountVerdict.UNKNOWN, streak=2), valid) == (valid, valid, 0)
    assert settled(MountState(verdict=steep, pending=wrong, streak=2), valid) == (steep, valid, 1)


def test_a_mount_that_moves_in_flight_is_found_again() -> None:
    headings = 60.0 * np.sin(np.arange(600) / 15.0)
    state = MountState()
    for i, heading in enumerate(np.radians(headings)):
        R = rotation_from_euler(0.0, 0.0, heading)
        delta = np.radians([0.0, 6.0 if i > 200 else 0.0, 0.0])
        s = slope_rows(np.eye(3), heading)[:, :3] @ delta
        state = checked(state, i * NS // 10, MountCues(True, *s.tolist(), 2.0), R, heading, P)
    assert state.verdict is MountVerdict.ERROR


def test_at_one_heading_small_slopes_are_not_used() -> None:
    state = run((0.0, 2.0), (0.0, 0.0), np.zeros(100))[-1]
    assert state.verdict is MountVerdict.UNKNOWN
    assert min(np.degrees(state.error_sd_rad)) > 3.0


def test_a_verdict_needs_several_measurements() -> None:
    states = run((0.0, 8.0), (0.0, 0.0), np.zeros(5))
    assert [s.verdict for s in states[:2]] == [MountVerdict.UNKNOWN] * 2
    assert states[2].verdict is MountVerdict.UNVERIFIED_SLOPE


@pytest.mark.parametrize(("pause_s", "confirmed"), [(1.0, True), (3600.0, False), (86400.0, False)])
def test_ground_before_a_long_pause_confirms_no_mount(pause_s: float, confirmed: bool) -> None:
    """The vehicle may have flown to other terrain since, however wide the limit of the error is."""
    params = MountCheckParams(degraded_deg=3.0)
    level = run((0.0, 0.0), (0.0, 0.0), np.zeros(50))[-1]
    assert level.t_ns is not None
    later = checked(level, level.t_ns + round(pause_s * NS), NO_CUES, np.eye(3), 0.0, params)
    assert later.verdict is MountVerdict.UNKNOWN
    assert confirmed_by_ground(later, np.eye(3), 0.0, params) is confirmed


@pytest.mark.parametrize(("slope_deg", "longest_s"), [(0.0, 22.6), (0.3, 10.3), (0.7, 0.7)])
def test_ground_that_appears_inclined_confirms_a_mount_for_a_shorter_time(slope_deg: float, longest_s: float) -> None:
    """The times that docs/explanation/open-space.md states."""
    state = run((0.0, 0.0), (slope_deg, 0.0), np.zeros(200), noise_deg=0.0)[-1]
    lasted = 0
    while confirmed_by_ground(state, np.eye(3), 0.0, P) and lasted < 1000:
        assert state.t_ns is not None
        state = checked(state, state.t_ns + NS // 10, NO_CUES, np.eye(3), 0.0, P)
        lasted += 1
    assert lasted / 10 == pytest.approx(longest_s, abs=0.3)


@pytest.mark.parametrize("diagonal", [False, True])
def test_ground_confirms_a_mount_by_the_least_certain_direction(diagonal: bool) -> None:
    """The same uncertainty along x or along a diagonal of the level axes: 0.5 degrees, of which two sigma are 1 degree."""
    covariance = np.diag([1e-12] * 5)
    axis = np.array([1.0, 1.0]) / math.sqrt(2.0) if diagonal else np.array([1.0, 0.0])
    covariance[3:, 3:] += math.radians(0.51) ** 2 * np.outer(axis, axis)
    state = MountState(filter=FilterState(covariance=tuple(covariance[np.triu_indices(5)].tolist())))
    assert not confirmed_by_ground(state, np.eye(3), 0.0, MountCheckParams(degraded_deg=1.0))


def test_the_state_packs_and_unpacks() -> None:
    f = MountFilter(FilterState())
    f.predict(0.1, 0.01)
    f.slope(slope_rows(np.eye(3), 0.3), (0.1, -0.05))
    again = MountFilter(f.state())
    assert (again.P == f.P).all()
    assert (again.mean == f.mean).all()
    assert (np.linalg.eigvalsh(f.P) > 0.0).all()


def test_time_makes_the_mount_uncertain_up_to_its_limit_and_no_other_state_certain() -> None:
    """A mount that is known to 0.1 degrees loosens for a minute at most; its terrain changes in any time."""
    known = np.radians([0.1, 0.1, 0.1, 0.1, 0.1]) ** 2
    minute = math.radians(0.02) ** 2 * 60.0
    limits = np.radians([10.0, 10.0, 3.0, 10.0, 10.0]) ** 2

    def variances(start: np.ndarray, *steps_s: float, walk_deg: float = 0.1) -> np.ndarray:
        f = MountFilter(FilterState(covariance=tuple(np.diag(start)[np.triu_indices(5)].tolist())))
        for step_s in steps_s:
            f.predict(step_s, math.radians(walk_deg))
        assert np.count_nonzero(f.P) == np.count_nonzero(np.diag(f.P)), "no correlation by time"
        assert not f.mean.any()
        return np.diag(f.P)

    walked = math.radians(0.1) ** 2
    assert variances(known, 1.0) - known == pytest.approx([minute / 60.0] * 3 + [walked] * 2)
    assert variances(known, 1000.0) - known == pytest.approx([minute] * 3 + [1000.0 * walked] * 2)
    assert (variances(known, -5.0) == known).all(), "a stamp of before"
    assert variances(known, *[60.0] * 10000, walk_deg=1.0) == pytest.approx(limits)
    beyond = limits * 2.0
    assert variances(beyond, 60.0) == pytest.approx(beyond), "a forgotten terrain stays forgotten"


def test_measurements_are_due_by_exposure_times() -> None:
    state = MountState()
    assert due(state, 0, P)
    state = MountState(t_ns=NS, measurements=10)
    assert not due(state, NS + NS // 20, P)
    assert due(state, NS + NS // 10, P)
    assert not due(MountState(), 0, MountCheckParams(enabled=False))
    assert due(MountState(), 0, P, math.radians(14.9))
    assert not due(MountState(), 0, P, math.radians(15.1))


def test_parameters_check_themselves() -> None:
    with pytest.raises(ValueError, match="invalid_deg"):
        MountCheckParams(degraded_deg=4.0, invalid_deg=3.0)


def test_rotation_about_a_vector() -> None:
    assert rotation_about(0.0, 0.3, 0.0) == pytest.approx(rotation_from_euler(0.0, 0.3, 0.0))
    assert rotation_about(0.0, 0.0, 0.0) == pytest.approx(np.eye(3))


@pytest.mark.parametrize("mount", [(0.0, 5.0), (-5.0, 0.0), (4.0, -4.0)])
def test_no_frame_becomes_valid_while_a_large_error_is_being_measured(mount: tuple[float, float]) -> None:
    """A slow turn makes the error known step by step."""
    states = run(mount, (0.0, 0.0), np.linspace(0.0, 60.0, 200))
    assert all(s.verdict.invalid for s in states[9:])
    assert states[-1].verdict is MountVerdict.ERROR
