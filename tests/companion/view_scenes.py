"""Hand-made frames for the viewer's tests: a level camera in front of a flat wall at 10 m."""

from __future__ import annotations

from typing import Any

import numpy as np

from companion.viewer.frame import ViewFrame
from core.frames import rotation_from_euler
from core.types import (
    CameraInfo,
    CameraMount,
    FrameModel,
    FrameStats,
    FreeProfile,
    Ground,
    Intrinsics,
    InvalidCause,
    PlaneFlags,
    Prism,
)

INTRINSICS = Intrinsics(320, 240, 200.0, 200.0, 159.5, 119.5)
INFO = CameraInfo("front", INTRINSICS)


def model(
    planes: list[list[float]], flags: list[int] | None = None, cause: InvalidCause = InvalidCause.NONE
) -> FrameModel:
    """A model of these planes, each also a prism of its own."""
    n = len(planes)
    table = np.array(planes, np.float32).reshape(n, 6)
    prisms = tuple(
        Prism(
            cluster=k,
            top_m=float(p[4]),
            bottom_m=float(p[5]),
            closed=False,
            margin_m=0.2,
            vertices_m=np.ascontiguousarray(p[:4].reshape(2, 2)),
            plane=np.array([k], np.int32),
        )
        for k, p in enumerate(table)
    )
    return FrameModel(
        valid=cause is InvalidCause.NONE,
        cause=cause,
        planes=table,
        support_px=np.full(n, 50, np.int32),
        margin_m=np.full(n, 0.2, np.float32),
        flags=np.array(flags or [0] * n, np.uint8),
        cluster=np.arange(n, dtype=np.int32),
        prisms=prisms,
        free=FreeProfile(
            azimuth_edges_rad=np.array([-0.6, 0.0, 0.6], np.float32),
            layer_edges_m=np.array([-3.0, -1.0, 1.0], np.float32),
            free_from_m=np.full((2, 2), 0.5, np.float32),
            free_to_m=np.array([[3.0, 4.0], [0.0, 0.0]], np.float32),
            end=np.ones((2, 2), np.uint8),
        ),
        ground=Ground(seen=True, height_m=2.0, slope_x=0.01, share=0.3),
        stats=FrameStats(measured_share=0.8, unknown_share=0.2, strips=40, clusters=n, planes=n, prisms=n),
        ke_per_m=0.005,
    )


def frame(**change: Any) -> ViewFrame:
    """A frame of the wall; `change` replaces fields."""
    fields: dict[str, Any] = {
        "info": INFO,
        "sequence": 7,
        "t_ns": 2_500_000_000,
        "depth_mm": np.full((240, 320), 10_000, np.uint16),
        "R_ned_frd": np.eye(3),
        "model": model([[4.0, -1.0, 4.0, 1.0, -0.6, 0.8]]),
    }
    return ViewFrame(**(fields | change))


def tilted() -> ViewFrame:
    """A camera mounted to the left of a vehicle that rolls and pitches, with planes all round, two of them partly
    inferred."""
    info = CameraInfo("left", INTRINSICS, CameraMount(yaw_rad=-0.9, pitch_rad=-0.1, x_m=0.3, y_m=-0.2, z_m=0.05))
    planes = [[3, 1, 3, -1, -1, 1], [5, -3, 6, -1, -2, 1.5], [2, 2, 6, 2, 0, 1.8], [-3, 1, 2, -2, -1, 1]]
    inferred = int(PlaneFlags.INFERRED)
    return frame(
        info=info,
        R_ned_frd=rotation_from_euler(0.2, -0.15, 0.7),
        model=model([[float(v) for v in p] for p in planes], [0, inferred, 0, inferred]),
        position_ned_m=(5.0, -2.0, -3.0),
    )


def blind() -> ViewFrame:
    return frame(model=model([], cause=InvalidCause.NO_MEASUREMENT), depth_mm=np.zeros((240, 320), np.uint16))
