"""Descriptions of cameras and configuration, from another log for one that has lost its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from core.types import CameraInfo
from drivers.base import BadData
from drivers.logs.codec import camera_from_message, optical_frame
from drivers.logs.reader import open_scan, our_channel
from drivers.logs.record_scanner import Logged
from drivers.logs.topics import TOPICS
from osape_client.proto import osape_v1_pb2 as pb

from ..usage_error import UsageError
from .foxglove_scene import mount_transform

_DESCRIBING = ("run", "camera_info")
_SAME_MOUNT: Final = 1e-6
"""Greatest difference of a mount's position in m, and of the numbers of its quaternion, between two records of it."""


@dataclass(slots=True)
class Descriptions:
    """Messages that describe a run and its cameras. origin: the log they are from."""

    origin: Path
    messages: list[Logged]

    @property
    def origins(self) -> dict[str, str]:
        """Topic -> the log that its description is from."""
        return {item.channel.topic: str(self.origin) for item in self.messages}


@dataclass(slots=True)
class _Recorded:
    """What the messages of a log say of its cameras. sizes_px: (width, height) of the first image. mounts: of the transforms for
    viewers, by optical frame: position in m and quaternion (7,)."""

    kinds: set[tuple[str, str]] = field(default_factory=set)
    first_ns: int | None = None
    sizes_px: dict[str, tuple[int, int]] = field(default_factory=dict)
    mounts: dict[str, NDArray[np.float64]] = field(default_factory=dict)

    def take(self, key: str, camera: str, item: Logged) -> None:
        self.kinds.add((key, camera))
        self.first_ns = item.message.log_time if self.first_ns is None else self.first_ns
        with suppress(DecodeError):  # a damaged message, which a replay reports
            self._take_content(key, camera, item)

    def _take_content(self, key: str, camera: str, item: Logged) -> None:
        if key == "depth" and camera not in self.sizes_px:
            image = RawImage.FromString(item.message.data)
            self.sizes_px[camera] = image.width, image.height
        elif key == "transform":
            transform = FrameTransform.FromString(item.message.data)
            if transform.parent_frame_id == "frd":
                t, q = transform.translation, transform.rotation
                self.mounts[transform.child_frame_id] = np.array([t.x, t.y, t.z, q.w, q.x, q.y, q.z])

    def difference(self, camera: str, info: CameraInfo) -> str:
        """How a description differs from what the messages of a camera say; "" where it does not."""
        if info.camera != camera:
            return f"describes the camera {info.camera!r}, not {camera!r}"
        k = info.intrinsics
        width, height = self.sizes_px.get(camera, (k.width, k.height))
        if (k.width, k.height) != (width, height):
            return f"is for images of {k.width}x{k.height} pixels, and these have {width}x{height}"
        mount = self.mounts.get(optical_frame(info.camera))
        position_m, q = mount_transform(info)
        if (
            mount is not None
            and min(np.abs(mount - [*position_m, *sign_q]).max() for sign_q in (q, [-c for c in q])) > _SAME_MOUNT
        ):
            return f"has another mount than {TOPICS['transform'].name}"
        return ""


def lost_descriptions(path: Path, other: Path) -> Descriptions:
    """The messages of `other` that describe the run and the cameras of `path` and that this one lacks, at the time of its first
    message. Raises DriverError for a file that cannot be read, UsageError where none is lacking, or the other log does not have
    them, or describes a camera that differs from that of the images."""
    recorded = _Recorded()
    for (key, camera), item in _ours(path):
        recorded.take(key, camera, item)
    wanted = {
        ("run", ""),
        *(("camera_info", camera) for key, camera in recorded.kinds if key == "depth"),
    } - recorded.kinds
    if not wanted - {("run", "")}:
        raise UsageError(f"{path}: no description of a camera is lost; leave --cameras-from out")
    found: dict[tuple[str, str], Logged] = {}
    for kind, item in _ours(other):
        if kind in wanted:
            found.setdefault(kind, item)
    remedy = "give a log of the same vehicle and set-up, such as another file of the flight"
    missing = sorted(TOPICS[key].of(camera) for key, camera in wanted - found.keys())
    if missing:
        raise UsageError(f"{other}: has no {', '.join(missing)}; {remedy}")
    for (key, camera), item in found.items():
        if key == "camera_info":
            info = _described(other, item)
            if difference := recorded.difference(camera, info):
                raise UsageError(f"{other}: {item.channel.topic} {difference}, in {path}: another set-up; {remedy}")
    for item in found.values():
        item.message.log_time = item.message.publish_time = recorded.first_ns or 0
    return Descriptions(other, [found[kind] for kind in sorted(found, key=lambda kind: _DESCRIBING.index(kind[0]))])


def _described(path: Path, item: Logged) -> CameraInfo:
    """The camera of a message. Raises BadData."""
    try:
        return camera_from_message(pb.CameraInfo.FromString(item.message.data))
    except (DecodeError, ValueError) as error:
        raise BadData(
            f"{path}: {item.channel.topic}: {error}; give another log of the same vehicle and set-up"
        ) from error


def _ours(path: Path) -> Iterator[tuple[tuple[str, str], Logged]]:
    """The messages of this software, with key and camera."""
    scan = open_scan(path)
    try:
        for item in scan.items():
            if isinstance(item, Logged):
                kind = our_channel(item.channel, item.schema)
                if kind is not None:
                    yield kind, item
    finally:
        scan.close()
