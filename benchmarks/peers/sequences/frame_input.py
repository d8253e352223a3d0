"""The input of every method at one frame of a flight: the sorted depth image, and the pose as it is reported."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.cloud import sorted_inverse_depth
from benchmarks.tracking.sequences import Exposure, Pose, drifting, true_pose
from core.params import Params
from drivers.simulation.source import Rendered

Floats = NDArray[np.float64]

POSES: Final[dict[str, Pose]] = {"true pose": true_pose, "drift 5 %": drifting(0.05)}
"""By name. The drift is a share of the way along north, added to north and to east."""
GROUND_CUT_M: Final = Params().ground_tolerance_cap * Params().min_obstacle_height_m
"""A cube or triangle whose centre is less than this above the true ground counts as ground."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FrameInput:
    """One frame for a method.

    exposure: the frame and its truth. depth_m: (H, W) float32 depth Z of the sorted pixels, 0: none; ground included.
    heading_rad, position_m: reported heading and position of the camera in ned; R_ned_optical: (3, 3) reported."""

    exposure: Exposure
    depth_m: NDArray[np.float32]
    heading_rad: float
    position_m: Floats
    R_ned_optical: Floats

    @property
    def position(self) -> tuple[float, float, float]:
        """The reported position as plain numbers."""
        x, y, z = self.position_m.tolist()
        return x, y, z

    def points_m(self) -> Floats:
        """(P, 3) the sorted pixels in the reported ned."""
        k = self.exposure.info.intrinsics
        v, u = np.nonzero(self.depth_m)
        z = self.depth_m[v, u].astype(np.float64)
        optical = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
        return np.asarray(optical @ self.R_ned_optical.T + self.position_m)

    def above_ground_m(self, points_m: Floats) -> Floats:
        """(P,) height of points (P, 3) of the reported ned above the true ground."""
        true = points_m + (self.exposure.position_m - self.position_m)
        ground = self.exposure.rendered.scene.ground
        return np.asarray(ground.z_m + ground.slope_x * true[:, 0] + ground.slope_y * true[:, 1] - true[:, 2])


def sorted_depth_m(frame: Rendered, ke_per_m: float) -> NDArray[np.float32]:
    """(H, W) depth Z of the sorted pixels of a frame, 0: none."""
    inverse = sorted_inverse_depth(frame, ke_per_m)
    return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)


def frame_input(e: Exposure, depth_m: NDArray[np.float32], pose: Pose) -> FrameInput:
    """The input under one estimate of the pose. The attitude against the vertical is exact."""
    heading, at = pose(e)
    turn = heading - e.heading_rad
    c, s = math.cos(turn), math.sin(turn)
    R_reported_true = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return FrameInput(
        exposure=e,
        depth_m=depth_m,
        heading_rad=heading,
        position_m=np.array(at, np.float64),
        R_ned_optical=R_reported_true @ e.R_ned_optical,
    )
