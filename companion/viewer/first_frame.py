"""Prepares a process to draw frames of a service."""

from __future__ import annotations

from core.types import CameraInfo, Intrinsics
from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.encode import SCHEMA_VERSION, prisms_from_message
from .log import view_frame
from .page import frame_data


def load_drawing() -> None:
    """Draws an empty frame: imports the packages and loads the kernels that the first frame of a process needs.

    It needs 0.4 to 0.8 s of processor time. At a low priority on a computer with eight busy processes per core this takes
    37 s, in which a live page gets no response."""
    message = pb.PrismsFrame(schema_version=SCHEMA_VERSION, valid=True)
    message.stats.SetInParent()
    message.attitude.q_ned_frd.w = 1.0
    message.attitude.source = pb.AttitudeUsed.SOURCE_EXACT
    message.transform.yaw_rad = 0.0
    free = message.free
    free.azimuth_edges_rad.extend((0.0, 1.0))
    free.layer_edges_m.extend((0.0, 1.0))
    free.free_from_m.append(0.0)
    free.free_to_m.append(0.0)
    free.end = b"\0"
    info = CameraInfo("none", Intrinsics(width=16, height=16, fx=16.0, fy=16.0, cx=7.5, cy=7.5))
    frame_data(view_frame(prisms_from_message(message), info, None), 0, 0, 0)
