"""Samples that arrive late, as by UDP, around a jump of the autopilot's estimate."""

from __future__ import annotations

import math

import pytest

from companion.config.sync import SyncParams
from companion.pipeline.sync import AttitudeAt, PoseAt, Source, Synchroniser
from core.frames import quaternion_from_euler
from core.types import AttitudeSample, PoseSample

MS = 1_000_000
JUMP_RAD, JUMP_M = math.radians(90.0), 50.0


def attitude(t_ms: int, jumped: bool) -> AttitudeSample:
    q = quaternion_from_euler(0.0, 0.0, JUMP_RAD if jumped else 0.0)
    return AttitudeSample(t_ms * MS, t_ms * MS, q, (0.0, 0.0, 0.0))


def position(t_ms: int, jumped: bool) -> PoseSample:
    return PoseSample(t_ms * MS, t_ms * MS, (JUMP_M if jumped else 0.0, 0.0, -5.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("t_ms", range(90, 131))
@pytest.mark.parametrize("late_jumped", [True, False])
def test_no_attitude_is_between_those_before_and_after_a_jump(t_ms: int, late_jumped: bool) -> None:
    """100 before the jump, 120 after it; that of 110 is on either side, and arrives after 120."""
    sync = Synchroniser(SyncParams())
    for t, jumped in ((90, False), (100, False), (120, True), (110, late_jumped), (130, True)):
        sync.add(attitude(t, jumped))
    found = sync.attitude_at(t_ms * MS)
    assert isinstance(found, AttitudeAt)
    w, _, _, z = found.q_ned_frd_wxyz
    heading_rad = 2.0 * math.atan2(z, w)
    after = found.jump_ns == 120 * MS
    assert heading_rad == pytest.approx(JUMP_RAD if after else 0.0)
    assert found.turned_rad == pytest.approx(JUMP_RAD if after else 0.0)


@pytest.mark.parametrize("t_ms", range(90, 131))
@pytest.mark.parametrize("late_jumped", [True, False])
def test_no_position_is_between_those_before_and_after_a_jump(t_ms: int, late_jumped: bool) -> None:
    sync = Synchroniser(SyncParams())
    for t, jumped in ((90, False), (100, False), (120, True), (110, late_jumped), (130, True)):
        sync.add(position(t, jumped))
    found = sync.pose_at(t_ms * MS)
    assert isinstance(found, PoseAt)
    after = found.section.begins_ns == 120 * MS
    assert found.position_ned_m == pytest.approx((JUMP_M if after else 0.0, 0.0, -5.0))


def test_late_samples_without_a_jump_are_used() -> None:
    sync = Synchroniser(SyncParams())
    for t in (90, 100, 120, 110):
        sync.add(attitude(t, False))
        sync.add(position(t, False))
    assert [s.t_ns // MS for s in sync.attitudes.samples] == [90, 100, 110, 120]
    assert [s.t_ns // MS for s in sync.poses.samples] == [90, 100, 110, 120]
    assert sync.attitudes.counts["out_of_order"] == sync.poses.counts["out_of_order"] == 1
    found = sync.attitude_at(105 * MS)
    assert isinstance(found, AttitudeAt)
    assert found.source is Source.INTERPOLATED


def test_late_samples_that_are_not_used_are_counted() -> None:
    sync = Synchroniser(SyncParams())
    for t, jumped in ((90, False), (100, False), (120, True), (110, True)):
        sync.add(attitude(t, jumped))
        sync.add(position(t, jumped))
    assert sync.attitudes.counts["out_of_order"] == sync.poses.counts["out_of_order"] == 1
    assert [s.t_ns // MS for s in sync.attitudes.samples] == [90, 100, 120]
    assert [s.t_ns // MS for s in sync.poses.samples] == [90, 100, 120]
