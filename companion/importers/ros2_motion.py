"""Attitude and position from ROS messages: Odometry, PoseStamped, Imu and transforms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.types import AttitudeSample, PoseSample

from .ros2_decode import IMU, ODOMETRY
from .ros2_frames import (
    IDENTITY,
    Rigid,
    TransformTree,
    quaternion_wxyz,
    rigid,
    rotation_from_message,
    to_frd,
    to_ned,
    triple,
)
from .ros2_px4 import (
    POSE_NED,
    PX4_TYPES,
    VEHICLE_ATTITUDE,
    VEHICLE_LOCAL_POSITION,
    VEHICLE_ODOMETRY,
    VELOCITY_BODY,
    VELOCITY_NED,
    Px4Place,
    px4_place,
    px4_rotation,
    px4_vector,
)

Between = Callable[[str, str], Rigid | None]
"""(target frame, source frame) -> transform; None where no chain connects them."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """One message in its own frames. t_m None: no position; rates and velocity are in the body frame."""

    t_ns: int
    log_ns: int
    R_world_body: NDArray[np.float64]
    t_m: NDArray[np.float64] | None
    rates: NDArray[np.float64] | None
    velocity: NDArray[np.float64] | None
    world: str
    body: str
    reset_counter: int = 0


class Motion:
    """Collects readings by topic and converts them to samples of the vehicle."""

    def __init__(self, base_frame: str) -> None:
        self._base = base_frame
        self._readings: dict[str, list[Reading]] = {}
        self._px4: dict[str, str] = {}
        self._places: dict[str, list[Px4Place]] = {}
        self.unusable: Counter[str] = Counter()
        """Topic -> number of messages that were not rotations, or of a failed estimator."""
        self.invalid_positions: Counter[str] = Counter()
        """Topic -> number of messages of PX4 whose position is not valid, or in a frame that does not point north."""
        self.without_orientation: Counter[str] = Counter()
        """Topic -> number of Imu messages that are marked as having no orientation."""
        self.tree = TransformTree()
        """The newest transforms, the constant ones included."""

    def attitude_topics(self) -> list[str]:
        """Topics with rotations; transforms only where there is no other topic, since they are usually derived from
        one."""
        has_values = [t for t in self._readings if not t.endswith("/tf")]
        px4 = [t for t, kind in self._px4.items() if kind == VEHICLE_ATTITUDE and t in self._readings]
        if px4:  # PX4 publishes the same attitude as VehicleOdometry too
            has_values = [t for t in has_values if t not in self._px4 or t in px4]
        return sorted(has_values or self._readings)

    def pose_topics(self) -> list[str]:
        """Topics with positions; transforms only where there is no other topic."""
        placed = [t for t, r in self._readings.items() if any(x.t_m is not None for x in r)] + list(self._places)
        return sorted([t for t in placed if not t.endswith("/tf")] or placed)

    def usual_pose_topic(self, attitude: str) -> str | None:
        """The position that belongs to an attitude; None where several may. Of PX4 it is VehicleLocalPosition, if recorded:
        only that has a validity flag."""
        if attitude in self._px4 and len(self._places) == 1:
            return next(iter(self._places))
        topics = self.pose_topics()
        return attitude if attitude in topics else topics[0] if len(topics) == 1 else None

    def is_unconfirmed(self, topic: str | None) -> bool:
        """Whether a topic is a VehicleOdometry, which PX4 sends also while its position is not valid."""
        return topic is not None and self._px4.get(topic) == VEHICLE_ODOMETRY

    def add_message(self, topic: str, kind: str, message: Any, t_ns: int, log_ns: int) -> None:
        """Adds one message of a type in MOTION_TYPES."""
        if kind in PX4_TYPES:
            self._add_px4(topic, kind, message, t_ns, log_ns)
            return
        world, body = message.header.frame_id, self._base
        rates = velocity = t_m = None
        if kind == IMU:
            if message.orientation_covariance[0] == -1.0:  # means "no orientation" by the message's definition
                self.without_orientation[topic] += 1
                return
            R = rotation_from_message(message.orientation)
            world, body = "", message.header.frame_id or self._base
            rates = _vector(message.angular_velocity)
        else:
            pose = message.pose.pose if kind == ODOMETRY else message.pose
            placed = rigid(pose.position, pose.orientation)
            R, t_m = (placed.R, placed.t_m) if placed is not None else (None, None)
            if kind == ODOMETRY:
                body = message.child_frame_id or self._base
                rates, velocity = _vector(message.twist.twist.angular), _vector(message.twist.twist.linear)
        if R is None:
            self.unusable[topic] += 1
        else:
            self._add(topic, Reading(t_ns, log_ns, R, t_m, rates, velocity, world, body))

    def _add_px4(self, topic: str, kind: str, message: Any, t_ns: int, log_ns: int) -> None:
        """A message of PX4, whose ned and frd become the world and base frames of the other readings."""
        self._px4[topic] = kind
        if kind == VEHICLE_LOCAL_POSITION:
            place = px4_place(message, t_ns, log_ns)
            if place is None:
                self.invalid_positions[topic] += 1
            else:
                self._places.setdefault(topic, []).append(place)
            return
        R_ned_frd = px4_rotation(message)
        if R_ned_frd is None or (kind == VEHICLE_ODOMETRY and message.quality < 0):  # negative: the estimator failed
            self.unusable[topic] += 1
            return
        R_world_ned, R_frd_base = to_ned("").T, to_frd(self._base)
        rates = velocity = t_m = None
        reset_counter = 0
        if kind != VEHICLE_ATTITUDE:
            position, rates = px4_vector(message.position), px4_vector(message.angular_velocity)
            velocity, reset_counter = _px4_velocity(message, R_ned_frd), int(message.reset_counter)
            if message.pose_frame != POSE_NED:
                self.invalid_positions[topic] += 1
                position = None
            t_m = None if position is None else R_world_ned @ position
            rates, velocity = (None if v is None else R_frd_base.T @ v for v in (rates, velocity))
        R = R_world_ned @ R_ned_frd @ R_frd_base
        self._add(topic, Reading(t_ns, log_ns, R, t_m, rates, velocity, "", self._base, reset_counter))

    def restamp(self, topic: str, stamp_ns: Callable[[int], int]) -> None:
        """Maps the stamps of a topic to another clock."""
        if topic in self._places:
            self._places[topic] = [replace(p, t_ns=stamp_ns(p.t_ns)) for p in self._places[topic]]
        else:
            self._readings[topic] = [replace(r, t_ns=stamp_ns(r.t_ns)) for r in self._readings[topic]]

    def px4_points(self) -> dict[str, list[tuple[int, int]]]:
        """(stamp, log time), ns, of each topic of PX4."""
        found: dict[str, list[Reading] | list[Px4Place]] = {**self._readings, **self._places}
        return {t: [(r.t_ns, r.log_ns) for r in found[t]] for t in self._px4 if t in found}

    def add_moving(self, topic: str, message: Any, t_ns: int, log_ns: int) -> None:
        """Adds a changing geometry_msgs/TransformStamped; one of the base frame is a reading."""
        placed = rigid(message.transform.translation, message.transform.rotation)
        if placed is None:
            self.unusable[topic] += 1
            return
        self.tree.add(message.header.frame_id, message.child_frame_id, placed)
        if message.child_frame_id.lstrip("/") == self._base:
            world, total = self.tree.root_from(self._base)
            self._add(topic, Reading(t_ns, log_ns, total.R, total.t_m, None, None, world, self._base))

    def _add(self, topic: str, reading: Reading) -> None:
        self._readings.setdefault(topic, []).append(reading)

    def hint(self) -> str:
        """For a recording without attitude: what was found instead, and what to do."""
        expected = (
            "expected Odometry, PoseStamped, Imu with an orientation, VehicleAttitude or VehicleOdometry of PX4, or "
            "transforms of the base frame (--base-frame); or give the autopilot's log with --tlog"
        )
        if self.unusable:
            topic, number = self.unusable.most_common(1)[0]
            return (
                f"the {number} messages of {topic} have a position or an orientation that is not valid (not finite, no unit "
                f"quaternion, or of a failed estimator): record while the estimator runs; {expected}"
            )
        if not self.without_orientation:
            return expected
        topic, number = self.without_orientation.most_common(1)[0]
        return (
            f"the {number} Imu messages of {topic} are marked as having no orientation (orientation_covariance[0] = -1), only "
            "rates and acceleration, which give no attitude: run a filter such as imu_filter_madgwick over the recording, "
            f"or record the autopilot's attitude; {expected}"
        )

    def attitudes(self, topic: str, between: Between) -> list[AttitudeSample]:
        """Attitudes of the base frame, ned from frd, in file order. Rates that are always zero were never filled in (a
        gyro has noise) and are left out."""
        has_values = any(r.rates is not None and r.rates.any() for r in self._readings[topic])
        out = []
        for r in self._readings[topic]:
            joined = between(r.body, self._base)
            # where no chain connects the frames they are assumed to be the same body, each with the axes of its name
            R_frd_body = to_frd(r.body) if joined is None else to_frd(self._base) @ joined.R.T
            R = to_ned(r.world) @ r.R_world_body @ R_frd_body.T
            rates = None if r.rates is None or not has_values else triple(R_frd_body @ r.rates)
            out.append(AttitudeSample(r.t_ns, r.log_ns, quaternion_wxyz(R), rates))
        return out

    def poses(self, topic: str, between: Between) -> list[PoseSample]:
        """Positions of the base frame in ned, in file order. Velocities that are always zero are left out."""
        if topic in self._places:
            return [
                PoseSample(p.t_ns, p.log_ns, p.position_ned_m, p.velocity_ned_m_s, p.reset_counter)
                for p in self._places[topic]
            ]
        has_values = any(r.velocity is not None and r.velocity.any() for r in self._readings[topic])
        out = []
        for r in self._readings[topic]:
            if r.t_m is None:
                continue
            lever_m = r.R_world_body @ (between(r.body, self._base) or IDENTITY).t_m  # no chain: the same body
            R_ned_world = to_ned(r.world)
            velocity = (
                None if r.velocity is None or not has_values else triple(R_ned_world @ r.R_world_body @ r.velocity)
            )
            position = triple(R_ned_world @ (r.t_m + lever_m))
            out.append(PoseSample(r.t_ns, r.log_ns, position, velocity, r.reset_counter))
        return out

    def unconnected_frames(self, topic: str, between: Between) -> list[str]:
        """Body frames of a topic that no chain connects with the base frame; assumed to be the same body."""
        bodies = {r.body for r in self._readings[topic]} - {self._base}
        return sorted(body for body in bodies if between(body, self._base) is None)


def _px4_velocity(message: Any, R_ned_frd: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The velocity of a VehicleOdometry in frd; None when it is not finite or in another frame."""
    velocity = px4_vector(message.velocity)
    if velocity is None or message.velocity_frame not in (VELOCITY_NED, VELOCITY_BODY):
        return None
    return velocity if message.velocity_frame == VELOCITY_BODY else R_ned_frd.T @ velocity


def _vector(v: Any) -> NDArray[np.float64] | None:
    out = np.array([v.x, v.y, v.z], dtype=np.float64)
    return out if np.isfinite(out).all() else None
