"""Place of a neighbour's local frame in the own one, and its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .records import LocalFrame

Floats = NDArray[np.float64]
WGS84_A_M, WGS84_F = 6_378_137.0, 1.0 / 298.257_223_563
SCALE_SIGMA = 0.0035
"""Half of the greatest error of the scale of a local frame. Autopilots compute it on a sphere: PX4 of 6371.0 km, ArduPilot of 6378.1 km,
where the radius of curvature is 6335 to 6400 km."""
KINDS_SIGMA = 0.0007
"""Half of the greatest difference between the frames of autopilots of two kinds, per distance from the origin: both spheres, and that
ArduPilot takes meridians as parallel."""

CORRECTED_SIGMAS = 0.1
"""An origin that differs from the known one by no more is the same: each other one sends all planes anew, and ends all alignments. In
the margins it counts for less than 1 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Transform p_own = Rz(yaw_rad) (p_other - pivot_m) + at_m."""

    yaw_rad: float  # yaw_rad, pivot_m, at_m: see above
    pivot_m: tuple[float, float, float]
    at_m: tuple[float, float, float]
    sigma_m: float  # uncertainty of the pivot on each horizontal axis
    sigma_z_m: float  # uncertainty of the height
    sigma_yaw_rad: float  # uncertainty of the rotation about the pivot
    refined: bool = False  # found by planes of both vehicles

    def points(self, points_m: Floats) -> Floats:
        """Returns points of the other frame, (P, 3), in the own one."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        p = points_m - np.array(self.pivot_m)
        turned = np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]])
        return np.asarray(turned + np.array(self.at_m))

    def boxes(self, box: Floats) -> Floats:
        """Returns planes a_x, a_y, b_x, b_y, top, bottom of the other frame, (N, 6), in the own one."""
        out = np.empty_like(box)
        for k in (0, 2):
            out[:, k : k + 2] = self.points(np.column_stack([box[:, k : k + 2], box[:, 4]]))[:, :2]
        out[:, 4:] = box[:, 4:] + (self.at_m[2] - self.pivot_m[2])
        return out

    def velocity(self, velocity_m_s: tuple[float, float]) -> tuple[float, float]:
        """Returns a horizontal velocity of the other frame in the own one."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return c * velocity_m_s[0] - s * velocity_m_s[1], s * velocity_m_s[0] + c * velocity_m_s[1]

    def sigma_at_m(self, xy_m: Floats) -> Floats:
        """Returns the horizontal standard deviation, (P,), of points (P, 2) of the other frame."""
        r = np.hypot(xy_m[:, 0] - self.pivot_m[0], xy_m[:, 1] - self.pivot_m[1])
        return np.asarray(np.hypot(self.sigma_m, r * self.sigma_yaw_rad))


def placement_by_position(own: LocalFrame, other: LocalFrame, pivot_m: tuple[float, float, float]) -> Placement:
    """Returns the placement by the origins on Earth alone.

    pivot_m: place in the other frame about which its heading error rotates it: that of the other vehicle, whose
    position is measured."""
    own_axes, other_axes = _axes_of(own), _axes_of(other)
    apart = _ecef(other) - _ecef(own)
    x, y, _ = own_axes @ (apart + other_axes.T @ np.array([*pivot_m[:2], 0.0]))
    turned = own_axes @ other_axes.T
    projected_m = SCALE_SIGMA * float(np.linalg.norm(apart)) + KINDS_SIGMA * math.hypot(*pivot_m[:2])
    return Placement(
        yaw_rad=math.atan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]),
        pivot_m=pivot_m,
        # heights are differences of altitudes, over the curved Earth
        at_m=(float(x), float(y), pivot_m[2] + own.altitude_m - other.altitude_m),
        sigma_m=math.hypot(own.sigma_m, other.sigma_m, projected_m),
        sigma_z_m=math.hypot(own.sigma_z_m, other.sigma_z_m),
        sigma_yaw_rad=math.hypot(own.sigma_yaw_rad, other.sigma_yaw_rad),
    )


def is_corrected(known: LocalFrame, stated: LocalFrame) -> bool:
    """True if the origin of the stated frame is another one than the known one."""
    x, y, z = placement_by_position(known, stated, (0.0, 0.0, 0.0)).at_m
    return math.hypot(x, y) > CORRECTED_SIGMAS * known.sigma_m or abs(z) > CORRECTED_SIGMAS * known.sigma_z_m


def _ecef(frame: LocalFrame) -> Floats:
    """The origin in earth-centred axes, m (WGS-84)."""
    lat, lon = math.radians(frame.latitude_deg), math.radians(frame.longitude_deg)
    e2 = WGS84_F * (2.0 - WGS84_F)
    n = WGS84_A_M / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    r = (n + frame.altitude_m) * math.cos(lat)
    return np.array(
        [r * math.cos(lon), r * math.sin(lon), (n * (1.0 - e2) + frame.altitude_m) * math.sin(lat)], np.float64
    )


def _axes_of(frame: LocalFrame) -> Floats:
    """(3, 3) rotation from earth-centred axes to those of the frame at its origin."""
    lat, lon = math.radians(frame.latitude_deg), math.radians(frame.longitude_deg)
    sa, ca, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    north, east, up = np.array([[-sa * co, -sa * so, ca], [-so, co, 0.0], [ca * co, ca * so, sa]])
    c, s = math.cos(frame.yaw_rad), math.sin(frame.yaw_rad)
    return np.array([c * north + s * east, c * east - s * north, -up])
