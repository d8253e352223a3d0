"""Checks, frame by frame, if a camera is mounted as configured.

A mount that is wrong in roll or pitch makes level ground appear inclined and vertical walls lean. Terrain inclines
the ground, too. Two cues separate them: walls (mount_cues.py), and turns of the vehicle (mount_filter.py). As long as
neither does, a large apparent slope makes frames invalid, because free space would be free under one of both
explanations only."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..frames import euler_from_rotation, rotation_from_euler
from ..types import CameraMount
from .mount_cues import MountCues, Walls
from .mount_filter import SLOPE_SD_RAD, FilterState, MountFilter, sd_along, slope_rows
from .mount_params import MountCheckParams

NS = 1_000_000_000
FIRST_MEASUREMENTS = 10
"""Number of frames that are measured one after the other; then one per interval_s."""
STREAK, DEGRADED_STREAK = 3, 10
"""Consecutive measurements that must agree before the verdict changes; before it becomes DEGRADED, which is not
urgent."""
ERROR_SDS, ERROR_SD_RAD = 4.0, math.radians(1.2)
"""An error that makes frames invalid has at least ERROR_SDS standard deviations, each of at most ERROR_SD_RAD."""
DEGRADED_SDS, DEGRADED_SD_RAD = 3.0, math.radians(0.35)
KEEP = 0.8
"""Share of the threshold down to which a reported error is kept, because the estimate has noise."""
CONFIRMATIONS, WALL_CONFIRMATIONS = 100, 34
"""Consecutive measurements that must estimate an error before it is reported, and the number for which one counts
whose walls lean. Within a short turn, rolling terrain looks like a wrong mount."""
RESIDUAL_S, MAX_RESIDUAL_RAD = 1.0, math.radians(0.4)
"""Time constant of the mean residual of the slope in ned, and its greatest value for terrain that is one plane. White
noise of the attitude, or a wrong mount, cause less."""
RESTLESS_PER_SQRT_S = 3.0
"""Increase of the terrain's random walk, in rad/sqrt(s) per rad of residual above MAX_RESIDUAL_RAD."""
FASTEST_TILT_RAD_S = math.radians(15.0)
"""Tilt rate of the vehicle above which nothing is measured. An attitude that is late by an unknown delay is then wrong, and
inclines ground and walls by the same angle, as a wrong mount does: by 3 degrees for 0.2 s."""
CONFIRMED_SDS = 2.0
"""Standard deviations by which the apparent slope of level ground may differ from level, see `confirmed_by_ground`."""
VERIFIED_SDS = 2.0
"""A slope belongs to the terrain if the error of the mount in its direction, and this many standard deviations, are
less than unverified_deg."""

Floats = NDArray[np.float64]


class MountVerdict(IntEnum):
    """Verdict on the mount, in the order of urgency."""

    UNKNOWN = 0
    """No evidence of an error, and not enough to verify the mount."""
    VERIFIED = 1
    DEGRADED = 2
    """Wrong by degraded_deg or more."""
    UNVERIFIED_SLOPE = 3
    """A large slope that may be a wrong mount: frames are invalid."""
    ERROR = 4
    """Wrong by invalid_deg or more: frames are invalid."""

    @property
    def invalid(self) -> bool:
        """True if frames are invalid."""
        return self >= MountVerdict.UNVERIFIED_SLOPE


@dataclass(frozen=True, slots=True)
class MountState:
    """State of the check, which one frame passes to the next."""

    t_ns: int | None = None  # newest measurement; None: there was none
    measurements: int = 0  # number of measurements
    verdict: MountVerdict = MountVerdict.UNKNOWN  # present verdict
    pending: MountVerdict = MountVerdict.UNKNOWN  # verdict that the newest measurements support
    streak: int = 0  # number of these measurements
    slope_rad: float = 0.0  # apparent slope of the newest surface that may be the ground
    ground: bool = False  # the newest measurement found such a surface
    confirmations: int = 0  # consecutive measurements that estimate an error
    residual_rad: tuple[float, float] = (0.0, 0.0)  # mean residual of the slope, north and east
    filter: FilterState = field(default_factory=FilterState)  # state of the filter
    # first stamp after the newest jump of the heading by which north and east of the terrain are those of the
    # autopilot's estimate; 0: there was none
    heading_jump_ns: int = 0

    @property
    def error_rad(self) -> tuple[float, float]:
        """Error of the mount in roll and pitch, true minus configured, as rotations about frd x and y."""
        return self.filter.mean[0], self.filter.mean[1]

    @property
    def error_sd_rad(self) -> tuple[float, float]:
        """Standard deviations of the error."""
        return math.sqrt(max(0.0, self.filter.covariance[0])), math.sqrt(max(0.0, self.filter.covariance[5]))

    def restarted(self) -> MountState:
        """Returns the state after a restart of the camera, whose stamps begin again.

        A verdict against the mount is kept: the mount has not changed. A verified mount is verified again."""
        return replace(self, t_ns=None) if self.verdict >= MountVerdict.DEGRADED else MountState()

    def corrected(self, mount: CameraMount) -> tuple[float, float, float]:
        """Returns (roll, pitch, yaw) in rad of the mount as measured, with the configured yaw.

        Gravity in the camera's axes determines roll and pitch for any yaw. For a camera that looks down, a rotation
        about frd x and y changes the yaw as well; that change is not a measurement."""
        x, y = self.error_rad
        R = rotation_about(x, y, 0.0) @ rotation_from_euler(mount.roll_rad, mount.pitch_rad, mount.yaw_rad)
        roll_rad, pitch_rad, _ = euler_from_rotation(R)
        return roll_rad, pitch_rad, mount.yaw_rad


def due(state: MountState, t_ns: int, params: MountCheckParams, tilt_rad_s: float = 0.0) -> bool:
    """True if the frame at t_ns must be measured. tilt_rad_s: rate at which the vehicle tilts."""
    if not params.enabled or tilt_rad_s > FASTEST_TILT_RAD_S:
        return False
    if state.t_ns is None or state.measurements < FIRST_MEASUREMENTS:
        return True
    return t_ns - state.t_ns >= round(params.interval_s * NS)


def checked(
    state: MountState,
    t_ns: int,
    cues: MountCues,
    R_ned_frd: Floats,
    heading_rad: float,
    params: MountCheckParams,
    heading_jump_ns: int = 0,
) -> MountState:
    """Returns the state after a measurement at t_ns.

    Args:
        state: the state before.
        t_ns: exposure.
        cues: cues of the frame, in level_cam.
        R_ned_frd: (3, 3) attitude.
        heading_rad: heading of the x axis of level_cam.
        params: parameters.
        heading_jump_ns: first stamp after the newest jump of the heading, known or possible, that is in the attitude; 0: there
            was none. A jump is no turn of the vehicle: it would give the slope of the terrain to the mount."""
    mount = MountFilter(state.filter)
    if heading_jump_ns != state.heading_jump_ns:
        mount.forget_terrain()
        state = replace(state, heading_jump_ns=heading_jump_ns)
    dt_s = 0.0 if state.t_ns is None else (t_ns - state.t_ns) / NS
    restless_rad = max(0.0, math.hypot(*state.residual_rad) - MAX_RESIDUAL_RAD)
    mount.predict(dt_s, math.radians(params.terrain_deg_per_sqrt_s) + RESTLESS_PER_SQRT_S * restless_rad)
    if not cues.ground:  # no measurement; the verdict is kept
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
        t_ns=t_ns,
        measurements=state.measurements + 1,
        verdict=verdict,
        pending=pending,
        streak=streak,
        slope_rad=size,
        ground=True,
        confirmations=confirmations,
        residual_rad=residual,
        filter=mount.state(),
        heading_jump_ns=heading_jump_ns,
    )


def confirmed_by_ground(
    state: MountState,
    R_ned_frd: Floats,
    heading_rad: float,
    params: MountCheckParams,
    heading_jump_ns: int = 0,
) -> bool:
    """True if the ground in the direction of a heading appears level, within degraded_deg by CONFIRMED_SDS standard
    deviations of the least certain direction.

    One heading gives the sum of the mount's error and the terrain's slope. A slope that cancels an error hides it, so
    this does not verify the mount. But then the ground is as far from level as from the axes of the mount, so that
    what is judged relative to the ground is correct. heading_rad: heading of the x axis of level_cam. heading_jump_ns: see
    `checked`; ground that was measured before a jump confirms nothing."""
    if state.verdict is not MountVerdict.UNKNOWN or heading_jump_ns != state.heading_jump_ns:
        return False
    rows = slope_rows(rotation_from_euler(0.0, 0.0, -heading_rad) @ R_ned_frd, heading_rad)
    mount = MountFilter(state.filter)
    size = float(np.hypot(*(rows @ mount.mean)))
    xx, xy, yy = (float((rows @ mount.P @ rows.T)[i]) for i in ((0, 0), (0, 1), (1, 1)))
    variance = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)  # the greater eigenvalue
    return size + CONFIRMED_SDS * math.sqrt(variance) <= math.radians(params.degraded_deg)


def _residual(state: MountState, dt_s: float, rows: Floats, cues: MountCues, mount: MountFilter) -> tuple[float, float]:
    """Returns the mean residual north and east, with this measurement. A less precise measurement has less weight."""
    share = 1.0 - math.exp(-max(0.0, dt_s) / RESIDUAL_S)
    share *= SLOPE_SD_RAD**2 / (SLOPE_SD_RAD**2 + cues.slope_sd_rad**2)
    along = np.array([cues.slope_x_rad, cues.slope_y_rad]) - rows @ mount.mean
    north, east = (
        mean + share * (float(v) - mean) for mean, v in zip(state.residual_rad, rows[:, 3:].T @ along, strict=True)
    )
    return north, east


def _confirmations(
    state: MountState, mount: MountFilter, cues: MountCues, residual: tuple[float, float], params: MountCheckParams
) -> int:
    """Returns the number of consecutive measurements that estimate an error.

    While the residual is large, the terrain is not a plane, and no measurement counts."""
    size, sd = mount.error()
    keep = KEEP if state.verdict is MountVerdict.ERROR else 1.0
    if size < keep * math.radians(params.invalid_deg):
        return 0
    if sd > min(ERROR_SD_RAD, size / ERROR_SDS):
        return 0
    if cues.walls is Walls.LEANING:
        return min(CONFIRMATIONS, state.confirmations + WALL_CONFIRMATIONS)
    if math.hypot(*residual) > MAX_RESIDUAL_RAD:
        return state.confirmations
    return min(CONFIRMATIONS, state.confirmations + 1)


def settled(state: MountState, wanted: MountVerdict) -> tuple[MountVerdict, MountVerdict, int]:
    """Returns (verdict, pending, streak). A verdict changes after enough consecutive measurements that support
    another one."""
    if wanted is state.verdict:
        return state.verdict, wanted, 0
    # verdicts that invalidate frames agree in that, and so do verdicts that make frames valid again
    alike = wanted is state.pending or (wanted.invalid and state.pending.invalid)
    alike = alike or (state.verdict.invalid and not wanted.invalid and not state.pending.invalid)
    streak = state.streak + 1 if alike and state.streak else 1
    needed = DEGRADED_STREAK if wanted is MountVerdict.DEGRADED else STREAK
    return (wanted, wanted, 0) if streak >= needed else (state.verdict, wanted, streak)


def _verdict(
    now: MountVerdict, mount: MountFilter, cues: MountCues, rows: Floats, confirmations: int, params: MountCheckParams
) -> MountVerdict:
    """Returns the verdict of this measurement. confirmations: of `_confirmations`."""
    size, sd = mount.error()
    degraded = math.radians(params.degraded_deg)
    if confirmations >= CONFIRMATIONS or (now is MountVerdict.ERROR and confirmations > 0):
        return MountVerdict.ERROR
    slope = np.array([cues.slope_x_rad, cues.slope_y_rad])
    steep = cues.slope_rad
    if steep > 0.0:
        B, along = rows[:, :3], slope / steep
        most = abs(float(along @ B @ mount.mean[:3])) + VERIFIED_SDS * sd_along(B @ mount.P[:3, :3] @ B.T, along)
        known = most <= math.radians(params.unverified_deg)
        if steep >= math.radians(params.unverified_deg) and not known and cues.walls is not Walls.VERTICAL:
            return MountVerdict.UNVERIFIED_SLOPE
    if size >= KEEP * degraded and sd <= min(DEGRADED_SD_RAD, size / DEGRADED_SDS):
        return MountVerdict.DEGRADED
    worst = math.sqrt(max(float(mount.P[0, 0]), float(mount.P[1, 1])))
    return MountVerdict.VERIFIED if worst <= DEGRADED_SD_RAD else MountVerdict.UNKNOWN


def rotation_about(x: float, y: float, z: float) -> Floats:
    """Returns the rotation (3, 3) by the angle |(x, y, z)| rad about that vector (Rodrigues)."""
    angle = math.sqrt(x * x + y * y + z * z)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-12:
        return np.eye(3) + K
    return np.eye(3) + math.sin(angle) / angle * K + (1.0 - math.cos(angle)) / angle**2 * (K @ K)
