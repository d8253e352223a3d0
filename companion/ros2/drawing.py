"""Messages for RViz and planners: markers of planes and prisms, a point cloud of occupied surfaces, transforms.

The stamp of each message is the wall time of the exposure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from core.types import Prism

from ..log.foxglove_scene import distance_colour, prism_edges, segment_distance_m
from ..pipeline.results import PrismsResult
from ..viewer.geometry import plane_corners_m
from .frames import BASE_LINK, FrameTransform, frame_id, ros_points
from .message_types import NS, RosMessages

MARKER, MARKER_ARRAY = "visualization_msgs/msg/Marker", "visualization_msgs/msg/MarkerArray"
POINT_CLOUD, POINT_FIELD = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/PointField"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

LIFETIME_NS: Final = NS // 2
"""A viewer removes the drawing of a frame after this time, unless a newer one replaces it."""
TEXT_LIFETIME_NS: Final = 3 * NS // 2
"""Lifetime of the text of a camera without a current frame, which is repeated once per second."""
LINE_WIDTH_M: Final = 0.03
TEXT_HEIGHT_M: Final = 0.3
_POINT_BYTES: Final = 12

GREY: Final = (0.6, 0.6, 0.6, 1.0)
RED: Final = (1.0, 0.1, 0.1, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shape:
    """What a marker adds to the drawing."""

    kind: str  # name of a constant of visualization_msgs/Marker
    # points, colours: messages of the corners, and the colour of each; no colours: that of the marker
    points: Sequence[Any] = ()
    colours: Sequence[Any] = ()
    text: str = ""  # of TEXT_VIEW_FACING
    colour: tuple[float, float, float, float] = GREY  # (r, g, b, a), 0..1, of the whole marker
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)  # (x, y, z) in m
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # place in m, in the frame of the header
    lifetime_ns: int = 0  # time after which a viewer removes it; 0: never


class Drawing:
    """Builds the messages of one camera's frames."""

    def __init__(self, messages: RosMessages) -> None:
        self._ros = messages

    def markers(self, result: PrismsResult, stamp_ns: int) -> Any:
        """MarkerArray of a valid frame: prisms as surfaces coloured by distance (namespace CAMERA/prisms), planes as
        outlines (CAMERA/planes). What the frame does not contain is deleted. Raises ValueError for an unknown frame."""
        header = self._ros.header(stamp_ns, frame_id(result.frame))
        assert result.model is not None
        x_m, y_m, _ = result.transform.translation_m if result.transform is not None else (0.0, 0.0, 0.0)
        corners, colours = _prism_triangles(result.model.prisms, (x_m, y_m))
        outlines = _plane_outlines(result.model.planes)
        rgba = [self._colour(colour) for colour in colours]
        surfaces = _Shape(
            kind="TRIANGLE_LIST",
            points=self._points(corners, result.frame),
            colours=rgba,
            lifetime_ns=LIFETIME_NS,
        )
        lines = _Shape(
            kind="LINE_LIST",
            points=self._points(outlines, result.frame),
            scale=(LINE_WIDTH_M, 0.0, 0.0),
            lifetime_ns=LIFETIME_NS,
        )
        # viewers refuse a marker without points
        return self._array(
            [
                self._marker(header, f"{result.camera}/{what}", shape, delete=not shape.points)
                for what, shape in (("prisms", surfaces), ("planes", lines))
            ]
        )

    def unavailable(self, camera: str, text: str, row: int) -> Any:
        """MarkerArray of a camera without a current frame: its drawings are deleted, and a red text above the vehicle names
        the cause. row: of the text, from below."""
        header = self._ros.header(0, BASE_LINK)
        gone = [
            self._marker(header, f"{camera}/{what}", _Shape(kind="CUBE"), delete=True) for what in ("prisms", "planes")
        ]
        label = _Shape(
            kind="TEXT_VIEW_FACING",
            text=f"{camera}: NO DATA: {text}",
            colour=RED,
            scale=(0.0, 0.0, TEXT_HEIGHT_M),
            at=(0.0, 0.0, 1.0 + row * 1.5 * TEXT_HEIGHT_M),
            lifetime_ns=TEXT_LIFETIME_NS,
        )
        return self._array([*gone, self._marker(header, f"{camera}/state", label)])

    def cloud(self, points_m: NDArray[np.float64], frame: str, stamp_ns: int) -> Any:
        """PointCloud2 of (N, 3) points of the frame ned or level, float32 x, y, z. Raises ValueError for another frame."""
        data = np.ascontiguousarray(ros_points(points_m, frame), dtype="<f4")
        fields = [
            self._ros.make(
                POINT_FIELD, name=name, offset=4 * k, datatype=self._ros.constant(POINT_FIELD, "FLOAT32"), count=1
            )
            for k, name in enumerate("xyz")
        ]
        return self._ros.make(
            POINT_CLOUD,
            header=self._ros.header(stamp_ns, frame_id(frame)),
            height=1,
            width=len(data),
            fields=fields,
            is_bigendian=False,
            point_step=_POINT_BYTES,
            row_step=_POINT_BYTES * len(data),
            data=data.reshape(-1).view(np.uint8),
            is_dense=True,
        )

    def transforms(self, tree: Sequence[FrameTransform], stamp_ns: int) -> Any:
        """TFMessage of transforms at one time."""
        return self._ros.make(
            TRANSFORMS,
            transforms=[
                self._ros.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self._ros.header(stamp_ns, t.parent),
                    child_frame_id=t.child,
                    transform=self._ros.make(
                        "geometry_msgs/msg/Transform",
                        translation=self._ros.vector(*t.translation_m),
                        rotation=self._ros.quaternion(*t.q_wxyz),
                    ),
                )
                for t in tree
            ],
        )

    def _points(self, corners: NDArray[np.float64], frame: str) -> list[Any]:
        return [self._ros.point(x, y, z) for x, y, z in ros_points(corners, frame).tolist()]

    def _array(self, markers: list[Any]) -> Any:
        return self._ros.make(MARKER_ARRAY, markers=markers)

    def _colour(self, rgba: tuple[float, float, float, float]) -> Any:
        return self._ros.make("std_msgs/msg/ColorRGBA", r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])

    def _marker(self, header: Any, name: str, shape: _Shape, *, delete: bool = False) -> Any:
        """A marker of the namespace `name`, or its deletion."""
        ros = self._ros
        return ros.make(
            MARKER,
            header=header,
            ns=name,
            id=0,
            type=ros.constant(MARKER, shape.kind),
            action=ros.constant(MARKER, "DELETE" if delete else "ADD"),
            pose=ros.make(
                "geometry_msgs/msg/Pose", position=ros.point(*shape.at), orientation=ros.quaternion(1.0, 0.0, 0.0, 0.0)
            ),
            scale=ros.vector(*shape.scale),
            color=self._colour(shape.colour),
            lifetime=ros.make(
                "builtin_interfaces/msg/Duration", sec=shape.lifetime_ns // NS, nanosec=shape.lifetime_ns % NS
            ),
            frame_locked=False,
            points=list(shape.points),
            colors=list(shape.colours),
            texture_resource="",
            texture=ros.make(
                "sensor_msgs/msg/CompressedImage", header=ros.header(0, ""), format="", data=np.zeros(0, np.uint8)
            ),
            uv_coordinates=[],
            text=shape.text,
            mesh_resource="",
            mesh_file=ros.make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )


def _prism_triangles(
    prisms: Sequence[Prism], camera_xy_m: tuple[float, float]
) -> tuple[NDArray[np.float64], list[tuple[float, float, float, float]]]:
    """(points (6 E, 3), colour of each) of the E edges of side profiles, two triangles per edge, in the frame of the
    prisms. An edge has the colour of the distance of its nearest point."""
    corners: list[tuple[float, float, float]] = []
    colours: list[tuple[float, float, float, float]] = []
    for prism in prisms:
        for a, b in prism_edges(prism):
            a_top, b_top = (*a, prism.top_m), (*b, prism.top_m)
            a_low, b_low = (*a, prism.bottom_m), (*b, prism.bottom_m)
            corners.extend([a_top, b_top, b_low, a_top, b_low, a_low])
            c = distance_colour(segment_distance_m(a, b, camera_xy_m))
            colours.extend([(c.r, c.g, c.b, c.a)] * 6)
    return np.array(corners, dtype=np.float64).reshape(-1, 3), colours


def _plane_outlines(planes: NDArray[np.float32]) -> NDArray[np.float64]:
    """(8 N, 3) ends of the four sides of each of (N, 6) planes, in the frame of the planes."""
    return plane_corners_m(planes)[:, (0, 1, 1, 2, 2, 3, 3, 0)].reshape(-1, 3)
