"""Motion of a vehicle without a position, from the tracks themselves: the shift that brings most detections onto them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .association import CONTINUES

_CUT_TOP, _CUT_BOTTOM = 16, 32
_ROUNDS = 4
_SCALE_M = 0.1
"""Not tuning: distances above this count less, so that moving obstacles do not decide."""
_PRIOR_M = 0.3
"""Not tuning: standard deviation of the shift that is expected beyond the prediction; where all surfaces are parallel it
keeps the shift along them."""


def common_shift(
    detections: NDArray[np.void], tracks: NDArray[np.void], pairs: NDArray[np.int32], scores: NDArray[np.float64]
) -> tuple[float, float, float]:
    """The shift (x, y, z, m) to add to the tracks. Weighted least squares of the distances of detections from the lines of
    the tracks that they continue best, with weights reduced for large distances; z is the median difference of tops and
    bottoms. Zeros where nothing is paired."""
    order = np.argsort(-scores, kind="stable")
    order = order[pairs[order, 2] == CONTINUES]
    _, first = np.unique(pairs[order, 0], return_index=True)
    chosen = pairs[order[np.sort(first)]]
    if not len(chosen):
        return 0.0, 0.0, 0.0
    d, t = detections[chosen[:, 0]], tracks[chosen[:, 1]]
    x, y = 0.5 * (d["ax_m"] + d["bx_m"]), 0.5 * (d["ay_m"] + d["by_m"])
    nx, ny = -t["ty"], t["tx"]
    miss = (x - t["x_m"]) * nx + (y - t["y_m"]) * ny
    weight = np.minimum(d["length_m"], 2.0) / d["sigma_m"] ** 2
    shift, robust = np.zeros(2), np.ones(len(d))
    for _ in range(_ROUNDS):
        w = weight * robust
        normal = np.array([[(w * nx * nx).sum(), (w * nx * ny).sum()], [(w * nx * ny).sum(), (w * ny * ny).sum()]])
        shift = np.linalg.solve(
            normal + np.eye(2) / _PRIOR_M**2, np.array([(w * nx * miss).sum(), (w * ny * miss).sum()])
        )
        robust = 1.0 / (1.0 + ((miss - nx * shift[0] - ny * shift[1]) / _SCALE_M) ** 2)
    cut = d["plane_flags"] | t["plane_flags"]
    tops, bottoms = (d[name] - t[name] for name in ("top_m", "bottom_m"))
    heights = np.concatenate([tops[cut & _CUT_TOP == 0], bottoms[cut & _CUT_BOTTOM == 0]])
    dz = float(np.median(heights)) if len(heights) >= 6 else 0.0
    if not (math.isfinite(shift[0]) and math.isfinite(shift[1])):
        return 0.0, 0.0, 0.0
    return float(shift[0]), float(shift[1]), dz
