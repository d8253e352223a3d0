"""Drawings of the prisms for viewers: foxglove.SceneUpdate and FrameTransform, for Foxglove and Lichtblick.

Viewers draw z upwards; the root frame `up` (north, west, up) rotates the frame `ned` accordingly."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration

from core.frames import quaternion_from_euler
from core.types import CameraInfo, Prism
from drivers.logs.codec import optical_frame, stamp

from ..pipeline.quaternion import Quaternion as Wxyz
from ..pipeline.quaternion import product, split_heading
from ..pipeline.results import PrismsResult

LIFETIME_S: Final = 1
"""Lifetime of a drawing: a viewer never shows an older one."""
NEAR_M: Final = 2.0
FAR_M: Final = 15.0
"""Ends of the colour scale: red at and below, blue at and above."""

_Q_UP_NED: Final[Wxyz] = (0.0, 1.0, 0.0, 0.0)
Q_CAMFRD_OPTICAL: Final[Wxyz] = (0.5, 0.5, 0.5, 0.5)


def scene_message(result: PrismsResult) -> SceneUpdate:
    """The frame's prisms as triangles; an invalid frame deletes the camera's drawing."""
    name = f"{result.camera} prisms"
    timestamp = stamp(result.t_exposure_ns)
    if result.model is None or not result.valid:
        deletion = SceneEntityDeletion(timestamp=timestamp, type=SceneEntityDeletion.MATCHING_ID, id=name)
        return SceneUpdate(deletions=[deletion])
    x_m, y_m, _ = result.transform.translation_m if result.transform is not None else (0.0, 0.0, 0.0)
    triangles = TriangleListPrimitive(pose=_pose())
    for prism in result.model.prisms:
        _draw(triangles, prism, (x_m, y_m))
    entity = SceneEntity(
        timestamp=timestamp,
        frame_id=result.frame,
        id=name,
        lifetime=Duration(seconds=LIFETIME_S),
        frame_locked=False,
        triangles=[triangles] if triangles.points else [],
    )
    return SceneUpdate(entities=[entity])


def transform_messages(result: PrismsResult, info: CameraInfo) -> tuple[FrameTransform, ...]:
    """up -> ned -> level -> frd -> the camera's optical frame at exposure. Without a position, ned's origin is drawn at
    the vehicle. A frame without attitude has no transforms."""
    if result.attitude is None:
        return ()
    q_ned_level, q_level_frd = split_heading(result.attitude.q_ned_frd_wxyz)
    position_m = result.pose.position_ned_m if result.pose is not None else (0.0, 0.0, 0.0)
    here = (0.0, 0.0, 0.0)
    tree: tuple[tuple[str, str, tuple[float, float, float], Wxyz], ...] = (
        ("up", "ned", here, _Q_UP_NED),
        ("ned", "level", position_m, q_ned_level),
        ("level", "frd", here, q_level_frd),
        ("frd", optical_frame(info.camera), *mount_transform(info)),
    )
    return tuple(
        FrameTransform(
            timestamp=stamp(result.t_exposure_ns),
            parent_frame_id=parent,
            child_frame_id=child,
            translation=Vector3(x=t[0], y=t[1], z=t[2]),
            rotation=Quaternion(w=q[0], x=q[1], y=q[2], z=q[3]),
        )
        for parent, child, t, q in tree
    )


def mount_transform(info: CameraInfo) -> tuple[tuple[float, float, float], Wxyz]:
    """(translation in m, rotation) of the camera's optical frame in frd."""
    m = info.mount
    return (m.x_m, m.y_m, m.z_m), product(quaternion_from_euler(m.roll_rad, m.pitch_rad, m.yaw_rad), Q_CAMFRD_OPTICAL)


def _pose() -> Pose:
    return Pose(position=Vector3(), orientation=Quaternion(w=1.0))


def _draw(triangles: TriangleListPrimitive, prism: Prism, camera_xy: tuple[float, float]) -> None:
    """Two triangles per edge of the side profile; the four corners are stored once, since the service draws in flight."""
    for a, b in prism_edges(prism):
        first = len(triangles.points)
        for p, z in ((a, prism.top_m), (b, prism.top_m), (b, prism.bottom_m), (a, prism.bottom_m)):
            triangles.points.add(x=p[0], y=p[1], z=z)
        triangles.colors.extend([distance_colour(segment_distance_m(a, b, camera_xy))] * 4)
        triangles.indices.extend([first + i for i in (0, 1, 2, 0, 2, 3)])


def prism_edges(prism: Prism) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Begin and end, x and y in m, of each edge of a prism's side profile."""
    xy = [(x, y) for x, y in prism.vertices_m.tolist()]
    return zip(xy, xy[1:] + xy[:1] if prism.closed else xy[1:], strict=False)


def segment_distance_m(a: Sequence[float], b: Sequence[float], p: Sequence[float]) -> float:
    """Horizontal distance from the point p to the segment a -> b, m."""
    along_x, along_y = b[0] - a[0], b[1] - a[1]
    to_x, to_y = p[0] - a[0], p[1] - a[1]
    length2 = along_x * along_x + along_y * along_y
    share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, (to_x * along_x + to_y * along_y) / length2))
    return math.hypot(share * along_x - to_x, share * along_y - to_y)


def distance_colour(distance_m: float) -> Color:
    """Red (NEAR_M and nearer) over yellow and green to blue (FAR_M and farther), partly transparent."""
    h = 4.0 * min(1.0, max(0.0, (distance_m - NEAR_M) / (FAR_M - NEAR_M)))
    red, green, blue = min(1.0, max(0.0, 2.0 - h)), min(1.0, h, 4.0 - h), min(1.0, max(0.0, h - 2.0))
    return Color(r=red, g=green, b=blue, a=0.8)
