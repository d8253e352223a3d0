"""Bridges single frames that do not see a sector.

A mismatch of a stereo camera ends the free space of one direction in one frame. After SEEN_FRAMES consecutive frames that
saw a sector, a frame that does not see it leaves the sector as it was. The sector must then be seen in as many frames
again, or in one frame if the free space ended at another place than at the last loss: two mismatches do that, while a thin
obstacle ends it at the same place. A second frame in a row without the sector is bridged as well if it lacks rays at other
heights than the first one, so that one of the two saw a share clear_share of the rays. A third one is never bridged, and of
eight frames at most MOST_KEPT are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..config.avoidance import AvoidParams
from .confirmation import GREATEST_SPEED_M_S
from .polar_histogram import SECTORS, STEP_RAD, SectorScan, SectorState

NS = 1_000_000_000
SEEN_FRAMES = 3
"""Number of consecutive frames that must see a sector before it is kept through one that does not."""
ELSEWHERE_M = 0.5
"""Two ends of the free space that are farther apart than this plus the distance flown between them have different causes."""
KEPT_FRAMES, LONGEST_KEPT_NS = 1.5, 150_000_000
"""A sector is kept until this number of frame intervals, and at most this time, has passed since it was last seen."""
KEPT_TWICE, LONGEST_TWICE_NS = 2.5, 250_000_000
"""The same limits where a second frame in a row does not see the sector."""
MOST_KEPT = 2
"""A sector is kept in at most this number of eight consecutive frames: repeated losses are not caused by mismatches."""


@dataclass(frozen=True, slots=True, eq=False)
class SectorSight:
    """The views that a scan was made from."""

    exposed_ns: NDArray[np.int64]  # (72,) exposure of the newest frame that covers each sector; 0: none
    blind: NDArray[np.bool_]  # (72,) sectors that a blind camera covers in part
    heading_rad: float  # heading of the vehicle, clockwise from north
    speed_m_s: float | None  # horizontal speed; None: not known
    now_ns: int  # instant of the decision
    down_m_s: float | None = None  # vertical speed; None: not known


class SeenSectors:
    """Bridges single frames that do not see a sector. `take` gets each scan, in order. A frame may be used by several
    scans."""

    def __init__(self, avoid: AvoidParams) -> None:
        """Starts without any sector seen.

        avoid: confirm_px = 0 switches the bridging off; obstacles from max_distance_m on are not sent."""
        self._avoid = avoid
        # at the newest scan that saw the sector
        self._distance_m, self._free_m = np.full(SECTORS, np.inf), np.zeros(SECTORS)
        self._heading_rad = np.zeros(SECTORS)
        self._seen_exposed_ns, self._seen_ns = np.zeros(SECTORS, np.int64), np.zeros(SECTORS, np.int64)
        # at the first scan of the newest frame that did not see it
        self._lost_free_m, self._lost_ns = np.full(SECTORS, np.inf), np.zeros(SECTORS, np.int64)
        self._lost_lacking = np.zeros((SECTORS, avoid.slices, avoid.rays), np.bool_)
        # of the frames of each sector: exposure of the newest one, and time between two that saw it
        self._frame_ns, self._interval_ns = np.zeros(SECTORS, np.int64), np.zeros(SECTORS, np.int64)
        # number of the newest frames in a row that saw it, and that did not
        self._in_a_row, self._losses = np.zeros(SECTORS, np.int64), np.zeros(SECTORS, np.int64)
        self._established = np.zeros(SECTORS, np.bool_)  # since SEEN_FRAMES in a row no loss was left unbridged
        self._lost_after_row = np.zeros(SECTORS, np.bool_)  # the newest loss followed SEEN_FRAMES in a row
        self._kept_frame_ns = np.zeros(SECTORS, np.int64)  # exposure of the frame that is bridged; 0: none
        self._kept_bits = np.zeros(SECTORS, np.uint8)  # which frames were bridged; the newest is the lowest bit

    def take(self, found: SectorScan, sight: SectorSight) -> SectorScan:
        """Returns the scan to use.

        A sector is not kept once the vehicle has turned by half of the sector's width. Kept distances are shortened
        by the distance that the vehicle may have flown since."""
        seen = found.state != SectorState.UNSEEN
        speed_m_s = GREATEST_SPEED_M_S if sight.speed_m_s is None else sight.speed_m_s
        apart_m = np.abs(found.free_m - self._lost_free_m)
        elsewhere = apart_m > ELSEWHERE_M + speed_m_s * (sight.now_ns - self._lost_ns) / NS
        other_heights = self._at_other_heights(found.lacking)
        new_loss = ~seen & (sight.exposed_ns > self._frame_ns)
        self._count(seen, elsewhere, other_heights, sight)
        self._lost_free_m = np.where(new_loss, found.free_m, self._lost_free_m)
        self._lost_ns = np.where(new_loss, sight.now_ns, self._lost_ns)
        self._lost_lacking[new_loss] = found.lacking[new_loss]
        out = self._completed(found, self._kept(seen, sight), speed_m_s, sight.now_ns)
        self._distance_m = np.where(seen, found.distance_m, self._distance_m)
        self._free_m = np.where(seen, found.free_m, self._free_m)
        self._heading_rad = np.where(seen, sight.heading_rad, self._heading_rad)
        self._seen_exposed_ns = np.where(seen, sight.exposed_ns, self._seen_exposed_ns)
        self._seen_ns = np.where(seen, sight.now_ns, self._seen_ns)
        return out

    def _completed(self, found: SectorScan, kept: NDArray[np.bool_], speed_m_s: float, now_ns: int) -> SectorScan:
        """Returns the scan with these sectors, (72,), as they were when they were seen."""
        way_m = speed_m_s * (now_ns - self._seen_ns) / NS
        distance_m = np.minimum(found.distance_m, np.maximum(0.0, self._distance_m - way_m))
        free_m = np.maximum(0.0, self._free_m - way_m)
        far_m = self._avoid.max_distance_m
        obstacle = distance_m < far_m
        kept = kept & (obstacle | (free_m >= far_m - self._avoid.step_m))  # else it is not seen as far as a clear one
        state = np.where(obstacle, SectorState.OBSTACLE, SectorState.CLEAR)
        return SectorScan(
            np.where(kept, state, found.state).astype(np.uint8),
            np.where(kept, distance_m, found.distance_m),
            np.where(kept, free_m, found.free_m),
            found.azimuth_rad,
            found.lacking,
        )

    def _same_height(self, since_frame_ns: NDArray[np.int64], sight: SectorSight) -> NDArray[np.bool_]:
        """Returns (72,): the vehicle has hardly changed its height since the frame before. Heights are relative to
        it."""
        if sight.down_m_s is None:
            return np.zeros(SECTORS, np.bool_)
        slice_m = (self._avoid.band_above_m + self._avoid.band_below_m) / self._avoid.slices
        return np.asarray(abs(sight.down_m_s) * since_frame_ns / NS <= 0.5 * slice_m)

    def _at_other_heights(self, lacking: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Returns (72,): the rays missing now at the heights of the last loss, or next to them, are too few to lose
        the sector.

        Only heights are compared: an object that the vehicle passes moves over the rays of a sector from frame to
        frame."""
        rows: NDArray[np.bool_] = np.asarray(self._lost_lacking.any(axis=2))
        near = rows.copy()
        near[:, 1:] |= rows[:, :-1]
        near[:, :-1] |= rows[:, 1:]
        most = lacking[0].size - math.ceil(self._avoid.clear_share * lacking[0].size)
        common = (lacking & near[:, :, None]).sum(axis=(1, 2))
        # a loss that missing rays do not explain has another cause
        by_rays = (lacking.sum(axis=(1, 2)) > most) & (self._lost_lacking.sum(axis=(1, 2)) > most)
        return np.asarray(by_rays & (common <= most))

    def _count(
        self,
        seen: NDArray[np.bool_],
        elsewhere: NDArray[np.bool_],
        other_heights: NDArray[np.bool_],
        sight: SectorSight,
    ) -> None:
        """Counts the frames of the scan, and decides which of them are bridged. All arrays are (72,).

        Args:
            seen: sectors that are seen now.
            elsewhere: the free space ends at another place than at the last loss.
            other_heights: of `_at_other_heights`.
            sight: the views of the scan."""
        since_frame_ns = sight.exposed_ns - self._frame_ns
        new, missed = since_frame_ns > 0, since_frame_ns > LONGEST_KEPT_NS
        after_row = self._in_a_row >= SEEN_FRAMES
        first = ~seen & (after_row | (self._established & elsewhere & (self._in_a_row >= 1)))
        second = ~seen & new & ~missed & (self._losses == 1) & self._lost_after_row & other_heights
        second &= self._same_height(since_frame_ns, sight)
        self._kept_bits = np.where(new, self._kept_bits << 1, self._kept_bits).astype(np.uint8)
        before = np.unpackbits(self._kept_bits[:, None] & np.uint8(0xFE), axis=1).sum(axis=1)
        bridged = (first | second) & (before < MOST_KEPT)
        self._kept_bits |= bridged.astype(np.uint8)
        self._kept_frame_ns = np.where(seen, 0, np.where(bridged, sight.exposed_ns, self._kept_frame_ns))
        self._lost_after_row = np.where(~seen & new, after_row, self._lost_after_row)
        self._losses = np.where(new, np.where(seen, 0, self._losses + 1), self._losses)
        in_a_row = np.where(missed, 0, self._in_a_row) + 1  # a missing frame did not see it
        self._in_a_row = np.where(seen & ~sight.blind, np.where(new, in_a_row, self._in_a_row), 0)
        gone = sight.blind | (new & missed) | (~seen & new & ~first)
        self._established = (self._established & ~gone) | (self._in_a_row >= SEEN_FRAMES)
        self._interval_ns = np.where(seen & new, since_frame_ns, self._interval_ns)
        self._frame_ns = sight.exposed_ns.copy()

    def _kept(self, seen: NDArray[np.bool_], sight: SectorSight) -> NDArray[np.bool_]:
        """Returns the unseen sectors, (72,), that are used as they were: those whose frame is bridged, for a limited time
        and turn. seen: (72,)."""
        once_ns = np.minimum(LONGEST_KEPT_NS, KEPT_FRAMES * self._interval_ns)
        twice_ns = np.minimum(LONGEST_TWICE_NS, KEPT_TWICE * self._interval_ns)
        limit_ns = np.where(self._losses > 1, twice_ns, once_ns)
        turned = np.abs(np.remainder(sight.heading_rad - self._heading_rad + np.pi, math.tau) - np.pi)
        kept: NDArray[np.bool_] = ~seen & ~sight.blind & (sight.exposed_ns > 0)
        kept &= (self._kept_frame_ns == sight.exposed_ns) & (turned < 0.5 * STEP_RAD)
        kept &= sight.now_ns - self._seen_ns <= limit_ns
        kept &= sight.exposed_ns - self._seen_exposed_ns <= limit_ns
        return kept & (self._avoid.confirm_px > 0)
