"""Attitude and position of the vehicle at a frame's mid-exposure, from the samples that have arrived.

Pure and deterministic: no clock is read, so replay decides as the live run did. The caller adds samples in order of
arrival and asks for an instant. The answer is exact, interpolated, extrapolated within bounds, or a cause why there is
none."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum

from core.codes import Code
from core.types import AttitudeSample, PoseSample

from ..config.sync import SyncParams
from . import heading_jumps, position_sections
from .heading_jumps import HeadingJumps, Jumps
from .position_sections import NO_SECTION, PositionSections, Section
from .quaternion import Quaternion, Vector, plausible_rates, rates_between, rotate_by_rates, slerp, tilt_rate
from .sample_buffer import SampleBuffer, nearest_of

NS = 1_000_000_000
POSE_MAX_GAP_NS = NS // 2
"""Greatest gap between two positions that is interpolated."""
MAX_DISTANCE_M = 100_000.0
"""Largest distance from the origin of ned: beyond it float32 cannot represent the centimetres of a prism."""


class Source(IntEnum):
    """Origin of a value; the numbers are those of osape.v1.AttitudeUsed.Source."""

    NONE = 0
    EXACT = 1
    INTERPOLATED = 2
    EXTRAPOLATED = 3


class DropCause(Code):
    """Cause for which a frame was not used; NONE: it was used."""

    NONE = "", ""
    NO_ATTITUDE = "no_attitude", "no attitude had arrived"
    ATTITUDE_STALE = "attitude_stale", "the newest attitude is too old to be carried forward to the exposure"
    FRAME_TOO_OLD = "frame_too_old", "the exposure lies before all attitudes still held"
    GAP_TOO_WIDE = "gap_too_wide", "the attitudes around the exposure are too far apart or contradict each other"
    NO_RATES = "no_rates", "a single attitude without body rates cannot be carried to the exposure"
    CLOCK_UNCERTAIN = "clock_uncertain", "the vehicle turns too fast for the error of the autopilot's timestamps"
    DUPLICATE_FRAME = "duplicate_frame", "a frame with this exposure was handled already"
    LATE_FRAME = "late_frame", "a frame exposed later was handled already"
    WRONG_SIZE = "wrong_size", "the image has another size than the camera's description states"
    BUSY = "busy", "a newer frame was waiting"


@dataclass(frozen=True, slots=True)
class AttitudeAt:
    """q_ned_frd at an instant and how it was obtained. Fields that are not compared are not in the messages."""

    q_ned_frd_wxyz: Quaternion
    source: Source
    distance_ns: int  # to the nearest sample used
    # first stamp after the newest jump of the heading that is in it; 0: there was none
    jump_ns: int = field(default=0, compare=False)
    turned_rad: float = field(default=0.0, compare=False)  # sum of the jumps of the heading that are in it, clockwise
    jumps: Jumps = field(default=(), compare=False)  # the newest of them
    # first stamp after the newest gap of the attitude before it, in which the heading may have jumped; 0: there was none
    gap_ns: int = field(default=0, compare=False)
    # greatest rate of roll and pitch at the samples beside the instant, without the turn about the vertical; 0 where no
    # rates are known
    tilt_rad_s: float = field(default=0.0, compare=False)


@dataclass(frozen=True, slots=True)
class PoseAt:
    """Position in ned at an instant, m, and how it was obtained."""

    position_ned_m: Vector
    source: Source
    distance_ns: int
    reset_counter: int
    section: Section = field(default=NO_SECTION, compare=False)  # see PositionSections; not in the messages


class Synchroniser:
    """Stores the samples that have arrived and gives the vehicle's attitude and position at instants near them.

    Attributes:
        attitudes, poses: the stored samples; `add` adds to them.
        headings: jumps of the heading.
        sections: of the position, between its jumps."""

    def __init__(self, params: SyncParams) -> None:
        self.params = params
        self.attitudes: SampleBuffer[AttitudeSample] = SampleBuffer()
        self.poses: SampleBuffer[PoseSample] = SampleBuffer()
        self.headings = HeadingJumps()
        self.sections = PositionSections()

    def add(self, sample: AttitudeSample | PoseSample) -> None:
        """Adds a sample and detects jumps of the estimate. One that arrives after a jump and was measured before the first
        sample with it is not used: on which side of the jump it lies is not known."""
        if isinstance(sample, AttitudeSample):
            self.headings.take(sample)
            self.attitudes.add(sample, self.headings.jump_ns)
        else:
            self.sections.take(sample)
            self.poses.add(sample, self.sections.begins_ns)

    def attitude_at(self, t_ns: int) -> AttitudeAt | DropCause:
        """The attitude at t_ns, or why there is none: exact; interpolated between two samples that are close enough, without
        a jump of the heading between them, and whose rates explain the turn between them; extrapolated from the nearest
        sample by its body rates, or by those between its neighbour and itself. None where the vehicle turns by more than
        max_clock_error_deg within the error of the stamps."""
        found = self._attitude_at(t_ns)
        if isinstance(found, DropCause):
            return found
        beside = [s for s in self.attitudes.around(t_ns) if s is not None]
        if any(self._uncertain(s) for s in beside):
            return DropCause.CLOCK_UNCERTAIN
        return replace(found, tilt_rad_s=max(self._tilt_rad_s(s) for s in beside))

    def _tilt_rad_s(self, sample: AttitudeSample) -> float:
        """Returns the rate at which the vehicle tilts; 0 where no rates are known."""
        rates = sample.rates_frd_rad_s or self._neighbour_rates(sample)
        return 0.0 if rates is None else tilt_rate(sample.q_ned_frd_wxyz, rates)

    def _uncertain(self, sample: AttitudeSample) -> bool:
        """Returns whether a sample may be wrong by more than max_clock_error_deg, because it is of another instant."""
        if sample.stamp_error_ns == 0:
            return False
        rates = sample.rates_frd_rad_s or self._neighbour_rates(sample)
        if rates is None:
            return True
        return math.hypot(*rates) * sample.stamp_error_ns / NS > math.radians(self.params.max_clock_error_deg)

    def _attitude_at(self, t_ns: int) -> AttitudeAt | DropCause:
        before, after = self.attitudes.around(t_ns)
        if before is None and after is None:
            return DropCause.NO_ATTITUDE
        if before is not None and before is after:
            return self._attitude(before.q_ned_frd_wxyz, Source.EXACT, 0, before)
        if before is not None and after is not None:
            gap_ns = after.t_ns - before.t_ns
            if gap_ns <= self.params.max_gap_s * NS and not self._jumped_between(before, after):
                if heading_jumps.contradict(before, after):  # which of both is wrong is not known
                    return DropCause.GAP_TOO_WIDE
                q = slerp(before.q_ned_frd_wxyz, after.q_ned_frd_wxyz, (t_ns - before.t_ns) / gap_ns)
                return self._attitude(q, Source.INTERPOLATED, min(t_ns - before.t_ns, after.t_ns - t_ns), before)
        return self._extrapolated(t_ns, before, after)

    def _extrapolated(
        self, t_ns: int, before: AttitudeSample | None, after: AttitudeSample | None
    ) -> AttitudeAt | DropCause:
        nearest = nearest_of(t_ns, before, after)
        distance_ns = abs(t_ns - nearest.t_ns)
        if distance_ns > self.params.max_extrapolation_s * NS:
            if before is None:
                return DropCause.FRAME_TOO_OLD
            return DropCause.ATTITUDE_STALE if after is None else DropCause.GAP_TOO_WIDE
        rates = plausible_rates(nearest.rates_frd_rad_s) or plausible_rates(self._neighbour_rates(nearest))
        if rates is None:
            return DropCause.NO_RATES
        q = rotate_by_rates(nearest.q_ned_frd_wxyz, rates, (t_ns - nearest.t_ns) / NS)
        return self._attitude(q, Source.EXTRAPOLATED, distance_ns, nearest)

    def _attitude(self, q: Quaternion, source: Source, distance_ns: int, sample: AttitudeSample) -> AttitudeAt:
        """The attitude with the jumps up to the sample that it was obtained from."""
        turned_rad = self.headings.turned_rad - self.headings.since_rad(sample.t_ns)
        jump_ns, jumps = self.headings.newest_ns(sample.t_ns), self.headings.up_to(sample.t_ns)
        gap_ns = self.headings.gap_ns if sample.t_ns >= self.headings.gap_ns else 0
        return AttitudeAt(q, source, distance_ns, jump_ns, turned_rad, jumps, gap_ns)

    def _jumped_between(self, a: AttitudeSample, b: AttitudeSample) -> bool:
        return self.headings.newest_ns(a.t_ns) != self.headings.newest_ns(b.t_ns)

    def _neighbour_rates(self, sample: AttitudeSample) -> Vector | None:
        """Body rates between the sample and its neighbour, where these are close enough."""
        neighbour = self.attitudes.before(sample)
        if neighbour is None or self._jumped_between(neighbour, sample):
            neighbour = self.attitudes.around(sample.t_ns + 1)[1]
        if neighbour is None or self._jumped_between(sample, neighbour):
            return None
        if abs(sample.t_ns - neighbour.t_ns) > self.params.max_gap_s * NS:
            return None
        return rates_between(neighbour.q_ned_frd_wxyz, sample.q_ned_frd_wxyz, (sample.t_ns - neighbour.t_ns) / NS)

    def pose_at(self, t_ns: int) -> PoseAt | str:
        """The position at t_ns, or a text why there is none. Not across a jump of the autopilot's estimate, not between two
        positions that contradict each other, not beyond MAX_DISTANCE_M, and not where the vehicle flies farther than
        max_clock_error_m within the error of the stamps."""
        found = self._pose_at(t_ns)
        if isinstance(found, PoseAt) and any(s is not None and self._displaced(s) for s in self.poses.around(t_ns)):
            return "the vehicle flies too fast for the error of the autopilot's timestamps"
        if isinstance(found, PoseAt) and not all(abs(c) <= MAX_DISTANCE_M for c in found.position_ned_m):  # also NaN
            return f"the position is farther than {MAX_DISTANCE_M / 1000.0:g} km from the origin of ned"
        return found

    def _displaced(self, sample: PoseSample) -> bool:
        """Returns whether a position may be wrong by more than max_clock_error_m, because it is of another instant."""
        if sample.stamp_error_ns == 0:
            return False
        velocity = sample.velocity_ned_m_s or self._neighbour_velocity(sample)
        if velocity is None:
            return True
        return math.hypot(*velocity) * sample.stamp_error_ns / NS > self.params.max_clock_error_m

    def _neighbour_velocity(self, sample: PoseSample) -> Vector | None:
        """Velocity between the sample and its neighbour, where these are close enough and of one section."""
        neighbour = self.poses.before(sample) or self.poses.around(sample.t_ns + 1)[1]
        if neighbour is None or self.sections.at(neighbour.t_ns) != self.sections.at(sample.t_ns):
            return None
        if abs(sample.t_ns - neighbour.t_ns) > POSE_MAX_GAP_NS:
            return None
        dt_s = (sample.t_ns - neighbour.t_ns) / NS
        (ax, ay, az), (bx, by, bz) = neighbour.position_ned_m, sample.position_ned_m
        return (bx - ax) / dt_s, (by - ay) / dt_s, (bz - az) / dt_s

    def _pose_at(self, t_ns: int) -> PoseAt | str:
        before, after = self.poses.around(t_ns)
        if before is None and after is None:
            return "no position had arrived"
        if before is not None and before is after:
            return PoseAt(before.position_ned_m, Source.EXACT, 0, before.reset_counter, self.sections.at(before.t_ns))
        if before is not None and after is not None:
            gap_ns = after.t_ns - before.t_ns
            section = self.sections.at(before.t_ns)
            one_section = before.reset_counter == after.reset_counter and section == self.sections.at(after.t_ns)
            if gap_ns <= POSE_MAX_GAP_NS and one_section:
                if position_sections.contradict(before, after):
                    return "the positions before and after the exposure contradict each other"
                share = (t_ns - before.t_ns) / gap_ns
                between = _interpolated(before.position_ned_m, after.position_ned_m, share)
                distance_ns = min(t_ns - before.t_ns, after.t_ns - t_ns)
                return PoseAt(between, Source.INTERPOLATED, distance_ns, after.reset_counter, section)
        nearest = nearest_of(t_ns, before, after)
        distance_ns = abs(t_ns - nearest.t_ns)
        if nearest.velocity_ned_m_s is None:
            return "no position near the exposure and no velocity to carry one there"
        if distance_ns > self.params.pose_max_extrapolation_s * NS:
            return "the nearest position is too far from the exposure"
        dt_s = (t_ns - nearest.t_ns) / NS
        px, py, pz = nearest.position_ned_m
        vx, vy, vz = nearest.velocity_ned_m_s
        moved = (px + vx * dt_s, py + vy * dt_s, pz + vz * dt_s)
        section = self.sections.at(nearest.t_ns)
        return PoseAt(moved, Source.EXTRAPOLATED, distance_ns, nearest.reset_counter, section)


def _interpolated(a: Vector, b: Vector, share: float) -> Vector:
    return (a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share)
