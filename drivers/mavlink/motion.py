"""Converts the autopilot's messages of motion to samples on the local clock. Values that are not finite are refused, and rates and
velocities that no vehicle has."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any

from core.frames import quaternion_from_euler, rotation_from_quaternion
from core.types import MAX_RATE_RAD_S, MAX_SPEED_M_S, AttitudeSample, PoseSample

from .anomalies import LinkAnomaly
from .clock_bounds import NS
from .clock_sync import UNKNOWN_DELAY_NS, ClockEstimate, ClockFilter, ClockSource
from .contradictory_attitude import ContradictoryAttitude, Quaternion
from .dialect import dialect
from .parser import Frame
from .repeated_attitude import RepeatedAttitude
from .repeated_position import RepeatedPosition
from .session_types import ATTITUDE_ID, ATTITUDE_QUATERNION_ID, LOCAL_POSITION_NED_ID

MS = 1_000_000
HALF_MS = 500_000
"""time_boot_ms is rounded down: on average the measurement is half a millisecond later."""
PREFER_FOR_NS = NS // 2
"""Time for which a better kind of message replaces a poorer one."""
MAX_ANGLE_RAD = 2.0 * math.pi + 1e-3
"""Greatest angle of an attitude."""
UNIX_NS = 10**17
"""Stamps beyond 3 years are no time since boot: some senders use unix time in time_usec."""
ODOMETRY_ID = dialect.MAVLINK_MSG_ID_ODOMETRY
MOTION = frozenset({ATTITUDE_ID, ATTITUDE_QUATERNION_ID, LOCAL_POSITION_NED_ID, ODOMETRY_ID})
_FIELDS = {
    ATTITUDE_ID: struct.Struct("<I6f"),
    ATTITUDE_QUATERNION_ID: struct.Struct("<I7f"),
    LOCAL_POSITION_NED_ID: struct.Struct("<I6f"),
}
"""time_boot_ms and the numbers of the messages that arrive a hundred times per second, as in the payload. Decoding by
the dialect would take as long as all other steps of a sample together."""
MOST_BETWEEN = 4
"""ODOMETRY is not used where more LOCAL_POSITION_NED than this arrive between two of it: its position and velocity would be older.
Single lost messages do not change the kind, which would begin a new section of the position."""
CONFIRMED_FOR_NS = NS
"""Time after a LOCAL_POSITION_NED for which ODOMETRY is used."""
LOCAL_NED = dialect.MAV_FRAME_LOCAL_NED
"""MAV_FRAME_LOCAL_FRD points where the vehicle looked at the start, not north as the attitude."""
OWN_ESTIMATORS = frozenset({dialect.MAV_ESTIMATOR_TYPE_UNKNOWN, dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT})
"""With `MAV_ODOM_LP` PX4 returns the odometry of another computer in place of
its own estimate (MAV_ESTIMATOR_TYPE_VISION): it has another origin, and a timestamp that depends on PX4's estimate of that
computer's clock."""
LOCAL_FRAMES = frozenset({LOCAL_NED, dialect.MAV_FRAME_LOCAL_FRD})
"""Frames of a velocity in ned: PX4 up to v1.13 calls ned MAV_FRAME_LOCAL_FRD there."""
BODY_FRAMES = frozenset({dialect.MAV_FRAME_BODY_NED, dialect.MAV_FRAME_BODY_FRD})
"""The velocity of ODOMETRY is in body axes."""


class MotionDecoder:
    """Converts ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED and ODOMETRY to samples.

    Of two kinds with the same content the better one is used: the quaternion (no gimbal lock), and ODOMETRY (it
    reports jumps of the estimate). PX4 sends ODOMETRY also while its position is not valid (EKF2::PublishOdometry), and
    LOCAL_POSITION_NED only while position and velocity are; ArduPilot likewise. ODOMETRY is therefore used only while
    LOCAL_POSITION_NED arrives, and not much more often than it. No sample is made while it is not known whose the messages are.
    counts: refused messages, by cause."""

    def __init__(
        self,
        clock: ClockFilter,
        two_clocks_answer: Callable[[int], bool] = lambda now_ns: False,
        several_vehicles: Callable[[int], bool] = lambda now_ns: False,
    ) -> None:
        """Creates a decoder.

        Args:
            clock: of the autopilot.
            two_clocks_answer: returns whether requests of TIMESYNC are answered by two clocks, at a local instant.
            several_vehicles: returns whether the received vehicle may not be the own one, at a local instant."""
        self._clock = clock
        self._two_clocks_answer, self._several_vehicles = two_clocks_answer, several_vehicles
        # of each kind: older versions of ArduPilot correct ATTITUDE alone by AHRS_TRIM
        self._contradictory = {kind: ContradictoryAttitude() for kind in (ATTITUDE_ID, ATTITUDE_QUATERNION_ID)}
        self._quaternion_ns: int | None = None
        self._odometry_ns: int | None = None
        self._local_ns: int | None = None
        self._locals_since = 0  # the newest ODOMETRY
        self._repeats = {kind: RepeatedAttitude() for kind in (ATTITUDE_ID, ATTITUDE_QUATERNION_ID)}
        self._positions = {kind: RepeatedPosition() for kind in (LOCAL_POSITION_NED_ID, ODOMETRY_ID)}
        self._repeated_ns: int | None = None  # arrival of the newest attitude of a kind that repeats itself
        self.counts: Counter[LinkAnomaly] = Counter()

    def wants(self, message_id: int, arrival_ns: int) -> bool:
        """True if such a message would be decoded now: it is of motion, and no better kind replaces it, or the better kind
        repeats itself: then it is examined whether this one does too."""
        if message_id == ATTITUDE_ID:
            return not _recent(self._quaternion_ns, arrival_ns) or self.attitude_repeated(arrival_ns)
        return message_id in MOTION

    def decode(self, frame: Frame, arrival_ns: int) -> AttitudeSample | PoseSample | None:
        """Returns the sample in a message of motion, or None."""
        fields = motion_fields(frame)
        if fields is None:
            message = frame.message()
            if message is None:
                self.counts[LinkAnomaly.UNDECODABLE_MESSAGE] += 1
                return None
            return self._odometry(message, arrival_ns)
        return _READERS[frame.id](self, int(fields[0]), fields[1:], arrival_ns)

    def _accepted(self, boot_ns: int, arrival_ns: int) -> bool:
        """Returns whether the clock accepts the timestamp of a message."""
        accepted = self._clock.arrival(boot_ns, arrival_ns)
        self.counts[LinkAnomaly.STAMP_BEHIND] += not accepted
        return accepted

    def _stamp(self, boot_ns: int, rounded_ns: int, arrival_ns: int) -> int | None:
        """Returns an accepted instant of the autopilot's boot clock on the local clock, at most the time of arrival; None while no
        sample is made."""
        if not self._clock.usable or self._whose_is_unknown(arrival_ns):
            return None
        estimate: ClockEstimate = self._clock.estimate
        t_ns = estimate.local_ns(boot_ns + rounded_ns)
        if t_ns > arrival_ns:
            self.counts[LinkAnomaly.STAMP_AFTER_ARRIVAL] += t_ns > arrival_ns + MS  # less is rounding on a quick line
            t_ns = arrival_ns
        return t_ns

    def two_vehicles(self, now_ns: int) -> bool:
        """Returns whether a second vehicle sends with the autopilot's ids: two clocks answer, or attitudes contradict each other."""
        return self._two_clocks_answer(now_ns) or any(c.found(now_ns) for c in self._contradictory.values())

    def _whose_is_unknown(self, now_ns: int) -> bool:
        """Returns whether messages may be of another vehicle than the own one: also where timestamps contradict each other and no
        answer shows which of them are the autopilot's."""
        mixed = self._clock.estimate.source is not ClockSource.TIMESYNC and self._clock.mixed(now_ns)
        return mixed or self.two_vehicles(now_ns) or self._several_vehicles(now_ns)

    def _stamp_error_ns(self) -> int:
        """Returns the greatest error of a stamp."""
        bound_ns = self._clock.estimate.bound_ns
        return UNKNOWN_DELAY_NS if bound_ns is None else max(1, bound_ns)

    def _repeats_itself(self, kind: int, boot_ns: int, numbers: tuple[float, ...], arrival_ns: int) -> bool:
        """Takes an attitude that is used otherwise; returns whether it must not be used because it repeats the one before, or its
        kind repeats itself."""
        repeats = self._repeats[kind]
        refused = repeats.take(boot_ns, numbers[:-3])
        if repeats.repeated:
            self._repeated_ns = arrival_ns
        self.counts[LinkAnomaly.ATTITUDE_REPEATED] += refused
        return refused

    def attitude_repeated(self, now_ns: int) -> bool:
        """Returns whether attitudes arrive that are refused because they repeat an earlier one."""
        return _recent(self._repeated_ns, now_ns)

    def _attitude(self, time_boot_ms: int, numbers: tuple[float, ...], arrival_ns: int) -> AttitudeSample | None:
        angles = within(numbers[:3], MAX_ANGLE_RAD)
        if angles is None:
            self.counts[LinkAnomaly.ATTITUDE_NON_FINITE] += 1
            return None
        sample = self._attitude_sample(ATTITUDE_ID, time_boot_ms, numbers, quaternion_from_euler(*angles), arrival_ns)
        return None if _recent(self._quaternion_ns, arrival_ns) else sample

    def _attitude_quaternion(
        self, time_boot_ms: int, numbers: tuple[float, ...], arrival_ns: int
    ) -> AttitudeSample | None:
        w, x, y, z = numbers[:4]
        norm = math.sqrt(w * w + x * x + y * y + z * z)
        if not abs(norm - 1.0) < 0.05:  # also NaN
            self.counts[LinkAnomaly.ATTITUDE_NON_FINITE] += 1
            return None
        q = (w / norm, x / norm, y / norm, z / norm)
        sample = self._attitude_sample(ATTITUDE_QUATERNION_ID, time_boot_ms, numbers, q, arrival_ns)
        self._quaternion_ns = self._quaternion_ns if sample is None else arrival_ns
        return sample

    def _attitude_sample(
        self, kind: int, time_boot_ms: int, numbers: tuple[float, ...], q: Quaternion, arrival_ns: int
    ) -> AttitudeSample | None:
        """Returns the sample of an attitude whose numbers are valid; None if it must not be used."""
        boot_ns = self._clock.boot_ns(time_boot_ms)
        if not self._accepted(boot_ns, arrival_ns) or self._repeats_itself(kind, boot_ns, numbers, arrival_ns):
            return None
        rates = measured_rates(numbers[-3:])
        self._contradictory[kind].take(boot_ns, arrival_ns, q, rates)
        t_ns = self._stamp(boot_ns, HALF_MS, arrival_ns)
        return None if t_ns is None else AttitudeSample(t_ns, arrival_ns, q, rates, self._stamp_error_ns())

    def _local_position(self, time_boot_ms: int, numbers: tuple[float, ...], arrival_ns: int) -> PoseSample | None:
        position = within(numbers[:3], math.inf)
        if position is None:
            self.counts[LinkAnomaly.POSITION_NON_FINITE] += 1
            return None
        boot_ns = self._clock.boot_ns(time_boot_ms)
        if not self._accepted(boot_ns, arrival_ns):
            return None
        t_ns = self._stamp(boot_ns, HALF_MS, arrival_ns)
        if t_ns is None:
            return None
        self._local_ns = arrival_ns
        self._locals_since += 1
        if self._repeats_position(LOCAL_POSITION_NED_ID, boot_ns, numbers):
            return None
        if _recent(self._odometry_ns, arrival_ns) and self._locals_since <= MOST_BETWEEN:
            return None
        velocity = within(numbers[3:], MAX_SPEED_M_S)
        return PoseSample(t_ns, arrival_ns, position, velocity, stamp_error_ns=self._stamp_error_ns())

    def _odometry(self, m: Any, arrival_ns: int) -> PoseSample | None:
        position = (float(m.x), float(m.y), float(m.z))
        if int(m.frame_id) != LOCAL_NED or int(m.quality) < 0 or int(m.estimator_type) not in OWN_ESTIMATORS:
            self.counts[LinkAnomaly.ODOMETRY_UNUSABLE] += 1
            return None
        if not _recent(self._local_ns, arrival_ns, CONFIRMED_FOR_NS):
            self.counts[LinkAnomaly.ODOMETRY_UNCONFIRMED] += 1
            return None
        if not all(map(math.isfinite, position)):
            self.counts[LinkAnomaly.POSITION_NON_FINITE] += 1
            return None
        boot_ns = int(m.time_usec) * 1000
        if boot_ns > UNIX_NS:
            self.counts[LinkAnomaly.ODOMETRY_UNIX_TIME] += 1
            return None
        if not self._accepted(boot_ns, arrival_ns):
            return None
        t_ns = self._stamp(boot_ns, 0, arrival_ns)
        if t_ns is None:
            return None
        slower, self._locals_since = self._locals_since > MOST_BETWEEN, 0
        if slower:
            self._odometry_ns = None
            return None
        if self._repeats_position(ODOMETRY_ID, boot_ns, (*position, float(m.vx), float(m.vy), float(m.vz))):
            return None
        self._odometry_ns = arrival_ns
        return PoseSample(
            t_ns, arrival_ns, position, _odometry_velocity(m), int(m.reset_counter), self._stamp_error_ns()
        )

    def _repeats_position(self, kind: int, boot_ns: int, numbers: tuple[float, ...]) -> bool:
        """Takes a position and velocity that are used otherwise; returns whether they repeat those before."""
        refused = self._positions[kind].take(boot_ns, numbers)
        self.counts[LinkAnomaly.POSITION_REPEATED] += refused
        return refused


def motion_fields(frame: Frame) -> tuple[float, ...] | None:
    """Returns time_boot_ms and the numbers of a message of motion that are used here; None for other messages."""
    fields = _FIELDS.get(frame.id)
    return frame.fields(fields) if fields is not None else None


def _recent(received_ns: int | None, now_ns: int, for_ns: int = PREFER_FOR_NS) -> bool:
    return received_ns is not None and now_ns - received_ns < for_ns


def within(numbers: tuple[float, ...], most: float) -> tuple[float, float, float] | None:
    """Returns three numbers; None if one of them is not finite, or exceeds this limit."""
    x, y, z = numbers
    return (x, y, z) if all(map(math.isfinite, numbers)) and max(abs(x), abs(y), abs(z)) <= most else None


def measured_rates(rates_rad_s: tuple[float, ...]) -> tuple[float, float, float] | None:
    """Returns body rates; None if they are not finite, those of no vehicle, or zero about all axes.

    A gyroscope has noise. Senders that do not fill in the rates send zeros, also in a turn (LibrePilot, UAVOMavlinkBridge.c). As
    measured rates they would carry an attitude to an exposure as if the vehicle did not turn, and each turn would be a jump
    of the heading."""
    return within(rates_rad_s, MAX_RATE_RAD_S) if any(rates_rad_s) else None


def _odometry_velocity(m: Any) -> tuple[float, float, float] | None:
    """Returns the velocity in ned. ODOMETRY gives it in child_frame_id."""
    v = within((float(m.vx), float(m.vy), float(m.vz)), MAX_SPEED_M_S)
    if v is None:
        return None
    if int(m.child_frame_id) in LOCAL_FRAMES:
        return v
    q = (float(m.q[0]), float(m.q[1]), float(m.q[2]), float(m.q[3]))
    if int(m.child_frame_id) not in BODY_FRAMES or not abs(math.sqrt(sum(c * c for c in q)) - 1.0) < 0.05:
        return None
    ned = rotation_from_quaternion(q) @ v
    return float(ned[0]), float(ned[1]), float(ned[2])


_READERS = {
    ATTITUDE_ID: MotionDecoder._attitude,
    ATTITUDE_QUATERNION_ID: MotionDecoder._attitude_quaternion,
    LOCAL_POSITION_NED_ID: MotionDecoder._local_position,
}
