"""Check, frame by frame, whether a camera is mounted as configured.

A mount that is wrong in roll or pitch makes level ground appear inclined and vertical walls lean. Terrain inclines the ground
too. Two cues separate them: walls (core/self_check/mount_cues.py), and turning (core/self_check/mount_filter.py). While neither does, a large
apparent slope makes frames invalid: whatever is reported as free would hold under one explanation only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..frames import euler_from_rotation, rotation_from_euler
from ..types import CameraMount
from .mount_cues import MountCues, Walls
from .mount_filter import SLOPE_SD_RAD, FilterState, MountFilter, slope_rows
from .mount_params import MountCheckParams

NS = 1_000_000_000
FIRST_MEASUREMENTS = 10
"""So many frames are measured one after the other; then one per interval_s."""
STREAK, DEGRADED_STREAK = 3, 10
"""Measurements in a row that must agree before the verdict changes; before it becomes degraded, which is not urgent."""
ERROR_SDS, ERROR_SD_RAD = 4.0, math.radians(1.2)
"""An error that makes frames invalid is this many standard deviations, each of this much at most."""
DEGRADED_SDS, DEGRADED_SD_RAD = 3.0, math.radians(0.35)
KEEP = 0.8
"""An error of this share of the threshold is reported: the estimate has noise, and a verdict is kept down to it."""
CONFIRMATIONS, WALL_CONFIRMATIONS = 100, 34
"""Measurements in a row that must estimate an error before it counts as one, and for how many one counts whose walls lean:
within a short turn rolling terrain looks like a wrong mount."""
RESIDUAL_S, MAX_RESIDUAL_RAD = 1.0, math.radians(0.4)
"""Time constant of the mean residual of the slope in ned, and its greatest value for a terrain that is one plane. White noise
of the attitude and a wrong mount leave less."""
RESTLESS_PER_SQRT_S = 3.0
"""How much faster the terrain is expected to change, in rad/sqrt(s) per rad of residual above MAX_RESIDUAL_RAD."""
CONFIRMED_SDS = 2.0
"""Standard deviations that the apparent slope of level ground may be away from level, see `confirmed_by_ground`."""
VERIFIED_SDS = 2.0
"""A slope is the terrain's when the error of the mount in its direction and this many standard deviations are less than
unverified_deg."""

Floats = NDArray[np.float64]


class MountVerdict(IntEnum):
    """What is known of the mount, by rising urgency."""

    UNKNOWN = 0
    """Nothing speaks against it, too little for it."""
    VERIFIED = 1
    DEGRADED = 2
    """Wrong by degraded_deg or more."""
    UNVERIFIED_SLOPE = 3
    """A large slope that may be a wrong mount: frames are invalid."""
    ERROR = 4
    """Wrong by invalid_deg or more: frames are invalid."""

    @property
    def invalid(self) -> bool:
        """Whether frames are invalid."""
        return self >= MountVerdict.UNVERIFIED_SLOPE


@dataclass(frozen=True, slots=True)
class MountState:
    """The state that one frame passes to the next. t_ns: of the newest measurement; None: there was none. ground: it found a surface that
    may be the ground; slope_rad: the apparent slope of the newest such surface. confirmations: measurements in a row that estimate
    an error; residual_rad: mean residual of the slope, north and east."""

    t_ns: int | None = None
    measurements: int = 0
    verdict: MountVerdict = MountVerdict.UNKNOWN
    pending: MountVerdict = MountVerdict.UNKNOWN
    streak: int = 0
    slope_rad: float = 0.0
    ground: bool = False
    confirmations: int = 0
    residual_rad: tuple[float, float] = (0.0, 0.0)
    filter: FilterState = field(default_factory=FilterState)

    @property
    def error_rad(self) -> tuple[float, float]:
        """Roll and pitch that the true mount has more than the configured one, as rotations about frd x and y."""
        return self.filter.mean[0], self.filter.mean[1]

    @property
    def error_sd_rad(self) -> tuple[float, float]:
        """Their standard deviations."""
        return math.sqrt(max(0.0, self.filter.covariance[0])), math.sqrt(max(0.0, self.filter.covariance[5]))

    def corrected(self, mount: CameraMount) -> tuple[float, float, float]:
        """(roll, pitch, yaw) in rad of the mount as measured, its yaw as configured.

        Gravity in the camera's axes gives roll and pitch whatever the yaw is. The yaw that a rotation about frd x and y
        changes for a camera that looks down is none that was measured."""
        x, y = self.error_rad
        R = rotation_vector(x, y, 0.0) @ rotation_from_euler(mount.roll_rad, mount.pitch_rad, mount.yaw_rad)
        roll_rad, pitch_rad, _ = euler_from_rotation(R)
        return roll_rad, pitch_rad, mount.yaw_rad


def due(state: MountState, t_ns: int, params: MountCheckParams) -> bool:
    """Whether the frame at t_ns is to be measured."""
    if not params.enabled:
        return False
    if state.t_ns is None or state.measurements < FIRST_MEASUREMENTS:
        return True
    return t_ns - state.t_ns >= round(params.interval_s * NS)


def checked(
    state: MountState, t_ns: int, cues: MountCues, R_ned_frd: Floats, heading_rad: float, params: MountCheckParams
) -> MountState:
    """The state after a measurement at t_ns. heading_rad: of level_cam's x axis, in which the cues are."""
    mount = MountFilter(state.filter)
    dt_s = 0.0 if state.t_ns is None else (t_ns - state.t_ns) / NS
    restless_rad = max(0.0, math.hypot(*state.residual_rad) - MAX_RESIDUAL_RAD)
    mount.predict(dt_s, math.radians(params.terrain_deg_per_sqrt_s) + RESTLESS_PER_SQRT_S * restless_rad)
    if not cues.ground:  # nothing new; the verdict stays
        return replace(state, t_ns=t_ns, measurements=state.measurements + 1, ground=False, filter=mount.state())
    R_level_frd = rotation_from_euler(0.0, 0.0, -heading_rad) @ R_ned_frd
    rows = slope_rows(R_level_frd, heading_rad)
    residual = _residual(state, dt_s, rows, cues, mount)
    mount.slope(rows, (cues.slope_x_rad, cues.slope_y_rad), cues.slope_sd_rad)
    size = cues.slope_rad
    if cues.walls is not Walls.UNDECIDED:
        along = (cues.slope_x_rad * rows[0] + cues.slope_y_rad * rows[1]) / size
        along[:3] = 0.0
        mount.walls(along, size if cues.walls is Walls.VERTICAL else 0.0)
    confirmations = _confirmations(state, mount, cues, residual, params)
    wanted = _verdict(state.verdict, mount, cues, rows, confirmations, params)
    verdict, pending, streak = settled(state, wanted)
    return MountState(
        t_ns, state.measurements + 1, verdict, pending, streak, size, True, confirmations, residual, mount.state()
    )


def confirmed_by_ground(state: MountState, R_ned_frd: Floats, heading_rad: float, params: MountCheckParams) -> bool:
    """Whether the ground in the direction of this heading looks level, within degraded_deg with CONFIRMED_SDS standard deviations.

    That is the sum of the mount's error and the terrain's slope, which one heading gives. It does not verify the mount: a slope that
    cancels an error hides it. The ground is as far from level then as from the mount's axes, so what is judged against the
    ground stays right. heading_rad: of level_cam's x axis."""
    if state.verdict is not MountVerdict.UNKNOWN:
        return False
    rows = slope_rows(rotation_from_euler(0.0, 0.0, -heading_rad) @ R_ned_frd, heading_rad)
    mount = MountFilter(state.filter)
    size = float(np.hypot(*(rows @ mount.mean)))
    sd = math.sqrt(float(np.max(np.diag(rows @ mount.P @ rows.T))))
    return size + CONFIRMED_SDS * sd <= math.radians(params.degraded_deg)


def _residual(state: MountState, dt_s: float, rows: Floats, cues: MountCues, mount: MountFilter) -> tuple[float, float]:
    """The mean residual north and east with this measurement in it. A measurement that is not precise counts less."""
    share = 1.0 - math.exp(-max(0.0, dt_s) / RESIDUAL_S)
    share *= SLOPE_SD_RAD**2 / (SLOPE_SD_RAD**2 + cues.slope_sd_rad**2)
    along = np.array([cues.slope_x_rad, cues.slope_y_rad]) - rows @ mount.mean
    north, east = (float(v) for v in rows[:, 3:].T @ along)
    return state.residual_rad[0] + share * (north - state.residual_rad[0]), state.residual_rad[1] + share * (
        east - state.residual_rad[1]
    )


def _confirmations(
    state: MountState, mount: MountFilter, cues: MountCues, residual: tuple[float, float], params: MountCheckParams
) -> int:
    """Measurements in a row that estimate an error. While the residual is large, the terrain is no plane: none counts."""
    error = mount.mean[:2]
    size = float(math.hypot(error[0], error[1]))
    keep = KEEP if state.verdict is MountVerdict.ERROR else 1.0
    if size < keep * math.radians(params.invalid_deg):
        return 0
    if _sd_along(mount.P[:2, :2], error / size) > min(ERROR_SD_RAD, size / ERROR_SDS):
        return 0
    if cues.walls is Walls.LEANING:
        return min(CONFIRMATIONS, state.confirmations + WALL_CONFIRMATIONS)
    if math.hypot(*residual) > MAX_RESIDUAL_RAD:
        return state.confirmations
    return min(CONFIRMATIONS, state.confirmations + 1)


def settled(state: MountState, wanted: MountVerdict) -> tuple[MountVerdict, MountVerdict, int]:
    """(verdict, pending, streak): a verdict changes after enough measurements in a row that want another one."""
    if wanted is state.verdict:
        return state.verdict, wanted, 0
    # all that want invalid frames agree in that, whichever of them it is; and so do all that want valid ones again
    alike = wanted is state.pending or (wanted.invalid and state.pending.invalid)
    alike = alike or (state.verdict.invalid and not wanted.invalid and not state.pending.invalid)
    streak = state.streak + 1 if alike and state.streak else 1
    needed = DEGRADED_STREAK if wanted is MountVerdict.DEGRADED else STREAK
    return (wanted, wanted, 0) if streak >= needed else (state.verdict, wanted, streak)


def _verdict(
    now: MountVerdict, mount: MountFilter, cues: MountCues, rows: Floats, confirmations: int, params: MountCheckParams
) -> MountVerdict:
    """The verdict by this measurement. confirmations: see `_confirmations`."""
    error = mount.mean[:2]
    size = float(math.hypot(error[0], error[1]))
    sd = _sd_along(mount.P[:2, :2], error / size) if size > 0.0 else 0.0
    degraded = math.radians(params.degraded_deg)
    if confirmations >= CONFIRMATIONS or (now is MountVerdict.ERROR and confirmations > 0):
        return MountVerdict.ERROR
    slope = np.array([cues.slope_x_rad, cues.slope_y_rad])
    steep = cues.slope_rad
    if steep > 0.0:
        B, along = rows[:, :3], slope / steep
        most = abs(float(along @ B @ mount.mean[:3])) + VERIFIED_SDS * _sd_along(B @ mount.P[:3, :3] @ B.T, along)
        known = most <= math.radians(params.unverified_deg)
        if steep >= math.radians(params.unverified_deg) and not known and cues.walls is not Walls.VERTICAL:
            return MountVerdict.UNVERIFIED_SLOPE
    if size >= KEEP * degraded and sd <= min(DEGRADED_SD_RAD, size / DEGRADED_SDS):
        return MountVerdict.DEGRADED
    worst = math.sqrt(max(float(mount.P[0, 0]), float(mount.P[1, 1])))
    return MountVerdict.VERIFIED if worst <= DEGRADED_SD_RAD else MountVerdict.UNKNOWN


def _sd_along(P: Floats, direction: Floats) -> float:
    return math.sqrt(max(0.0, float(direction @ P @ direction)))


def rotation_vector(x: float, y: float, z: float) -> Floats:
    """(3, 3) rotation by the angle |(x, y, z)| rad about that vector (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + math.sin(angle) / angle * K + (1.0 - math.cos(angle)) / angle**2 * (K @ K)
