"""Quaternions (w, x, y, z): product, rotation vector, interpolation, body rates, heading."""

from __future__ import annotations

import math

from core.frames import euler_from_rotation, quaternion_from_euler, rotation_from_quaternion
from core.types import MAX_RATE_RAD_S

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def normalised(q: Quaternion) -> Quaternion:
    """The quaternion scaled to unit length."""
    n = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / n, q[1] / n, q[2] / n, q[3] / n)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The product a * b: rotation b, then a, as with rotation matrices."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The inverse rotation of a unit quaternion."""
    return (q[0], -q[1], -q[2], -q[3])


def from_rotation_vector(v: Vector) -> Quaternion:
    """The rotation about v by |v| rad."""
    angle = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    # sin(angle/2)/angle; its series where the division loses precision
    k = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(angle / 2) / angle
    return (math.cos(angle / 2), k * v[0], k * v[1], k * v[2])


def to_rotation_vector(q: Quaternion) -> Vector:
    """The shortest rotation vector of a unit quaternion, rad."""
    w, x, y, z = q if q[0] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])
    s = math.sqrt(x * x + y * y + z * z)
    k = 2.0 if s < 1e-9 else 2.0 * math.atan2(s, w) / s
    return (k * x, k * y, k * z)


def slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    """Spherical interpolation from a (share 0) to b (share 1) along the shorter arc."""
    a, b = normalised(a), normalised(b)
    v = to_rotation_vector(product(conjugate(a), b))
    return normalised(product(a, from_rotation_vector((v[0] * share, v[1] * share, v[2] * share))))


def rotate_by_rates(q_ned_frd: Quaternion, rates_frd_rad_s: Vector, dt_s: float) -> Quaternion:
    """The attitude after dt_s (negative: before) at constant body rates: q * exp(rates dt)."""
    wx, wy, wz = rates_frd_rad_s
    return normalised(product(normalised(q_ned_frd), from_rotation_vector((wx * dt_s, wy * dt_s, wz * dt_s))))


def rates_between(a: Quaternion, b: Quaternion, dt_s: float) -> Vector:
    """The constant body rates, rad/s, that rotate a into b within dt_s."""
    v = to_rotation_vector(product(conjugate(normalised(a)), normalised(b)))
    return (v[0] / dt_s, v[1] / dt_s, v[2] / dt_s)


def tilt_rate(q_ned_frd: Quaternion, rates_frd_rad_s: Vector) -> float:
    """The rate, rad/s, at which body rates change the direction of down in frd: all of them but the turn about the vertical."""
    w, x, y, z = normalised(q_ned_frd)
    down = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    about_down = sum(r * d for r, d in zip(rates_frd_rad_s, down, strict=True))
    return math.hypot(*(r - about_down * d for r, d in zip(rates_frd_rad_s, down, strict=True)))


def plausible_rates(rates_rad_s: Vector | None) -> Vector | None:
    """The rates; None where one of them exceeds MAX_RATE_RAD_S."""
    if rates_rad_s is None or max(map(abs, rates_rad_s)) > MAX_RATE_RAD_S:
        return None
    return rates_rad_s


def split_heading(q_ned_frd: Quaternion) -> tuple[Quaternion, Quaternion]:
    """(q_ned_level, q_level_frd) of an attitude: its heading, and its roll and pitch."""
    _, _, heading_rad = euler_from_rotation(rotation_from_quaternion(q_ned_frd))
    q_level_frd = product(quaternion_from_euler(0.0, 0.0, -heading_rad), q_ned_frd)
    return quaternion_from_euler(0.0, 0.0, heading_rad), q_level_frd
