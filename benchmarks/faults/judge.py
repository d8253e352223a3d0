"""Judges what was sent by the truth: the field, the flight, and which evidence reached the service.

It uses no part of the obstacle output but the meaning of its values (docs/reference/obstacle-output.md)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from companion.pipeline.results import PrismsResult
from drivers.mavlink.session_types import ARDUPILOT

from .field import HEIGHT_M, STEP_DEG
from .loop import FaultLoop
from .path import true_room_m
from .planner import TIMEOUT_NS, Floats, camera_place_m, hidden_points, in_estimate, in_level, planner_view
from .switches import NS, Fault
from .world import WorldWatch

UNKNOWN = 65535
RANGE_M = 0.75
"""Error of a distance at the farthest range: noise of 0.0015 (0.2 m at 12 m), a ring of the free profile of 0.5 m."""
KE_PER_M = 0.0015
"""Noise of the camera without a fault."""
ARRIVED_S = 0.5
"""What has moved into a sector is reported at the latest after this time: two frames of which one may be lost, and the link."""
INSIDE_DEG = 1.5
"""A solid in the outermost degree of a sector, a fifth of its width, may be missed (docs/reference/limits.md)."""
SURFACE_STEP = 17
"""Of so many points of the outlines one is a place that the world must not lose."""
JUMP_NS = 250_000_000
"""A position is carried forward for 0.2 s: a frame may be in the estimate of before a jump for so long."""
BLIND_NS = 400_000_000
"""Blind values are sent at the latest after this time."""
EVIDENT_FROM_S = 4.0
AGAIN_SECTORS = 3
BORDER_DEG = 8.0
"""Sectors whose middle is farther inside a view are in it as a whole, also for a camera beside the middle of the vehicle. Of those
at its border a part is not seen: to PX4 they are unknown, to ArduPilot open (docs/explanation/failsafe.md)."""


@dataclass(frozen=True, slots=True)
class Violation:
    """t_s: of the flight; what: in one line; faults: that are or were in force in the last 4 s."""

    t_s: float
    what: str
    faults: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.t_s:.2f} s: {self.what}; faults: {', '.join(self.faults) or 'none'}"


@dataclass(slots=True)
class Judge:
    """`sent` gets each message. messages: number of messages; clear: number of clear sectors; quiet: messages at times without a
    fault; refused: number of them at which a camera was blind, by cause; paths: decisions by which the guard takes a path for
    free; planner: valid messages for a planner; worlds: judged times of the merged world; seen_s: instants at which AGAIN_SECTORS
    sectors or more were clear or at a true obstacle."""

    faults: list[Fault]
    kind: str
    messages: int = 0
    clear: int = 0
    quiet: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    paths: int = 0
    planner: int = 0
    worlds: int = 0
    violations: list[Violation] = field(default_factory=list)
    seen_s: list[float] = field(default_factory=list)
    _noisy_ns: int = -NS
    _noise: float = 1.0
    _world: WorldWatch = field(default_factory=WorldWatch)

    def sent(self, loop: FaultLoop, values: list[int]) -> None:
        """Judges one message at the moment of sending."""
        self.messages += 1
        avoid, state = loop.avoid, loop.truth()
        clear_cm = round(100 * avoid.max_distance_m) + 1
        t_s = loop.flown_ns / NS
        inner_m = loop.field.nearest_m(state, INSIDE_DEG, t_s)
        if loop.field.mover is not None:  # what has just arrived in a sector may not be reported yet
            inner_m = np.maximum(inner_m, loop.field.nearest_m(state, INSIDE_DEG, t_s - ARRIVED_S))
        whole_m = loop.field.nearest_m(state, 0.5 * STEP_DEG, t_s)
        agreeing = 0
        for sector, value in enumerate(values):
            near_m = float(inner_m[sector])
            judged = bool(viewers(loop, sector, BORDER_DEG))
            if value == clear_cm:
                self.clear += 1
                agreeing += 1
                if judged and near_m < avoid.max_distance_m - self._allowed_m(loop, near_m):
                    self._note(loop, f"sector {sector} is clear, a solid is {near_m:.2f} m away")
            elif value < clear_cm:
                hull_m = near_m - avoid.radius_m
                agreeing += abs(value / 100.0 - (float(whole_m[sector]) - avoid.radius_m)) < 1.0
                if judged and value / 100.0 > max(hull_m, avoid.min_distance_m + 0.01) + self._allowed_m(loop, near_m):
                    self._note(loop, f"sector {sector} is {value} cm, a solid is {100 * hull_m:.0f} cm away")
        self.judge_time(loop, values, clear_cm)
        self.judge_path(loop)
        self._count_refusals(loop)
        if agreeing >= AGAIN_SECTORS:
            self.seen_s.append(loop.flown_ns / NS)

    def _allowed_m(self, loop: FaultLoop, near_m: float) -> float:
        """Returns the allowed error of a distance: with more noise three more of the deviations that are added."""
        if not math.isfinite(near_m):
            return math.inf
        factor = max(s.noise_factor for s in loop.camera_switches)
        self._noisy_ns, self._noise = (loop.flown_ns, factor) if factor > 1.0 else (self._noisy_ns, self._noise)
        more = self._noise - 1.0 if loop.flown_ns - self._noisy_ns < NS else 0.0
        return RANGE_M + 3.0 * more * KE_PER_M * near_m**2

    def _count_refusals(self, loop: FaultLoop) -> None:
        """Counts the messages at which a camera is blind without a fault, in force or recovering."""
        t_s = loop.flown_ns / NS
        around = (f for f in self.faults if f.begin_ns / NS <= t_s <= f.end_ns / NS + f.recovery_s + 1.0)
        report = None if loop.service is None else loop.service.report
        if report is None or t_s < EVIDENT_FROM_S or any(around):
            return
        self.quiet += 1
        self.refused.update(set(report.blind.values()))

    def judge_path(self, loop: FaultLoop) -> None:
        """The guard must not take a path for free beyond a solid."""
        claim = None if loop.service is None else loop.service.claim
        if claim is None:
            return
        self.paths += claim.room_m > 0.0
        t_s, state = loop.flown_ns / NS, loop.truth()
        angle_rad, radius_m = claim.angle_rad, loop.avoid.radius_m
        room_m = true_room_m(loop.field.outline_at(t_s), state, angle_rad, radius_m)
        if loop.field.mover is not None:
            room_m = max(room_m, true_room_m(loop.field.outline_at(t_s - ARRIVED_S), state, angle_rad, radius_m))
        if claim.room_m > room_m + self._allowed_m(loop, room_m):
            self._note(loop, f"the path is free for {claim.room_m:.2f} m to the guard, a solid is {room_m:.2f} m away")

    def published(self, loop: FaultLoop, result: PrismsResult) -> None:
        """Judges the message of a frame at the moment of publication."""
        age_ns = loop.mono_ns - result.t_exposure_ns
        exposed_ns = loop.flown_ns - age_ns
        if self._world.take(result, loop.began_ns):
            self._judge_world(loop, exposed_ns)
        if not result.valid or age_ns > TIMEOUT_NS:
            return
        state = loop.field.path.at(exposed_ns / NS)
        mount = next(c.mount for c in loop.cameras if c.camera == result.camera)
        points_m, surface_m = hidden_points(
            loop.field.outline_at(exposed_ns / NS), camera_place_m(state, mount), RANGE_M
        )
        self.planner += 1
        view, encoded = planner_view(result), result.model
        if view.model is None or encoded is None or len(view.model.planes) != len(encoded.planes):
            self._note(loop, "a planner decodes another model than was encoded")
        frames = [in_level(points_m, state)]
        if result.frame == "ned":
            frames = in_estimates(loop, points_m, exposed_ns)
        limit_m = np.array([self._allowed_m(loop, float(m)) for m in surface_m])
        wrong = np.logical_and.reduce([view.free(points) for points in frames]) & (limit_m <= RANGE_M)
        if wrong.any():
            self._note(
                loop,
                f"{np.count_nonzero(wrong)} points in {result.frame} behind surfaces at {surface_m[wrong].min():.2f} m "
                f"are free to a planner, by camera {result.camera}, {age_ns / NS:.2f} s after its exposure",
            )

    def _judge_world(self, loop: FaultLoop, exposed_ns: int) -> None:
        """Judges the merged world: what is in solids must not be free, and their surfaces must not get lost."""
        self.worlds += 1
        deep_m, surface_m = loop.field.deep_m, loop.field.outline_m[::SURFACE_STEP]
        wrong = np.logical_and.reduce([self._world.free(p) for p in in_estimates(loop, at_height(deep_m), exposed_ns)])
        if wrong.any():
            near_m = float(np.hypot(*deep_m[wrong].T).min())
            self._note(loop, f"{np.count_nonzero(wrong)} points in solids from {near_m:.2f} m are free in the world")
        estimates = in_estimates(loop, at_height(surface_m), exposed_ns)
        if len(estimates) != 1 or loop.field.mover is not None:
            return
        north_m, east_m, _ = loop.field.path.at(exposed_ns / NS).position_ned_m
        range_m = np.hypot(surface_m[:, 0] - north_m, surface_m[:, 1] - east_m)
        if (lost := self._world.lost(estimates[0], range_m)).any():
            near_m = float(range_m[lost].min())
            self._note(loop, f"{np.count_nonzero(lost)} places of surfaces from {near_m:.2f} m are lost in the world")

    def judge_time(self, loop: FaultLoop, values: list[int], clear_cm: int) -> None:
        """Without new evidence nothing may be clear; an ArduPilot must not be sent unknown where a camera looks."""
        evidence, now_ns = loop.evidence, loop.flown_ns
        since_ns = now_ns - max(evidence.attitude_ns, loop.began_ns)
        if since_ns > BLIND_NS and clear_cm in values:
            self._note(
                loop, f"{values.count(clear_cm)} sectors are clear {since_ns / NS:.2f} s after the newest attitude"
            )
        # cameras of one direction see the height band together: the newest image of each of them is needed
        together = len({camera.mount.yaw_rad for camera in loop.cameras}) < len(loop.cameras)
        for sector, value in enumerate(values):
            if value == clear_cm:
                newest_ns = (min if together else max)(
                    (evidence.frame_ns[c] for c in viewers(loop, sector, -BORDER_DEG)), default=-1
                )
                since_ns = now_ns - max(newest_ns, loop.began_ns)
                if since_ns > BLIND_NS:
                    self._note(loop, f"sector {sector} is clear {since_ns / NS:.2f} s after the newest image of it")
            elif value == UNKNOWN and self.kind == ARDUPILOT and viewers(loop, sector, 2.0 * BORDER_DEG):
                self._note(loop, f"sector {sector} is unknown, which it treats as clear, where a camera looks")
        since_ns = now_ns - max(evidence.left_ns[0], loop.began_ns)
        left = [values[s] for s in (-6, -5, -4)]
        if since_ns > BLIND_NS + NS // 4 and clear_cm in left and loop.camera_switches[0].covered >= 0.3:
            self._note(loop, f"the covered side is clear after {since_ns / NS:.2f} s")

    def _note(self, loop: FaultLoop, what: str) -> None:
        t_ns = loop.flown_ns
        near = tuple(f.name for f in self.faults if f.begin_ns <= t_ns <= f.end_ns + 4 * NS)
        self.violations.append(Violation(t_ns / NS, what, near))

    def judge_recovery(self, flown_s: float) -> None:
        """To be called after the flight: after each fault that no other one follows, the sectors are seen again in time."""
        seen = np.array(self.seen_s)
        for fault in self.faults:
            at_s = fault.end_ns / NS + fault.recovery_s
            until_s = at_s + 1.0
            others = [f for f in self.faults if f is not fault]
            if until_s > flown_s or any(
                f.begin_ns < until_s * NS and f.end_ns + f.recovery_s * NS > fault.end_ns for f in others
            ):
                continue
            if not ((seen >= fault.end_ns / NS) & (seen <= until_s)).any():
                self.violations.append(
                    Violation(
                        until_s, f"not seen again {until_s - fault.end_ns / NS:.1f} s after its end", (fault.name,)
                    )
                )


def at_height(points_m: Floats) -> Floats:
    """Returns points (N, 2) as places (N, 3) at the height of the flight."""
    return np.column_stack([points_m, np.full(len(points_m), -HEIGHT_M)])


def in_estimates(loop: FaultLoop, points_m: Floats, exposed_ns: int) -> list[Floats]:
    """Returns points (N, 3) in ned of each estimate that a frame of this exposure may be in."""
    until_ns = [e.since_ns for e in loop.estimates[1:]] + [loop.flown_ns + 1]
    recent = [e for e, end_ns in zip(loop.estimates, until_ns, strict=True) if end_ns > exposed_ns - JUMP_NS]
    return [in_estimate(points_m, e.heading_rad, e.shift_m) for e in recent]


def viewers(loop: FaultLoop, sector: int, inside_deg: float) -> list[int]:
    """Returns the numbers of the cameras whose view contains the middle of a sector, so far inside of its border."""
    out = []
    for number, camera in enumerate(loop.cameras):
        half_deg = math.degrees(math.atan(0.5 * camera.intrinsics.width / camera.intrinsics.fx))
        aside_deg = math.remainder(sector * STEP_DEG - math.degrees(camera.mount.yaw_rad), 360.0)
        if abs(aside_deg) <= half_deg - inside_deg:
            out.append(number)
    return out
