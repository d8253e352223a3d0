"""The failsafe: values sent to the autopilot while cameras are blind.

There are three policies, by the behaviour of the autopilot:

- `stop`, for ArduPilot and unknown autopilots. ArduPilot flies on when it gets "unknown", "clear" or nothing. An
  artificial wall is sent in every sector that a blind camera should cover, for as long as the camera is blind. Its
  fence then is at AVOID_MARGIN, where ArduPilot was measured to hold its position. From a nearer wall it backs away
  without end; towards a farther one it creeps.
- `brake`, for PX4 if CP_DIST is known: for `silence_s` after any sector became blind, an artificial wall just outside
  of CP_DIST is sent in all 72 sectors. After that the sectors of blind cameras are "unknown", or nothing is sent if
  all cameras are blind, which makes PX4 change to Hold (with system id 1 alone). Without data PX4 v1.16 coasts (13 m from 5 m/s); before a
  wall at CP_DIST it brakes. From a wall nearer than CP_DIST v1.16 flies backwards, and along a wall in front alone it
  slides sideways. The wall is therefore never nearer, is in all sectors, and also replaces nearer obstacles that
  other cameras see.
- `unknown`, for PX4 if CP_DIST is not known: 65535 in the sectors of blind cameras, and nothing if all are blind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.session_types import PX4

from ..config.avoidance import AvoidParams
from .obstacle_distance import (
    UNKNOWN,
    BrakingReach,
    always_sent_cm,
    beside_unknown,
    clear_cm,
    encoded,
    limits_cm,
    near_cm,
)
from .obstacle_memory import Remembered
from .polar_histogram import SECTORS, SectorScan, SectorState, centres_rad

NS = 1_000_000_000
FENCE_SHARE = math.cos(math.pi / 8.0)
"""Distance of ArduPilot's fence in the middle of a face, over the distance of the wall. The fence before a wall in a
face of 45 degrees runs from corner to corner. ArduPilot holds its position while the middle is within
AVOID_BACKUP_DZ (0.1 m) inside of AVOID_MARGIN. Of the walls measured with a margin of 3 m this is the one at 3.20
m, neither 3.10 nor 3.35 m."""
STOP_INSIDE_M = 0.04
"""The wall for ArduPilot is this much nearer than AVOID_MARGIN; less than AVOID_BACKUP_DZ."""
CLOSING_S = 2.0
"""At the edge of the view, PX4 is sent obstacles that the vehicle would reach within this time: it needs them to
brake."""
APPROACH_S = 1.5
"""A measured obstacle in an unseen sector is sent to PX4 from CP_DIST plus the way in this time at the closing speed on. PX4 up to v1.15
brakes for an obstacle from there: 1 / MPC_XY_P (0.95) + CP_DELAY (0.4 s) + the age of the data."""
GROUND_CM = 75
"""On the ground, nearer distances are sent as not seen. ArduPilot refuses to arm if anything is nearer than 60 cm."""
CP_DIST_M = 3.0
"""Least CP_DIST of the wall while that of the own PX4 is not known: heartbeats of PX4 and of another autopilot contradict each other, or
several vehicles are received."""
OUTSIDE_CP_DIST_M = 0.02
"""Distance of the wall for PX4 beyond CP_DIST, so that rounding does not put it inside. PX4 v1.15 then creeps at 0.01
m/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotNow:
    """State of the autopilot for a decision."""

    kind: str = ""  # "" before the first heartbeat; both names while heartbeats contradict each other
    margin_m: float | None = None  # AVOID_MARGIN; None: not known
    cp_dist_m: float | None = None  # CP_DIST; None: not known
    on_ground: bool = False  # the vehicle is on the ground, by the report of its autopilot
    margin_is_read: bool = True  # False: margin_m is from the last start, when another vehicle may have been connected
    # several vehicles may be the own one: what was read is of one of them
    is_uncertain: bool = False

    @property
    def may_be_px4(self) -> bool:
        """True for PX4, and for an autopilot whose heartbeats contradict each other."""
        return PX4 in self.kind


@dataclass(frozen=True, slots=True)
class Policy:
    """A failsafe policy."""

    name: str  # unknown, stop or brake
    wall_m: float = 0.0  # distance of the artificial wall from the hull; 0 for `unknown`
    all_around: bool = False  # the wall is in all sectors, not only in those of blind cameras

    @property
    def wall_cm(self) -> int:
        """Distance of the wall, rounded away from the vehicle, since PX4's wall must not be nearer than CP_DIST."""
        return math.ceil(100.0 * self.wall_m - 1e-6)


@dataclass(frozen=True, slots=True, eq=False)
class PolicyInput:
    """What the failsafe policy decides by."""

    scan: SectorScan  # sectors by the seeing cameras
    recalled: Remembered
    blind: NDArray[np.bool_]  # (72,) sectors that blind cameras should cover in part
    seeing: NDArray[np.bool_]  # (72,) sectors that seeing cameras cover in part
    whole: NDArray[np.bool_]  # (72,) sectors that seeing cameras cover completely
    newest_ns: int | None  # the newest exposure of a valid frame of any camera; None: there was none
    # (72,) sectors in which the hull would pass beside the views of the seeing cameras
    edge: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(SECTORS, np.bool_))
    velocity_m_s: tuple[float, float] | None = None  # of the vehicle in level, forward and right; None: not known
    on_ground: bool = False  # the vehicle is on the ground
    # (72,) sectors in which blind cameras cover heights of the band that the seeing ones do not
    heights_lost: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(SECTORS, np.bool_))

    @property
    def blind_alone(self) -> NDArray[np.bool_]:
        """The sectors, (72,), that blind cameras should cover and that no seeing ones cover as well."""
        return self.blind & (~self.whole | self.heights_lost)


def policy_of(avoid: AvoidParams, autopilot: AutopilotNow) -> Policy:
    """Returns the policy by configuration and autopilot."""
    margin_m = avoid.avoid_margin_m if autopilot.margin_m is None else autopilot.margin_m
    cp_dist_m = autopilot.cp_dist_m
    if autopilot.is_uncertain:
        # from a wall nearer than its own values a vehicle moves backwards, before a farther one it stands or creeps
        margin_m = max(margin_m, avoid.avoid_margin_m)
        cp_dist_m = None if cp_dist_m is None else max(cp_dist_m, CP_DIST_M)
    ardupilot_m = (margin_m - STOP_INSIDE_M) / FENCE_SHARE
    px4_m = _px4_wall_m(avoid, cp_dist_m)
    if avoid.blind == "unknown":
        return Policy("unknown")
    if avoid.blind == "auto" and autopilot.kind == PX4:
        return Policy("unknown") if px4_m is None else Policy("brake", px4_m, all_around=True)
    if not autopilot.may_be_px4:
        return Policy("stop", ardupilot_m)
    # nearer than CP_DIST, PX4 v1.16 flies backwards: the farther wall is the safe one for both
    outside_m = px4_m if px4_m is not None else CP_DIST_M + OUTSIDE_CP_DIST_M
    if autopilot.kind == PX4:
        return Policy("stop", outside_m, all_around=True)
    if px4_m is None and autopilot.margin_m is not None and autopilot.margin_is_read and not autopilot.is_uncertain:
        return Policy("stop", ardupilot_m, all_around=True)  # PX4 has no AVOID_MARGIN that could have been read
    return Policy("stop", max(ardupilot_m, outside_m), all_around=True)


def _px4_wall_m(avoid: AvoidParams, cp_dist_m: float | None) -> float | None:
    """Returns the distance of the wall for PX4; None: CP_DIST is not known, is off, or leaves no room below
    max_distance_m."""
    if cp_dist_m is None or cp_dist_m <= 0.0:
        return None
    wall_m = max(cp_dist_m, avoid.min_distance_m) + OUTSIDE_CP_DIST_M
    return wall_m if 100.0 * wall_m < limits_cm(avoid)[1] - 1 else None


def closing_m_s(given: PolicyInput) -> NDArray[np.float64]:
    """Returns the speed, (72,), with which the vehicle moves into each sector; 0 where no velocity is known."""
    forward, right = given.velocity_m_s or (0.0, 0.0)
    angle = centres_rad()
    out: NDArray[np.float64] = np.maximum(0.0, np.cos(angle) * forward + np.sin(angle) * right)
    return out


def braking_reach(given: PolicyInput, avoid: AvoidParams, policy: Policy) -> BrakingReach:
    """Returns the distances within which an obstacle is sent to PX4 although an unknown sector is beside it.

    Always sent are near obstacles, and those up to the distance of the wall of the policy `brake`: PX4 does not move into a
    sector by a value that near. At the edge of the view, where sectors are unknown because of the width of the hull, obstacles
    that the vehicle approaches are always sent too, because PX4 needs them to brake. With a wall, obstacles that PX4 must brake
    for are sent as the wall elsewhere. Without a velocity the vehicle may approach each obstacle."""
    sent_cm = np.full(SECTORS, float(always_sent_cm(avoid)))
    wall_cm = policy.wall_cm if policy.name == "brake" else 0
    closing = closing_m_s(given)
    approach_cm = wall_cm + 100.0 * APPROACH_S * closing if wall_cm > 0 else np.zeros(SECTORS)
    always_cm: NDArray[np.float64] = np.maximum(sent_cm, wall_cm)
    unseen = (given.scan.state == SectorState.UNSEEN) & ~given.edge
    beside = given.edge | np.roll(given.edge, 1) | np.roll(given.edge, -1)
    at_edge = beside & ~(unseen | np.roll(unseen, 1) | np.roll(unseen, -1))
    edge_cm = sent_cm + 100.0 * CLOSING_S * closing
    if given.velocity_m_s is None:
        edge_cm[:] = 100.0 * avoid.max_distance_m
        approach_cm[:] = 100.0 * avoid.max_distance_m if wall_cm > 0 else 0.0
    return BrakingReach(np.where(at_edge, np.maximum(always_cm, edge_cm), always_cm), approach_cm, wall_cm)


def into_unseen(given: PolicyInput) -> NDArray[np.bool_]:
    """Returns the sectors, (72,), by whose value PX4 moves into an unseen one of the views.

    The bin of the stick's direction is the one below it, so that a bin reaches to the middle of the next sector. What is outside
    of the views is left to `edge`."""
    return np.roll((given.scan.state == SectorState.UNSEEN) & given.seeing, -1)


class BlindPolicy:
    """Applies the policy to each message. It keeps since when all cameras, and since when each sector, is blind."""

    def __init__(self, avoid: AvoidParams) -> None:
        self._avoid = avoid
        self._all_blind_since_ns: int | None = None
        self._sector_blind = np.zeros(SECTORS, np.bool_)
        self._sector_since_ns = np.zeros(SECTORS, np.int64)
        self._seeing = np.zeros(SECTORS, np.bool_)
        self._policy_name = ""

    def values(self, given: PolicyInput, policy: Policy, now_ns: int) -> NDArray[np.uint16] | None:
        """Returns the centimetres to send, (72,), before the adaptation to single autopilots; None: nothing may be
        sent."""
        self._follow(given, policy, now_ns)
        if policy.name == "brake" and self._brakes(now_ns):
            return np.full(SECTORS, policy.wall_cm, np.uint16)
        reach = braking_reach(given, self._avoid, policy)
        values = encoded(given.scan, self._avoid)
        values[~given.seeing & (values == clear_cm(self._avoid))] = UNKNOWN
        if policy.name != "stop" or policy.all_around:  # ArduPilot takes unknown for clear
            values[(given.edge | into_unseen(given)) & (values == clear_cm(self._avoid))] = UNKNOWN
        if policy.name == "stop":
            self._planes(values, given.scan)
            self._wall(values, given, policy)
        if policy.name == "brake":
            self._approached(values, given, reach)
        values = np.minimum(values, self._recalled(given, policy))
        if policy.name != "stop":
            self._leave_edge(values, given, reach)
            into = into_unseen(given) & (values != UNKNOWN)
            values[into] = beside_unknown(values, clear_cm(self._avoid), reach)[into]
        if given.on_ground:
            # no value above the farthest obstacle: it would mean clear
            farthest_cm = clear_cm(self._avoid) - 2
            values[values < GROUND_CM] = min(policy.wall_cm, farthest_cm) if policy.name == "stop" else UNKNOWN
        blind_ns = 0 if self._all_blind_since_ns is None else now_ns - self._all_blind_since_ns
        return None if blind_ns > self._avoid.silence_s * NS and policy.name != "stop" else values

    def _approached(self, values: NDArray[np.uint16], given: PolicyInput, reach: BrakingReach) -> None:
        """Puts measured and remembered obstacles that PX4 must brake for into unseen sectors.

        PX4 does not brake for unknown sectors beside its course. Something unmeasured may be before the obstacle, so PX4 must
        not be permitted to move into the sector: a farther obstacle is sent at the distance of the wall."""
        distance_m = np.minimum(given.scan.distance_m, given.recalled.distance_m)
        unseen = (given.scan.state == SectorState.UNSEEN) & (values == UNKNOWN)
        wanted = unseen & (100.0 * distance_m <= reach.approach_cm)
        values[wanted] = np.minimum(near_cm(distance_m[wanted], self._avoid), reach.wall_cm)

    def _leave_edge(self, values: NDArray[np.uint16], given: PolicyInput, reach: BrakingReach) -> None:
        """Removes obstacles from sectors at the edge of the view, because PX4 moves into a sector that has any value.

        They are kept if they are near or if the vehicle approaches them: then PX4 must brake for them. Beside an unseen sector
        they are then sent at the distance of the wall, by which PX4 does not move into the sector."""
        farther = given.edge & given.seeing & (values > reach.always_cm)
        braked = farther & (values <= reach.approach_cm)
        values[farther] = UNKNOWN
        values[braked] = reach.wall_cm

    def _follow(self, given: PolicyInput, policy: Policy, now_ns: int) -> None:
        """Updates since when sectors are blind.

        A camera is blind since its newest exposure, not since this was detected. The time is kept per sector, because
        a camera may fail while another one has long been blind. It starts again when the last camera that covered a
        part of the sector fails, and when the policy changes to brake, since PX4 was not sent the wall before."""
        since_ns = now_ns if given.newest_ns is None else given.newest_ns
        if given.seeing.any():
            self._all_blind_since_ns = None
        elif self._all_blind_since_ns is None:
            self._all_blind_since_ns = since_ns
        blind = given.blind_alone
        begins = blind & (~self._sector_blind | (self._seeing & ~given.seeing))
        # of several cameras another one may have been exposed just now
        self._sector_since_ns[begins] = now_ns if given.seeing.any() else since_ns
        if policy.name == "brake" and self._policy_name not in ("", "brake"):
            self._sector_since_ns[blind] = now_ns
        self._sector_blind, self._seeing, self._policy_name = blind, given.seeing.copy(), policy.name

    def _brakes(self, now_ns: int) -> bool:
        """True if any blind sector became blind within silence_s."""
        since_ns = self._sector_since_ns[self._sector_blind]
        return bool((now_ns - since_ns <= self._avoid.silence_s * NS).any())

    def _planes(self, values: NDArray[np.uint16], scan: SectorScan) -> None:
        """Puts planes into unseen sectors: where unknown means clear, a plane behind something unmeasured is better than
        nothing. The wall, where there is one, is put before it."""
        behind = (scan.state == SectorState.UNSEEN) & (scan.distance_m < self._avoid.max_distance_m)
        values[behind] = near_cm(scan.distance_m[behind], self._avoid)

    def _wall(self, values: NDArray[np.uint16], given: PolicyInput, policy: Policy) -> None:
        """Puts the wall into sectors that a camera covers and that were not seen.

        If one camera sees a sector, it counts as seen, whatever another camera does not see. With policy.all_around,
        a wall in any sector puts it into all unseen ones. A sector at the border of all views gets no wall: the rest
        of it is not covered in any case."""
        wall_m = np.full(SECTORS, policy.wall_m)
        unseen = (given.scan.state == SectorState.UNSEEN) & given.whole
        if self._avoid.unseen == "unknown":
            unseen[:] = False
        blind = given.blind_alone
        wall_m = np.where(unseen & ~blind, np.maximum(wall_m, given.scan.free_m - self._avoid.radius_m), wall_m)
        wanted = unseen | (blind & (values != clear_cm(self._avoid)))
        if policy.all_around and blind.any():
            wanted |= values == UNKNOWN
        values[wanted] = np.minimum(values[wanted], near_cm(wall_m[wanted], self._avoid))

    def _recalled(self, given: PolicyInput, policy: Policy) -> NDArray[np.uint16]:
        """Returns the remembered obstacles in centimetres, (72,). One replaces a farther wall, and a sector that is
        not seen.

        Where unknown stops the vehicle, a remembered obstacle does not replace it if something nearer may be before
        it: if the way to it was not seen, or if a camera covers it now and does not see the way. A near obstacle
        always counts."""
        all_m = given.recalled.distance_m
        nearest = np.full(SECTORS, UNKNOWN, np.uint16)
        known = np.isfinite(all_m)
        nearest[known] = near_cm(all_m[known], self._avoid)
        if policy.name == "stop":
            return nearest
        way_seen_m = given.recalled.way_seen_m
        out = np.full(SECTORS, UNKNOWN, np.uint16)
        known = np.isfinite(way_seen_m) & ~(given.seeing & (given.scan.state == SectorState.UNSEEN))
        out[known] = near_cm(way_seen_m[known], self._avoid)
        # in a sector that is seen, the nearest one counts whether the way to it was seen or not
        return np.where(
            (nearest <= always_sent_cm(self._avoid)) | (given.scan.state != SectorState.UNSEEN), nearest, out
        )


class Recovery:
    """Counts valid frames: a blind camera is used again after a number of valid frames in a row, also at its start."""

    def __init__(self, cameras: tuple[str, ...], frames: int) -> None:
        self._need = frames
        self._good = dict.fromkeys(cameras, 0)

    def frame(self, camera: str, valid: bool) -> None:
        """Adds a frame."""
        self._good[camera] = min(self._need, self._good[camera] + 1) if valid else 0

    def blind(self, causes: Mapping[str, str]) -> None:
        """Restarts the count of blind cameras. causes: why each camera is blind now; empty: it is not."""
        for camera, cause in causes.items():
            if cause:
                self._good[camera] = 0

    def recovered(self, camera: str) -> bool:
        """True if the camera counts as seeing."""
        return self._good[camera] >= self._need
