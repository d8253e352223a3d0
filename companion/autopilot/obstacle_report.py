"""The result of a decision about what to send to the autopilot, and the cameras that decide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from core.params import Params

from .obstacle_distance_3d import NO_POINTS
from .surroundings import Observer

RECKONING_ERRORS = (ArithmeticError, AssertionError, LookupError, ValueError)
"""Errors of the computation after which all cameras count as blind, and the guard's path as not seen. The thread continues."""


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleReport:
    """One decision about what to send."""

    t_ns: int  # instant of the decision
    values: NDArray[np.uint16] | None  # (72,) uint16 distances in cm that were sent; None: nothing was sent
    blind: dict[str, str]  # camera -> cause, as text, of each blind camera
    policy: str  # name of the failsafe policy
    fault: str = ""  # error of the computation, as text; empty: none
    # (N, 3) obstacles above and below the band, if they are sent
    points_m: NDArray[np.float64] = field(default_factory=NO_POINTS.copy)
    up_m: float | None = None  # distance to the lowest obstacle above the vehicle; None: not sent
    down_m: float | None = None  # distance to the ground below the vehicle; None: not sent
    # oldest of the newest exposures of the seeing cameras, by which it was made; None: no camera sees
    exposed_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraUse:
    """The cameras whose frames decide, and how their frames are used."""

    cameras: tuple[str, ...]  # names of all configured cameras
    timeout_s: float  # age above which a camera's newest frame does not count
    params: Params = field(default_factory=Params)  # parameters of the extraction
    # returns why the frames of a camera must not be used although they arrive, such as an image repeated under new
    # stamps; empty: they may be used
    frame_fault: Callable[[str], str] = lambda camera: ""
    observer: Observer | None = None  # receives the surroundings of each decision
    # True if a sector whose band is free or open up to the maximum is clear ([open_sky] mode = "presume")
    open_counts: bool = False
    reach_m: float = 0.0  # range to which free space is remembered for the observer; at least max_distance_m
