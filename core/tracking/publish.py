"""The published form of the tracks."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import inner, kernel
from .line import EDGE_ON, along, offset, variance_at
from .losses import lost_ns
from .snapshot import MovingObject, TrackSnapshot

NS = 1_000_000_000
BEHIND_M = 0.1
"""A filtered plane that lies farther behind the newest observation is moved."""
WIDE_M = 1.0
"""A shorter plane is not moved, since that could move it aside."""


_COLUMNS = [
    "ids",
    "planes",
    "margin_m",
    "sigma_m",
    "confidence",
    "state",
    "hits",
    "age_ns",
    "unseen_ns",
    "flags",
    "object_id",
]
"""Arrays of a TrackSnapshot, in the order in which `columns_of` returns them."""


class MarginGrowth(NamedTuple):
    """Margins grow by speed_error_m_s for each second without a position since the newest observation. losses: of
    `loss_table`."""

    speed_error_m_s: Any
    losses: Any


def snapshot_of(
    tracks: NDArray[Any], objects: NDArray[Any], t_ns: int, growth: MarginGrowth, camera_m: tuple[float, float, float]
) -> TrackSnapshot:
    """The tracks (T,) TRACK and moving objects (M,) OBJECT at t_ns. camera_m: place of the frame's camera.

    A plane lies no farther behind the newest observation than BEHIND_M or a quarter of its margin, and the margin contains
    the rest: no consumer that subtracts it comes nearer than with the model of the frame alone. The plane returns slowly, so
    that it does not jump with the noise. The confidence is the share of frames in view that observed the track, and at most
    1 - 0.5^hits."""
    columns = dict(zip(_COLUMNS, columns_of(tracks, t_ns, growth, camera_m), strict=True))
    return TrackSnapshot(**columns, objects=moving_objects(objects, t_ns))


@kernel
def columns_of(tracks, t_ns, growth, eye):
    """Returns the arrays of _COLUMNS of the tracks in use; arguments: see `snapshot_of`."""
    count = 0
    for j in range(tracks.shape[0]):
        count += tracks[j].hits > 0
    planes = np.empty((count, 6), np.float32)
    margin_m, sigma_m = np.empty(count, np.float32), np.empty(count, np.float32)
    confidence, state, hits = np.empty(count, np.float32), np.empty(count, np.int32), np.empty(count, np.int32)
    age_ns, unseen_ns, flags = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.uint8)
    ids, object_id = np.empty(count, np.int64), np.empty(count, np.int64)
    n = 0
    for j in range(tracks.shape[0]):
        t = tracks[j]
        if t.hits == 0:
            continue
        excess = max(0.0, t.excess_m)
        nearer = t.nearer_m if t.s1_m - t.s0_m >= WIDE_M else 0.0
        x, y = t.x_m - nearer * t.ty, t.y_m + nearer * t.tx
        s0, s1 = moved_end(t, t.s0_m, nearer, eye), moved_end(t, t.s1_m, nearer, eye)
        planes[n, 0], planes[n, 1] = x + s0 * t.tx, y + s0 * t.ty
        planes[n, 2], planes[n, 3] = x + s1 * t.tx, y + s1 * t.ty
        share = moved_share(t, nearer, eye)
        planes[n, 4] = min(t.top_m, eye[2] + share * (t.top_m - eye[2]))
        planes[n, 5] = max(t.bottom_m, eye[2] + share * (t.bottom_m - eye[2]))
        unseen = t_ns - t.seen_ns
        margin_m[n] = t.margin_m + max(0.0, excess - nearer)
        margin_m[n] += growth.speed_error_m_s * lost_ns(growth.losses, t.seen_ns) / NS
        sigma_m[n] = math.sqrt(max(0.0, variance_at(t, 0.5 * (t.s0_m + t.s1_m))))
        confidence[n] = t.hit_rate * (1.0 - 0.5 ** min(t.hits, 60))
        ids[n], state[n], hits[n] = t.id, t.state, t.hits
        age_ns[n], unseen_ns[n] = t_ns - t.first_ns, unseen
        flags[n], object_id[n] = t.plane_flags, t.object_id
        n += 1
    return ids, planes, margin_m, sigma_m, confidence, state, hits, age_ns, unseen_ns, flags, object_id


@inner
def moved_end(t, s, nearer_m, eye):
    """Where an end of a track is after its plane has been moved by nearer_m: on the same viewing ray, so that it hides the
    same directions; unchanged where the plane is seen edge-on."""
    x, y = t.x_m + s * t.tx - eye[0], t.y_m + s * t.ty - eye[1]
    far = offset(t, eye[0], eye[1])
    if nearer_m <= 0.0 or far < EDGE_ON * math.sqrt(x * x + y * y) or far <= nearer_m:
        return s
    return s + (along(t, eye[0], eye[1]) - s) * nearer_m / far


@inner
def moved_share(t, nearer_m, eye):
    """Range of a plane that has been moved by nearer_m, as a share of that of its line: its edges are seen in the same
    directions there."""
    far = offset(t, eye[0], eye[1])
    return 1.0 if far <= nearer_m else (far - nearer_m) / far


def moving_objects(objects: NDArray[Any], t_ns: int) -> tuple[MovingObject, ...]:
    """The objects that were declared moving."""
    found = []
    for o in objects[(objects["hits"] > 0) & (objects["moving_ns"] != 0)]:
        x, y = float(o["x_m"]), float(o["y_m"])
        low = x + float(o["low_dx_m"]), y + float(o["low_dy_m"]), float(o["top_m"])
        high = x + float(o["high_dx_m"]), y + float(o["high_dy_m"]), float(o["bottom_m"])
        variance, covariance, speed_variance = (float(max(o["r" + k], o["t" + k])) for k in ("00", "01", "11"))
        found.append(
            MovingObject(
                id=int(o["id"]),
                centre_m=(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])),
                half_size_m=(0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1]), 0.5 * (high[2] - low[2])),
                velocity_m_s=(float(o["vx_m_s"]), float(o["vy_m_s"])),
                position_sigma_m=variance**0.5,
                velocity_sigma_m_s=speed_variance**0.5,
                cov_m2_s=covariance,
                hits=int(o["hits"]),
                age_ns=t_ns - int(o["first_ns"]),
                unseen_ns=t_ns - int(o["seen_ns"]),
            )
        )
    return tuple(found)
