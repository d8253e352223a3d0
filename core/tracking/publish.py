"""The published form of the tracks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .snapshot import MovingObject, TrackSnapshot

NS = 1_000_000_000
BEHIND_M = 0.1
"""Not tuning: a filtered plane that lies farther behind the newest observation is moved."""
WIDE_M = 1.0
"""Not tuning: a shorter plane is not moved, since that could move it aside."""


def snapshot_of(tracks: NDArray[Any], objects: NDArray[Any], t_ns: int, growth_m_s: float) -> TrackSnapshot:
    """The tracks (T,) TRACK and moving objects (M,) OBJECT at t_ns. growth_m_s: margins grow by this for each second
    since the newest observation.

    A plane lies no farther behind the newest observation than BEHIND_M or its margin, and the margin contains
    the rest: no consumer that subtracts it comes nearer than with the model of the frame alone. The confidence is the
    share of frames in view that observed the track, and at most 1 - 0.5^hits."""
    t = tracks[tracks["hits"] > 0]
    planes = np.empty((len(t), 6), np.float32)
    excess = np.maximum(t["excess_m"], 0.0)
    nearer = np.maximum(0.0, excess - np.maximum(BEHIND_M, t["margin_m"]))
    nearer[t["s1_m"] - t["s0_m"] < WIDE_M] = 0.0
    for k, s in enumerate((t["s0_m"], t["s1_m"])):
        planes[:, 2 * k] = t["x_m"] + s * t["tx"] - nearer * t["ty"]
        planes[:, 2 * k + 1] = t["y_m"] + s * t["ty"] + nearer * t["tx"]
    planes[:, 4], planes[:, 5] = t["top_m"], t["bottom_m"]
    middle = 0.5 * (t["s0_m"] + t["s1_m"])
    variance = t["p00"] + 2.0 * middle * t["p01"] + middle * middle * t["p11"]
    unseen_ns = t_ns - t["seen_ns"]
    margin = t["margin_m"] + excess - nearer + growth_m_s * unseen_ns / NS
    confidence = t["hit_rate"] * (1.0 - 0.5 ** np.minimum(t["hits"], 60))
    return TrackSnapshot(
        ids=t["id"].copy(), planes=planes, margin_m=margin.astype(np.float32),
        sigma_m=np.sqrt(np.maximum(variance, 0.0)).astype(np.float32), confidence=confidence.astype(np.float32),
        state=t["state"].copy(), hits=t["hits"].copy(), age_ns=t_ns - t["first_ns"], unseen_ns=unseen_ns,
        flags=t["plane_flags"].astype(np.uint8), object_id=t["object_id"].copy(), objects=moving_objects(objects, t_ns),
    )  # fmt: skip


def moving_objects(objects: NDArray[Any], t_ns: int) -> tuple[MovingObject, ...]:
    """The objects that were declared moving."""
    found = []
    for o in objects[(objects["hits"] > 0) & (objects["moving_ns"] != 0)]:
        x, y = float(o["x_m"]), float(o["y_m"])
        low = x + float(o["low_dx_m"]), y + float(o["low_dy_m"]), float(o["top_m"])
        high = x + float(o["high_dx_m"]), y + float(o["high_dy_m"]), float(o["bottom_m"])
        axis = "r" if o["r11"] > o["t11"] else "t"  # the less exact one, for both axes
        found.append(
            MovingObject(
                id=int(o["id"]), centre_m=(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])),
                half_size_m=(0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1]), 0.5 * (high[2] - low[2])),
                velocity_m_s=(float(o["vx_m_s"]), float(o["vy_m_s"])),
                position_sigma_m=float(o[axis + "00"]) ** 0.5, velocity_sigma_m_s=float(o[axis + "11"]) ** 0.5,
                cov_m2_s=float(o[axis + "01"]), hits=int(o["hits"]), age_ns=t_ns - int(o["first_ns"]),
                unseen_ns=t_ns - int(o["seen_ns"]),
            )
        )  # fmt: skip
    return tuple(found)
