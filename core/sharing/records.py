"""Content of the messages between vehicles: typed values in the sender's local frame (north-east-down, metres)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import PlaneFlags, store_readonly

CUT = PlaneFlags.CUT_LEFT | PlaneFlags.CUT_RIGHT | PlaneFlags.CUT_TOP | PlaneFlags.CUT_BOTTOM
"""It may continue beyond what was observed, at one of its sides."""
PLANE_IDS, MOVER_IDS = 1 << 16, 1 << 15
"""How many ids there are of planes, and of moving obstacles."""


class PacketError(ValueError):
    """A packet that cannot be decoded, or values that cannot be encoded. `code`: snake_case, for counters."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SharedPlanes:
    """N planes of one sender."""

    ids: NDArray[np.uint16]  # (N,), the sender's number of each plane
    box: NDArray[np.float64]  # (N, 6) float64 a_x, a_y, b_x, b_y, top, bottom
    margin_m: NDArray[np.float64]  # (N,)
    flags: NDArray[np.uint8]  # (N,) uint8 PlaneFlags
    age_s: NDArray[np.float64]  # (N,) float64 since the newest observation

    def __post_init__(self) -> None:
        n = len(self.ids)
        store_readonly(self, np.uint16, (n,), "ids")
        store_readonly(self, np.float64, (n, 6), "box")
        store_readonly(self, np.float64, (n,), "margin_m", "age_s")
        store_readonly(self, np.uint8, (n,), "flags")

    def __len__(self) -> int:
        return len(self.ids)

    def part(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> SharedPlanes:
        """Returns some of the planes."""
        return SharedPlanes(
            ids=self.ids[rows],
            box=self.box[rows],
            margin_m=self.margin_m[rows],
            flags=self.flags[rows],
            age_s=self.age_s[rows],
        )

    @classmethod
    def empty(cls) -> SharedPlanes:
        """Returns no planes."""
        none = np.zeros(0)
        return cls(
            ids=np.zeros(0, np.uint16), box=np.zeros((0, 6)), margin_m=none, flags=np.zeros(0, np.uint8), age_s=none
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedMover:
    """A moving obstacle."""

    id: int  # its number, less than MOVER_IDS
    centre_m: tuple[float, float, float]  # centre_m, half_size_m: its box
    half_size_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float]  # horizontal
    sigma_m: float  # sigma_m, sigma_m_s: standard deviations of position and velocity on each axis
    sigma_m_s: float
    age_s: float  # since its newest observation
    partial: bool = False  # it may continue beyond what was observed, as a plane with a flag of CUT


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalFrame:
    """The local frame of a vehicle."""

    latitude_deg: float  # latitude_deg, longitude_deg: its origin, WGS-84; altitude_m: of all vehicles by one datum
    longitude_deg: float
    altitude_m: float
    yaw_rad: float = 0.0  # direction of its x axis, clockwise from true north
    sigma_m: float = 3.0  # uncertainty of the origin on each horizontal axis
    sigma_z_m: float = 3.0  # uncertainty of its height
    sigma_yaw_rad: float = 0.05  # uncertainty of the direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Position and velocity of a vehicle in its frame."""

    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleState(Motion):
    """A vehicle: its frame, its motion in it, and the radius of a sphere that contains it."""

    frame: LocalFrame
    radius_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Header of a packet."""

    vehicle: int  # 1..255
    stream: int  # number of a start of the sender, increasing with each start
    sent_ms: int  # time since that start, increasing with each packet
    section: int  # number of the sender's frame, which changes when its position jumps or its origin is corrected


Content = VehicleState | SharedPlanes | tuple[SharedMover, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Packet:
    """One packet. motion: of the sender; None: not in it."""

    header: Header
    content: Content
    motion: Motion | None = None
