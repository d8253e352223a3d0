"""The bridge: current frames of the service to ROS topics, at most `hz` times per second and camera.

A frame that is older than the subscriber's limit is not published: its age would be lost on the way. What is missing is
published as such, on /diagnostics and as a text in RViz."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Final

from google.protobuf.message import Message

from core.types import CameraInfo
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.sources import CONFLICT_TEXT
from osape_client.subscriber import TIMEOUT_S

from ..pipeline.encode import prisms_from_message
from ..pipeline.results import PrismsResult
from ..viewer.live_camera import NS
from ..viewer.live_status import camera_status, silence_text
from ..viewer.subscriber import LiveSubscriber
from .diagnostics import DIAGNOSTIC_ARRAY, Part, camera_part, diagnostic_array, service_part
from .drawing import MARKER_ARRAY, POINT_CLOUD, TRANSFORMS, Drawing
from .frames import camera_transform, vehicle_transforms
from .message_types import RosMessages
from .occupied import surface_points
from .session import RosNode
from .wire import name_part

REPORT_NS: Final = NS
"""Interval of the diagnostics, and of the texts of cameras without a current frame."""
RATE_MARGIN: Final = 0.9
"""Share of the interval after which the next frame is published: a camera whose rate is a multiple of `hz` jitters."""


def _is_new(exposure_ns: int, last_ns: int) -> bool:
    """Whether an exposure comes after the last one. One that is much older is of a computer that was started again, whose
    monotonic clock begins at 0: a late frame of the same run is not so old, since it would not be published."""
    return exposure_ns > last_ns or exposure_ns < last_ns - NS


@dataclass(frozen=True, slots=True, kw_only=True)
class BridgeOptions:
    """Options of the bridge."""

    namespace: str = "/osape"  # of the topics, with a leading slash
    hz: float = 10.0  # largest rate of each camera
    spacing_m: float = 0.2
    transforms: bool = True  # whether /tf is published


@dataclass(slots=True)
class _Camera:
    """State of one camera."""

    name: str  # in ROS names
    published_ns: int = 0  # when a frame was last published
    exposure_ns: int = 0  # of that of its last transform
    error: str = ""  # why its newest message cannot be used


@dataclass(slots=True)
class Counts:
    """Frames that were published, too old, invalid, and undecodable."""

    published: int = 0
    stale: int = 0
    invalid: int = 0
    undecodable: int = 0


@dataclass(slots=True)
class Ros2Bridge:
    """Set `on_message` as that of the subscriber, and call `tick` repeatedly."""

    subscriber: LiveSubscriber
    node: RosNode
    ros: RosMessages
    options: BridgeOptions
    counts: Counts = field(default_factory=Counts)
    _cameras: dict[str, _Camera] = field(default_factory=dict)
    _vehicle_exposure_ns: int = 0
    _reported_ns: int = 0
    _unavailable: set[str] = field(default_factory=set)

    def on_message(self, message: Message, info: CameraInfo | None) -> None:
        """Publishes a frame, in the subscriber's thread. info: of its camera; None: not received yet."""
        if isinstance(message, pb.PrismsFrame):
            self._frame(message, info, clock_ns())

    def tick(self, now_ns: int) -> str:
        """Publishes the state once per second and when a camera has become unavailable. Returns why the service cannot be
        received, without figures; "": it can."""
        with self.subscriber.changed:
            silence = silence_text(self.subscriber, now_ns)
            cameras = [
                camera_status(self.subscriber, name, None, self._camera(name).error, now_ns)
                for name in self.subscriber.cameras
            ]
            health = self.subscriber.health
        unavailable = {c["name"] for c in cameras if c["blind"]}
        if now_ns - self._reported_ns >= REPORT_NS or not unavailable <= self._unavailable:
            self._reported_ns = now_ns
            self._report(service_part(health, silence), cameras)
        self._unavailable = unavailable
        address = self.subscriber.streams.prisms
        if silence == CONFLICT_TEXT:
            return f"{address}: {silence}"
        return f"no message from the service on {address}: check that it runs (companion status)" if silence else ""

    def _report(self, service: Part, cameras: list[dict[str, Any]]) -> None:
        """Publishes the diagnostics, and removes the drawings of unavailable cameras."""
        parts = [service, *(camera_part(c["name"], c["blind"], c["code"], c["age_s"]) for c in cameras)]
        prefix = self.options.namespace.strip("/")
        self.node.publish("/diagnostics", DIAGNOSTIC_ARRAY, diagnostic_array(self.ros, prefix, parts, time.time_ns()))
        drawing = Drawing(self.ros)
        for row, camera in enumerate(c for c in cameras if c["blind"]):
            gone = drawing.unavailable(camera["name"], camera["blind"], row)
            self.node.publish(f"{self.options.namespace}/markers", MARKER_ARRAY, gone)

    def _frame(self, message: pb.PrismsFrame, info: CameraInfo | None, now_ns: int) -> None:
        camera = self._camera(message.camera)
        camera.error = ""
        age_ns = now_ns - self.subscriber.cameras[message.camera].exposed_ns
        if age_ns > TIMEOUT_S * NS:
            self.counts.stale += 1
            return
        try:
            result = prisms_from_message(message)
        except ValueError as error:
            self._undecodable(camera, error)
            return
        if message.valid and now_ns - camera.published_ns < RATE_MARGIN * NS / self.options.hz:
            return
        stamp_ns = time.time_ns() - age_ns
        self._transforms(camera, result, info, stamp_ns)
        if not message.valid:
            self.counts.invalid += 1
            return
        try:
            self._publish(camera, result, stamp_ns)
        except ValueError as error:
            self._undecodable(camera, error)
            return
        camera.published_ns = now_ns
        self.counts.published += 1

    def _publish(self, camera: _Camera, result: PrismsResult, stamp_ns: int) -> None:
        """Publishes a valid frame. Raises ValueError, before anything is published, for one that cannot be drawn."""
        assert result.model is not None
        drawing, topics = Drawing(self.ros), self.options.namespace
        points_m = surface_points(result.model.planes, self.options.spacing_m)
        cloud = drawing.cloud(points_m, result.frame, stamp_ns)
        markers = drawing.markers(result, stamp_ns)
        self.node.publish(f"{topics}/{camera.name}/points", POINT_CLOUD, cloud)
        self.node.publish(f"{topics}/markers", MARKER_ARRAY, markers)

    def _transforms(self, camera: _Camera, result: PrismsResult, info: CameraInfo | None, stamp_ns: int) -> None:
        """Publishes the transforms of a frame with an attitude, each only with a newer stamp than before."""
        if not self.options.transforms or result.attitude is None:
            return
        tree: list[Any] = []
        if _is_new(result.t_exposure_ns, self._vehicle_exposure_ns):
            self._vehicle_exposure_ns = result.t_exposure_ns
            position_m = None if result.pose is None else result.pose.position_ned_m
            tree += vehicle_transforms(result.attitude.q_ned_frd_wxyz, position_m)
        if info is not None and _is_new(result.t_exposure_ns, camera.exposure_ns):
            camera.exposure_ns = result.t_exposure_ns
            tree.append(camera_transform(info.mount, f"{camera.name}_optical_frame"))
        if tree:
            self.node.publish("/tf", TRANSFORMS, Drawing(self.ros).transforms(tree, stamp_ns))

    def _undecodable(self, camera: _Camera, error: ValueError) -> None:
        camera.error = f"its message cannot be used: {error}"
        self.counts.undecodable += 1

    def _camera(self, name: str) -> _Camera:
        """The state of a camera; its ROS name differs from that of all others."""
        if name not in self._cameras:
            taken = {camera.name for camera in self._cameras.values()}
            part, number = name_part(name), 2
            while part in taken:
                part, number = f"{name_part(name)}_{number}", number + 1
            self._cameras[name] = _Camera(part)
        return self._cameras[name]
