"""Model of ArduPilot's proximity boundary and of simple avoidance in LOITER, for tests and the simulated autopilot.

Boundary: eight faces of 45 degrees, in the level frame with the vehicle's heading. 0, 65535 and values outside of min..max
are dropped; a face without a value is clear. Since 4.1 the elements of OBSTACLE_DISTANCE are read in one pass, and the nearest
of successive elements in one face is its distance. The front face holds the first and the last elements, so it is set
twice: its last elements replace the first ones. 4.0 takes the nearest of all elements of a face.

Each face has a low pass, PRX_FILT (0.25 Hz by default). It is advanced by the milliseconds since the face was set last. The
second setting of the front face comes 0 ms after the first and does not change the filtered distance.

Fence: between two faces, 22.5 degrees beside their middles, stands a corner at the filtered distance of the nearer one. The lines
between neighbouring corners are the fence. A wall received in one face is therefore nearer in its middle (by the cosine of
22.5 degrees) and closes the faces beside it; walls in two faces close the one between them.

The corners are set with each face, in the order in which the faces are set, by what is known then. A face that is set also sets
the corner beyond an empty neighbour. Where the face beyond that neighbour was set before, as 0 before 6 and 1 before 7, its
corner is replaced by that of the later face, which may be farther: the fence then is beyond an obstacle.

Sources: AP_Proximity_MAV.cpp (handle_obstacle_distance_msg), AP_Proximity_Boundary_3D.cpp (set_face_attributes, update_boundary,
convert_obstacle_num_to_face), LowPassFilter.cpp (DigitalLPF::apply) and AC_Avoid.cpp (adjust_velocity_proximity) of 4.1 and later.
Not modelled: PRX_IGN_GND, PRX1_MIN, PRX1_MAX, PRX1_ORIENT, PRX1_YAW_CORR, several proximity sensors. The fence of the firmware
lasts until a face is 1.0 to 1.75 s old; here it ends with the health of the sensor after 0.5 s, which is the worse case.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from ...mavlink.ardupilot_faces import FACES, face_of

NS = 1_000_000_000
UNKNOWN = 65535
STALE_NS = NS // 2
"""PROXIMITY_MAV_TIMEOUT_MS."""
HALF_FACE_RAD = math.pi / FACES
FILTER_FORGETS_NS = NS
"""PROXIMITY_FILT_RESET_TIME."""
NEAREST_CORNER_M = 0.6
"""PROXIMITY_BOUNDARY_DIST_MIN."""
FARTHEST_CORNER_M = 100.0
"""PROXIMITY_BOUNDARY_DIST_DEFAULT."""
BACKUP_DEADZONE_M = 0.1
"""Default of AVOID_BACKUP_DZ: within the margin by less than this it does not back away."""

Point = tuple[float, float]
Line = tuple[Point, Point]

LOITER_SPEED_M_S = ((-2.45, -0.77), (-0.23, -0.3), (-0.14, -0.05), (-0.04, 0.02), (0.1, 0.11), (0.23, 0.21))
"""What ArduCopter 4.6 flew in LOITER with the stick forward, AVOID_MARGIN 3 m, before constant walls of 0.6 to 3.5 m in
its front faces: room to the fence in m, m/s."""


def loiter_speed_m_s(room_m: float) -> float:
    """The speed towards the fence that ArduPilot allows at a room (distance less AVOID_MARGIN), by the measured points;
    beyond them as the last two go on, before them as the first."""
    points = LOITER_SPEED_M_S
    if room_m <= points[0][0]:
        return points[0][1]
    for (x0, v0), (x1, v1) in pairwise(points):
        if room_m <= x1:
            return v0 + (v1 - v0) * (room_m - x0) / (x1 - x0)
    (x0, v0), (x1, v1) = points[-2:]
    return v1 + (v1 - v0) / (x1 - x0) * (room_m - x1)


class ArduPilotReader:
    """The proximity boundary of one ArduPilot. one_pass: as since 4.1; False: as 4.0. margin_m: AVOID_MARGIN. filter_hz:
    PRX_FILT, 0: none. slides: AVOID_BEHAVE is 0; otherwise it stops. backs_up: AVOID_BACKUP_SPD is above 0."""

    def __init__(
        self,
        one_pass: bool = True,
        margin_m: float = 2.0,
        filter_hz: float = 0.0,
        slides: bool = False,
        backs_up: bool = True,
    ) -> None:
        self.one_pass, self.margin_m = one_pass, margin_m
        self.filter_hz, self.slides, self.backs_up = filter_hz, slides, backs_up
        self._received_m: list[float] = [math.inf] * FACES
        self._smooth_m: list[float] = [math.inf] * FACES
        self._at_ns: list[int | None] = [None] * FACES
        self._corners_m: list[float] = [FARTHEST_CORNER_M] * FACES
        self._newest_ns: int | None = None

    # ---- received values ----------------------------------------------------------------------------------------------

    def read(self, message: Any, now_ns: int) -> None:
        """Takes a message; its frame is ignored."""
        step = message.increment_f or float(message.increment)
        if step == 0.0:
            return
        settings: list[tuple[int, float]] = []
        for i, cm in enumerate(message.distances[: min(72, int(360.0 / abs(step) + 0.5))]):
            if cm in (0, UNKNOWN) or not message.min_distance <= cm <= message.max_distance:
                continue
            face, distance_m = face_of(i * step + message.angle_offset), cm / 100.0
            if settings and settings[-1][0] == face:
                distance_m = min(distance_m, settings.pop()[1])
            settings.append((face, distance_m))
        if not self.one_pass:
            faces = sorted({face for face, _ in settings})
            settings = [(face, min(m for other, m in settings if other == face)) for face in faces]
        self._set_faces(settings, now_ns)

    def take_faces(self, faces_m: list[float], now_ns: int) -> None:
        """The nearest of each face, as one scan reported them; inf: nothing there."""
        self._set_faces([(face, m) for face, m in enumerate(faces_m) if math.isfinite(m)], now_ns)

    def _set_faces(self, settings: list[tuple[int, float]], now_ns: int) -> None:
        """Clears all faces, and sets these to a distance in m, one after the other."""
        self._newest_ns = now_ns
        self._received_m = [math.inf] * FACES
        for face, measured_m in settings:
            self._received_m[face] = measured_m
            self._smooth_m[face] = self._smoothed(face, measured_m, now_ns)
            self._at_ns[face] = now_ns
            self._set_corners(face)

    def _set_corners(self, face: int) -> None:
        """Sets the corners that a face has a part in, and those beyond an empty face beside it (update_boundary). Corner k is
        between the faces k and k + 1."""
        after, before, beyond = ((face + step) % FACES for step in (1, -1, -2))
        nearest_m = max(NEAREST_CORNER_M, min(self._filtered_m(face), self._filtered_m(after)))
        self._corners_m[face] = nearest_m
        if math.isinf(self._received_m[after]):
            self._corners_m[after] = nearest_m
        nearest_m = min(self._filtered_m(before), self._filtered_m(face))
        self._corners_m[before] = nearest_m
        if math.isinf(self._received_m[beyond]):
            self._corners_m[beyond] = nearest_m

    def _filtered_m(self, face: int) -> float:
        """Filtered distance of a face; inf: it has none."""
        return self._smooth_m[face] if math.isfinite(self._received_m[face]) else math.inf

    def _smoothed(self, face: int, measured_m: float, now_ns: int) -> float:
        before_ns = self._at_ns[face]
        if before_ns is None or now_ns - before_ns >= FILTER_FORGETS_NS or self.filter_hz <= 0.0:
            return measured_m
        dt_s = (now_ns - before_ns) / NS
        share = dt_s / (dt_s + 1.0 / (math.tau * self.filter_hz))
        return self._smooth_m[face] + share * (measured_m - self._smooth_m[face])

    def healthy(self, now_ns: int) -> bool:
        """Whether it has proximity data. Without them it flies on."""
        return self._newest_ns is not None and now_ns - self._newest_ns <= STALE_NS

    def faces_m(self, now_ns: int) -> list[float]:
        """Distance of each face as received; inf: none, which to it is the same as clear."""
        return list(self._received_m) if self.healthy(now_ns) else [math.inf] * FACES

    # ---- the fence ----------------------------------------------------------------------------------------------------

    def fence(self, now_ns: int) -> list[Line]:
        """The lines it keeps AVOID_MARGIN from, x ahead and y to the right."""
        if not self.healthy(now_ns):
            return []
        corners = [_corner(k, corner_m) for k, corner_m in enumerate(self._corners_m)]
        lines = []
        for k in range(FACES):  # the line over face k + 1
            if any(math.isfinite(self._received_m[(k + step) % FACES]) for step in range(3)):
                lines.append((corners[k], corners[(k + 1) % FACES]))
        return lines

    def room_m(self, direction_deg: float, now_ns: int) -> float:
        """How far the vehicle may still go in a direction; inf where nothing stops it, less than 0 where it backs away."""
        towards = _unit(math.radians(direction_deg))
        room_m = math.inf
        for line in self.fence(now_ns):
            nearest = _nearest(line)
            breach_m = math.hypot(*nearest) - self.margin_m
            if self.backs_up and breach_m < -BACKUP_DEADZONE_M and _dot(nearest, towards) > 0.0:
                room_m = min(room_m, breach_m)
            point = nearest if self.slides else _hit(towards, line)
            if point is not None and _dot(point, towards) > 1e-9:
                distance_m = math.hypot(*point)
                room_m = min(room_m, (distance_m - self.margin_m) * distance_m / _dot(point, towards))
        return room_m

    def velocity_m_s(self, wanted_m_s: Point, now_ns: int) -> Point:
        """What becomes of a wanted horizontal velocity in LOITER, forward and right: limited towards every line of the fence,
        then along each axis at least as fast away as those within the margin want it. That is not limited again: what
        stands behind may push the vehicle slowly towards what stands ahead."""
        x, y = wanted_m_s
        speed = math.hypot(x, y)
        most, least = [0.0, 0.0], [0.0, 0.0]  # of backing away, along each axis either way: opposite ones cancel out
        for line in self.fence(now_ns):
            nearest = _nearest(line)
            breach_m = math.hypot(*nearest) - self.margin_m
            if self.backs_up and breach_m < -BACKUP_DEADZONE_M:
                back = _scaled(nearest, loiter_speed_m_s(breach_m))
                most = [max(m, b) for m, b in zip(most, back, strict=True)]
                least = [min(m, b) for m, b in zip(least, back, strict=True)]
            point = nearest if self.slides else _hit((x / speed, y / speed), line) if speed > 0.0 else None
            if point is None:
                continue
            towards = _scaled(point, 1.0)
            excess = _dot((x, y), towards) - max(0.0, loiter_speed_m_s(math.hypot(*point) - self.margin_m))
            if excess > 0.0:
                x, y = x - excess * towards[0], y - excess * towards[1]
        return _at_least(x, most[0] + least[0]), _at_least(y, most[1] + least[1])


def _at_least(wanted_m_s: float, back_m_s: float) -> float:
    """Along one axis: the way that is wanted, where it leads away as fast as it has to."""
    return max(wanted_m_s, back_m_s) if back_m_s > 0.0 else min(wanted_m_s, back_m_s) if back_m_s < 0.0 else wanted_m_s


def _corner(k: int, distance_m: float) -> Point:
    along = _unit(2.0 * HALF_FACE_RAD * k + HALF_FACE_RAD)
    return distance_m * along[0], distance_m * along[1]


def _unit(angle_rad: float) -> Point:
    return math.cos(angle_rad), math.sin(angle_rad)


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _scaled(a: Point, length: float) -> Point:
    size = math.hypot(*a)
    return a[0] / size * length, a[1] / size * length


def _nearest(line: Line) -> Point:
    """The point of a line that is nearest to the origin."""
    (ax, ay), (bx, by) = line
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(ax * dx + ay * dy) / length2))
    return ax + share * dx, ay + share * dy


def _hit(towards: Point, line: Line) -> Point | None:
    """Where the way in a direction crosses a line."""
    (ax, ay), (bx, by) = line
    dx, dy = bx - ax, by - ay
    across = towards[0] * dy - towards[1] * dx
    if abs(across) < 1e-12:
        return None
    distance = (ax * dy - ay * dx) / across
    share = (ax * towards[1] - ay * towards[0]) / across
    if distance <= 0.0 or not -1e-9 <= share <= 1.0 + 1e-9:
        return None
    return distance * towards[0], distance * towards[1]
