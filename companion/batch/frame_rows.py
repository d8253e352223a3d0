"""One row for each frame, with whether its result equals that in the log."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.types import FrameModel
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import prisms_message, wire_bytes
from ..pipeline.results import PrismsResult
from ..replay.advice import free_share
from ..replay.compare import Difference, Key, comparable, first_difference, key_of
from ..viewer.geometry import nearest_m

WAITING: Final = 64
"""Frames that wait for their result in the log, which follows the image after a few messages."""
_DIGITS: Final = 16


def digest_of(message: pb.PrismsFrame) -> str:
    """The first digits of the SHA-256 of an encoded result, without the fields that are not compared."""
    return hashlib.sha256(wire_bytes(comparable(message))).hexdigest()[:_DIGITS]


def text_hash(text: str) -> str:
    """The first digits of the SHA-256 of a text, such as a configuration."""
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def nearest_plane_m(model: FrameModel, camera_m: NDArray[np.float64]) -> float | None:
    """Distance from the camera to the nearest plane, its margin not subtracted; None: no plane. camera_m: (3,) place of
    the camera in the model's frame."""
    if not len(model.planes):
        return None
    planes = model.planes.astype(np.float64) - camera_m[[0, 1, 0, 1, 2, 2]]
    vertical_m = np.maximum(0.0, np.maximum(planes[:, 4], -planes[:, 5]))
    return float(np.min(np.hypot(nearest_m(planes.astype(np.float32)), vertical_m)))


@dataclass(slots=True)
class OnboardComparison:
    """Counts of the comparison with the results in the log."""

    compared: int = 0
    different: int = 0
    first: Difference | None = None
    missing_onboard: int = 0
    without_depth: int = 0


@dataclass(slots=True)
class _Waiting:
    row: dict[str, Any]
    message: pb.PrismsFrame


@dataclass(slots=True)
class FrameRows:
    """`computed` and `logged` in the order of the log, then `end_file` after each file; each gives completed rows."""

    comparison: OnboardComparison = field(default_factory=OnboardComparison)
    _computed: dict[Key, _Waiting] = field(default_factory=dict)
    _logged: dict[Key, pb.PrismsFrame] = field(default_factory=dict)

    def computed(self, result: PrismsResult, row: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Takes a computed result. row: its columns, without the digests."""
        message = prisms_message(result)
        waiting = _Waiting(row | {"digest": digest_of(message)}, message)
        key = key_of(message)
        logged = self._logged.pop(key, None)
        if logged is not None:
            yield self._compared(key, waiting, logged)
            return
        self._computed[key] = waiting
        if len(self._computed) > WAITING:
            yield self._missing()

    def logged(self, message: pb.PrismsFrame) -> Iterator[dict[str, Any]]:
        """Takes a result in the log."""
        key = key_of(message)
        waiting = self._computed.pop(key, None)
        if waiting is not None:
            yield self._compared(key, waiting, message)
            return
        self._logged[key] = message
        if len(self._logged) > WAITING:
            del self._logged[next(iter(self._logged))]
            self.comparison.without_depth += 1

    def end_file(self) -> Iterator[dict[str, Any]]:
        """The rows that still wait."""
        while self._computed:
            yield self._missing()
        self.comparison.without_depth += len(self._logged)
        self._logged.clear()

    def _missing(self) -> dict[str, Any]:
        """The oldest waiting row: its result is not in the log."""
        self.comparison.missing_onboard += 1
        return self._computed.pop(next(iter(self._computed))).row

    def _compared(self, key: Key, waiting: _Waiting, logged: pb.PrismsFrame) -> dict[str, Any]:
        onboard, comparison = digest_of(logged), self.comparison
        equal = onboard == waiting.row["digest"]
        comparison.compared += 1
        comparison.different += not equal
        if not equal and comparison.first is None:
            difference = first_difference(logged, waiting.message)
            comparison.first = None if difference is None else Difference(key, *difference)
        return waiting.row | {"onboard_digest": onboard, "equals_onboard": equal}


def result_columns(result: PrismsResult) -> dict[str, Any]:
    """The columns of a frame that its result alone determines. Columns without a value are left out."""
    columns: dict[str, Any] = {
        "camera": result.camera,
        "sequence": result.sequence,
        "t_exposure_ns": result.t_exposure_ns,
        "valid": result.valid,
        "cause": result.cause.value,
        "frame": result.frame,
        "planes": 0,
        "prisms": 0,
        "attitude": "none",
        "camera_latency_ms": (result.t_arrival_ns - result.t_exposure_ns) / 1e6,
    }
    if result.attitude is not None:
        columns["attitude"] = result.attitude.source.name.lower()
        columns["attitude_distance_ms"] = result.attitude.distance_ns / 1e6
    if result.pose is not None:
        north, east, down = result.pose.position_ned_m
        columns |= {"north_m": north, "east_m": east, "down_m": down}
    model = result.model
    if model is None:
        return columns
    columns |= {"measured_share": model.stats.measured_share, "noise_per_m": _finite(model.ke_per_m)}
    if not result.valid:
        return columns
    camera_m = np.zeros(3) if result.transform is None else np.asarray(result.transform.translation_m, np.float64)
    return columns | {
        "planes": len(model.planes),
        "prisms": len(model.prisms),
        "nearest_m": nearest_plane_m(model, camera_m),
        "free_share": free_share(model, float(camera_m[2]))[0],
        "ground_seen": model.ground.seen,
        "ground_height_m": _finite(model.ground.height_m) if model.ground.seen else None,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def plane_rows(result: PrismsResult) -> Iterator[dict[str, Any]]:
    """The rows of the planes of a valid frame."""
    model = result.model
    if model is None or not result.valid:
        return
    for k in range(len(model.planes)):
        a_x, a_y, b_x, b_y, top, bottom = model.planes[k].tolist()
        yield {
            "camera": result.camera, "sequence": result.sequence, "t_exposure_ns": result.t_exposure_ns, "plane": k,
            "a_x_m": a_x, "a_y_m": a_y, "b_x_m": b_x, "b_y_m": b_y, "top_m": top, "bottom_m": bottom,
            "margin_m": float(model.margin_m[k]), "support_px": int(model.support_px[k]), "flags": int(model.flags[k]),
            "cluster": int(model.cluster[k]),
        }  # fmt: skip
