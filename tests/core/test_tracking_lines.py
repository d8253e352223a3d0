"""Fragments of a thin obstacle become one long track; nothing that a frame detects is lost by that."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from core.tracking.snapshot import TrackingFrame, TrackSnapshot
from core.tracking.tracker import Tracker

from .tracked import SMALL, frame, without_position
from .worlds import wall

Floats = NDArray[np.float32]
SIGMA_M, MARGIN_M = 0.6, 1.2
"""Of the ends of a fragment along the viewing ray; 95 % lie within the margin."""
WIRE = wall(12.0, -7.0, 12.0, 7.0, -0.55, -0.45)
BEHIND = wall(18.0, -16.0, 18.0, 16.0)


def fragments(wire: list[float], rng: np.random.Generator, sigma_m: float = SIGMA_M) -> list[list[float]]:
    """A wire in pieces, as a frame with strong noise has it: its ends lie on the true viewing rays at wrong ranges, by up to
    two standard deviations."""
    ax, ay, bx, by, top, bottom = wire
    cuts = np.sort(rng.uniform(0.0, 1.0, 7))
    out = []
    for s0, s1 in zip([0.0, *cuts], [*cuts, 1.0], strict=True):
        if s1 - s0 < 0.01:
            continue
        ends = [(ax + s * (bx - ax), ay + s * (by - ay)) for s in (s0, s1)]
        far = [1.0 + np.clip(rng.normal(0.0, sigma_m), -2 * sigma_m, 2 * sigma_m) / math.hypot(x, y) for x, y in ends]
        (x0, y0), (x1, y1) = ((f * x, f * y) for f, (x, y) in zip(far, ends, strict=True))
        mean = 0.5 * (far[0] + far[1])
        out.append([x0, y0, x1, y1, mean * top, mean * bottom])
    return out


def thin(
    planes: list[list[float]], k: int, blocked: list[list[float]] | None = None, margin_m: float = MARGIN_M
) -> TrackingFrame:
    """Frame k with these planes, as they are; blocked: walls that end its free ranges."""
    f = frame(blocked or [WIRE, BEHIND], k)
    n = len(planes)
    model = dataclasses.replace(
        f.model,
        planes=np.array(planes, np.float32).reshape(-1, 6),
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, margin_m, np.float32),
        flags=np.zeros(n, np.uint8),
        cluster=np.zeros(n, np.int32),
    )
    return dataclasses.replace(f, model=model)


def stops(planes: Floats, azimuth: ArrayLike, slope: ArrayLike) -> NDArray[np.float64]:
    """Horizontal range (rays, planes) at which the ray with that direction and slope meets a plane, inf: it does not."""
    c, s = np.cos(azimuth).reshape(-1, 1), np.sin(azimuth).reshape(-1, 1)
    ax, ay, bx, by, top, bottom = planes.astype(np.float64).T
    ex, ey = bx - ax, by - ay
    cross = s * ex - c * ey
    crosses = np.abs(cross) >= 1e-9
    divisor = np.where(crosses, cross, 1.0)
    far, share = (ay * ex - ax * ey) / divisor, (c * ay - s * ax) / divisor
    height = far * np.reshape(slope, (-1, 1))
    beside = (share < -2e-3) | (share > 1.002) | (height < top - 2e-3) | (height > bottom + 2e-3)
    return np.where(crosses & (far > 0.0) & ~beside, far, math.inf)


def stop_m(planes: Floats, azimuth: float, slope: float) -> float:
    """Where the first plane stops a ray, inf: none does."""
    return float(stops(planes, azimuth, slope).min(initial=math.inf))


def assert_all_hidden(f: TrackingFrame, s: TrackSnapshot, *wires: list[float]) -> None:
    """Every ray to one of these wires that a detection of the frame stops is stopped by the tracks, no farther behind than the
    detection's margin, and their margin reaches as near as its own."""
    eye = np.array([*f.camera_m[:2], *f.camera_m[:2], f.camera_m[2], f.camera_m[2]], np.float32)
    margin_m, share = float(f.model.margin_m[0]), np.repeat(np.linspace(0.005, 0.995, 60), 3)
    for wire in wires:
        ax, ay, bx, by, top, bottom = (np.array(wire) - eye).tolist()
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
        z = np.tile([0.75 * top + 0.25 * bottom, 0.5 * (top + bottom), 0.25 * top + 0.75 * bottom], 60)
        azimuth, slope = np.arctan2(y, x), z / np.hypot(x, y)
        far = stops(f.model.planes - eye, azimuth, slope).min(axis=1)
        at, asked = stops(s.planes - eye, azimuth, slope), far < math.inf
        shown = np.column_stack([x, y, z])
        late = asked & (at.min(axis=1, initial=math.inf) > far + margin_m + 0.02)
        assert not late.any(), shown[late]
        short = asked & ((at - s.margin_m).min(axis=1, initial=math.inf) > far - margin_m + 0.02)
        assert not short.any(), shown[short]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_fragments_of_a_wire_become_at_most_three_tracks(seed: int) -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(seed)
    for k in range(15):
        f = thin(fragments(WIRE, rng), k)
        s = tracker.observe(f)
        assert_all_hidden(f, s, WIRE)
        if k >= 9:
            assert len(s.ids) <= 3
    longest = int(np.argmax(np.hypot(s.planes[:, 2] - s.planes[:, 0], s.planes[:, 3] - s.planes[:, 1])))
    assert abs(s.planes[longest, [1, 3]]) == pytest.approx([7.0, 7.0], abs=0.5)
    assert s.planes[longest, [0, 2]] == pytest.approx([12.0, 12.0], abs=0.5)
    assert s.sigma_m[longest] < 0.3


def test_the_id_of_a_wire_lasts() -> None:
    tracker, rng, ids = Tracker(SMALL), np.random.default_rng(4), []
    for k in range(30):
        s = tracker.observe(thin(fragments(WIRE, rng), k))
        ids.append(int(s.ids[np.argmax(np.hypot(s.planes[:, 2] - s.planes[:, 0], s.planes[:, 3] - s.planes[:, 1]))]))
    assert len(set(ids[10:])) == 1


@pytest.mark.nojit
def test_a_thin_obstacle_nearer_by_more_than_its_margin_is_a_track_at_once() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(5)
    for k in range(15):
        tracker.observe(thin(fragments(WIRE, rng), k))
    branch = wall(9.0, -1.0, 9.0, 1.0, -0.40, -0.35)
    f = thin([branch, *fragments(WIRE, rng)], 15)
    s = tracker.observe(f)
    assert_all_hidden(f, s, WIRE, branch)
    assert stop_m(s.planes, 0.0, -0.375 / 9.0) <= 9.0 + 0.1


@pytest.mark.nojit
def test_a_second_wire_that_the_noise_can_tell_apart_stays_a_second_track() -> None:
    """In front of the other in the same rows of the image, half of it each."""
    tracker, rng, margin_m = Tracker(SMALL), np.random.default_rng(6), 0.2
    other = wall(11.0, -6.5, 11.0, 0.0, -0.505, -0.412)
    rest = wall(12.0, 0.2, 12.0, 7.0, -0.55, -0.45)
    for k in range(20):
        pieces = [*fragments(other, rng, 0.1), *fragments(rest, rng, 0.1)]
        s = tracker.observe(thin(pieces, k, [other, rest, BEHIND], margin_m))
    assert stop_m(s.planes, math.atan2(-3.0, 11.0), -0.5 / 12.0) == pytest.approx(math.hypot(3.0, 11.0), abs=0.2)
    assert stop_m(s.planes, math.atan2(3.0, 12.0), -0.5 / 12.0) == pytest.approx(math.hypot(3.0, 12.0), abs=0.2)


def test_a_gap_that_is_seen_through_is_not_bridged() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(7)
    parts = [wall(12.0, -7.0, 12.0, -1.0, -0.55, -0.45), wall(12.0, 1.0, 12.0, 7.0, -0.55, -0.45)]
    for k in range(20):
        pieces = [*fragments(parts[0], rng), *fragments(parts[1], rng)]
        s = tracker.observe(thin(pieces, k, [*parts, BEHIND]))
    for y in (-0.6, 0.0, 0.6):
        assert stop_m(s.planes, math.atan2(y, 12.0), -0.5 / 12.0) > 13.0
    for y in (-4.0, 4.0):
        assert stop_m(s.planes, math.atan2(y, 12.0), -0.5 / 12.0) < 14.0


@pytest.mark.nojit
def test_a_wire_that_is_removed_goes_when_it_is_seen_through() -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(8)
    for k in range(15):
        tracker.observe(thin(fragments(WIRE, rng), k))
    for k in range(15, 17):
        s = tracker.observe(thin([BEHIND], k, [BEHIND], 0.3))
        assert stop_m(s.planes, 0.0, -0.5 / 12.0) < 14.0, "removed without enough evidence"
    for k in range(17, 20):
        s = tracker.observe(thin([BEHIND], k, [BEHIND], 0.3))
    assert stop_m(s.planes, 0.0, -0.5 / 12.0) > 16.0


def test_a_wire_that_is_hidden_is_kept() -> None:
    tracker, rng, screen = Tracker(SMALL), np.random.default_rng(9), wall(5.0, -4.0, 5.0, 4.0)
    for k in range(15):
        tracker.observe(thin(fragments(WIRE, rng), k))
    for k in range(15, 40):
        s = tracker.observe(thin([screen], k, [screen], 0.1))
    assert stop_m(s.planes[s.planes[:, 0] > 6.0], 0.0, -0.5 / 12.0) < 14.0


def test_fragments_one_above_the_other_stay_apart() -> None:
    """Two wires, one below the other: what lies between them is open."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(10)
    lower = wall(12.0, -7.0, 12.0, 7.0, -0.25, -0.15)
    for k in range(15):
        f = thin([*fragments(WIRE, rng), *fragments(lower, rng)], k)
        s = tracker.observe(f)
        assert_all_hidden(f, s, WIRE, lower)
    assert stop_m(s.planes, 0.1, -0.35 / 12.0) > 15.0
    assert len(s.ids) <= 6


@pytest.mark.nojit
@pytest.mark.parametrize("slope", [0.3, pytest.param(-0.6, marks=pytest.mark.compiled)])
def test_a_wire_at_an_angle_to_the_view_is_followed_from_a_moving_camera(slope: float) -> None:
    tracker, rng = Tracker(SMALL), np.random.default_rng(11)
    wire = wall(12.0 - 6.0 * slope, -6.0, 12.0 + 6.0 * slope, 6.0, -0.55, -0.45)
    for k in range(20):
        moved = list(np.array(wire) - np.array([0.1 * k, 0.0, 0.1 * k, 0.0, 0.0, 0.0]))
        f = thin(fragments(moved, rng), k, [moved, BEHIND])
        planes = f.model.planes + np.array([0.1 * k, 0.0, 0.1 * k, 0.0, 0.0, 0.0], np.float32)
        at = (0.1 * k, 0.0, 0.0)
        f = dataclasses.replace(f, model=dataclasses.replace(f.model, planes=planes), camera_m=at, origin_m=at)
        s = tracker.observe(f)
        assert_all_hidden(f, s, wire)
    assert len(s.ids) <= 4
    longest = int(np.argmax(np.hypot(s.planes[:, 2] - s.planes[:, 0], s.planes[:, 3] - s.planes[:, 1])))
    ax, ay, bx, by = s.planes[longest, :4]
    assert math.atan2(by - ay, bx - ax) == pytest.approx(math.atan2(12.0, 12.0 * slope), abs=0.08)
    assert math.hypot(bx - ax, by - ay) > 10.0


def test_without_a_position_fragments_are_not_joined() -> None:
    """Those of several frames lie apart by the error of the estimated motion: the plane would be moved by metres."""
    tracker, rng = Tracker(SMALL), np.random.default_rng(12)
    for k in range(15):
        f = without_position(thin(fragments(WIRE, rng), k))
        s = tracker.observe(f)
        assert_all_hidden(f, s, WIRE)
    lengths = np.hypot(s.planes[:, 2] - s.planes[:, 0], s.planes[:, 3] - s.planes[:, 1])
    assert len(s.ids) > 3
    assert lengths.max() < 12.0
