"""The results of a log as tables: frames, planes, corners of prisms, free space. Columns have the same length per table.

Coordinates are in the published frame of each row's frame (column `frame` of the table `frames`): `ned` with a position,
`level` without."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core.frames import euler_from_rotation, rotation_from_quaternion
from core.types import FrameModel
from drivers.base import BadData
from drivers.logs.reader import LoggedMessage, McapRecording
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..console import counted
from ..pipeline.encode import prisms_from_message
from ..pipeline.results import PrismsResult

Column = NDArray[Any]
Table = dict[str, Column]


@dataclass(slots=True)
class Tables:
    """Rows are collected as tuples; `arrays` gives the columns."""

    rows: dict[str, list[tuple[Any, ...]]] = field(default_factory=lambda: {name: [] for name in COLUMNS})

    def add(self, result: PrismsResult) -> None:
        """Adds a frame. A blind frame has a row in `frames` only."""
        key = (result.camera, result.sequence)
        self.rows["frames"].append((*key, *_frame_row(result)))
        model = result.model
        if model is None or not result.valid:
            return
        self.rows["planes"] += [(*key, k, *values) for k, values in enumerate(_plane_rows(model))]
        self.rows["prisms"] += [(*key, *values) for values in _prism_rows(model)]
        self.rows["free"] += [(*key, *values) for values in _free_rows(model)]

    def arrays(self) -> dict[str, Table]:
        """Table -> column -> values (rows,)."""
        return {name: _columns(COLUMNS[name], rows) for name, rows in self.rows.items()}


COLUMNS: dict[str, tuple[tuple[str, str], ...]] = {
    "frames": (
        ("camera", "U"), ("sequence", "i8"), ("t_exposure_ns", "i8"), ("valid", "?"), ("cause", "U"), ("frame", "U"),
        ("roll_rad", "f8"), ("pitch_rad", "f8"), ("yaw_rad", "f8"), ("north_m", "f8"), ("east_m", "f8"), ("down_m", "f8"),
        ("camera_x_m", "f8"), ("camera_y_m", "f8"), ("camera_z_m", "f8"), ("ground_seen", "?"), ("ground_height_m", "f8"),
        ("measured_share", "f8"), ("unknown_share", "f8"), ("far_share", "f8"), ("ke_per_m", "f8"), ("planes", "i8"),
        ("prisms", "i8"),
    ),
    "planes": (
        ("camera", "U"), ("sequence", "i8"), ("plane", "i8"), ("a_x_m", "f4"), ("a_y_m", "f4"), ("b_x_m", "f4"),
        ("b_y_m", "f4"), ("top_m", "f4"), ("bottom_m", "f4"), ("margin_m", "f4"), ("support_px", "i8"), ("flags", "i8"),
        ("cluster", "i8"),
    ),
    "prisms": (
        ("camera", "U"), ("sequence", "i8"), ("prism", "i8"), ("cluster", "i8"), ("closed", "?"), ("top_m", "f4"),
        ("bottom_m", "f4"), ("margin_m", "f4"), ("vertex", "i8"), ("x_m", "f4"), ("y_m", "f4"),
    ),
    "free": (
        ("camera", "U"), ("sequence", "i8"), ("azimuth_from_rad", "f4"), ("azimuth_to_rad", "f4"), ("layer_from_m", "f4"),
        ("layer_to_m", "f4"), ("free_from_m", "f4"), ("free_to_m", "f4"), ("end", "i8"),
    ),
}  # fmt: skip
"""Table -> (column, numpy type). Units are in the names; z is down."""


def read_tables(source: McapRecording, tables: Tables) -> Iterator[PrismsResult]:
    """Adds all frames of a log, and yields each. A frame that does not fit together, as one of a newer version, is left out. Raises
    BadData at the end for such frames and for a damaged log."""
    rejected: list[str] = []
    try:
        for item in source.messages("prisms"):
            try:
                result = _result(item, source)
            except ValueError as error:
                rejected.append(f"{TOPICS[item.key].of(item.camera)}, frame {item.sequence}: {error}")
                continue
            tables.add(result)
            yield result
    except BadData as error:
        raise BadData(f"{error}; {_rejection(rejected)}" if rejected else str(error)) from error
    if rejected:
        raise BadData(f"{source.path}: {_rejection(rejected)}")


def _result(item: LoggedMessage, source: McapRecording) -> PrismsResult:
    """The result of a message. Raises ValueError."""
    assert isinstance(item.message, pb.PrismsFrame)
    result = prisms_from_message(item.message)
    if result.camera not in {info.camera for info in source.cameras}:
        raise ValueError(f"the log does not describe its camera {result.camera!r}")
    return result


def _rejection(rejected: list[str]) -> str:
    return (
        f"{counted(len(rejected), 'frame')} left out, the first: {rejected[0]}; use the version that wrote the log, or compute "
        "the results again with `companion replay -o`"
    )


def _columns(columns: Iterable[tuple[str, str]], rows: list[tuple[Any, ...]]) -> Table:
    values = list(zip(*rows, strict=True)) if rows else [()] * len(tuple(columns))
    return {name: np.array(v, dtype=kind) for (name, kind), v in zip(columns, values, strict=True)}


def _frame_row(result: PrismsResult) -> tuple[Any, ...]:
    model = result.model
    angles = _euler(result)
    position = result.pose.position_ned_m if result.pose is not None else (math.nan,) * 3
    camera = result.transform.translation_m if result.transform is not None else (math.nan,) * 3
    head = (result.t_exposure_ns, result.valid, result.cause.value, result.frame, *angles, *position, *camera)
    if model is None:
        return (*head, False, math.nan, math.nan, math.nan, math.nan, math.nan, 0, 0)
    s, g = model.stats, model.ground
    shares = (s.measured_share, s.unknown_share, s.far_share, model.ke_per_m)
    return (*head, g.seen, g.height_m if g.seen else math.nan, *shares, len(model.planes), len(model.prisms))


def _euler(result: PrismsResult) -> tuple[float, float, float]:
    if result.attitude is None:
        return math.nan, math.nan, math.nan
    return euler_from_rotation(rotation_from_quaternion(result.attitude.q_ned_frd_wxyz))


def _plane_rows(model: FrameModel) -> Iterator[tuple[Any, ...]]:
    for k in range(len(model.planes)):
        yield (
            *model.planes[k].tolist(),
            float(model.margin_m[k]),
            int(model.support_px[k]),
            int(model.flags[k]),
            int(model.cluster[k]),
        )


def _prism_rows(model: FrameModel) -> Iterator[tuple[Any, ...]]:
    for number, prism in enumerate(model.prisms):
        for vertex, (x, y) in enumerate(prism.vertices_m.tolist()):
            yield number, prism.cluster, prism.closed, prism.top_m, prism.bottom_m, prism.margin_m, vertex, x, y


def _free_rows(model: FrameModel) -> Iterator[tuple[Any, ...]]:
    free = model.free
    azimuth, layers = free.azimuth_edges_rad.tolist(), free.layer_edges_m.tolist()
    for d in range(len(azimuth) - 1):
        for k in range(len(layers) - 1):
            yield (
                azimuth[d],
                azimuth[d + 1],
                layers[k],
                layers[k + 1],
                float(free.free_from_m[d, k]),
                float(free.free_to_m[d, k]),
                int(free.end[d, k]),
            )
