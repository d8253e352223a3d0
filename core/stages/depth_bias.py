"""The error that all depths of a camera share: of its calibration (not in the paper).

Every depth Z may be too great by bias Z^2, so that the true point lies on the same ray, nearer by the factor 1 / (1 + bias Z).
A plane stays a plane."""

from __future__ import annotations

from typing import NamedTuple

from ..jit import inner


class DepthBias(NamedTuple):
    """Error that all depths of a camera share."""

    per_m: float  # bias_per_m of the CameraInfo
    # axis_x, axis_z: of the optical axis in level_cam; the optical depth of a point (x, y, z) is axis_x x + axis_z z
    axis_x: float
    axis_z: float


@inner
def greatest_depth(bias, x, top, bottom):
    """Returns the greatest optical depth of the places at forward distance x between two heights, 0 or more."""
    return max(bias.axis_x * x + max(bias.axis_z * top, bias.axis_z * bottom), 0.0)


@inner
def shorten_by_bias(bias, layers, free_to):
    """Shortens forward distances (D, L), in place: all were measured, planes, ground and the greatest range alike.

    bias: DepthBias; layers: (L + 1,) heights."""
    if bias.per_m > 0.0:
        for d in range(free_to.shape[0]):
            for layer in range(free_to.shape[1]):
                x = free_to[d, layer]
                depth = greatest_depth(bias, x, layers[layer], layers[layer + 1])
                free_to[d, layer] = x / (1.0 + bias.per_m * depth)
