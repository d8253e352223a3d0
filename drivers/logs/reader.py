"""Reads a log as a source of events, in the order of arrival on board (the order of the file)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError, Message
from mcap.records import Channel, Metadata, Schema

from core.types import UNKNOWN_MM, CameraInfo, DepthFrame
from osape_client.proto import osape_v1_pb2 as pb

from ..base import BadData, DeviceNotFound, Event
from ..shell_word import shell_word
from .codec import (
    attitude_from_message,
    camera_from_message,
    checked_stamps,
    depth_from_message,
    pose_from_message,
    stamp_ns,
)
from .record_scanner import Damage, Logged, McapScan, NotMcap
from .topics import ENCODING, TOPICS, find_topic
from .written import seems_written

EVENT_KEYS: Final = ("depth", "attitude", "pose")
_ROS2_DEPTH: Final = ("sensor_msgs/msg/Image", "sensor_msgs/Image")
_LISTED: Final = 4
LOST: Final = "osape lost"
"""Name of the metadata that state what a recovered log has lost: places in the damaged file and causes."""
BORROWED: Final = "osape taken from another log"
"""Name of the metadata that state which descriptions of a recovered log are from another one: topic and path of that log."""


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """A message of this software."""

    key: str  # in TOPICS
    camera: str  # empty where the topic has none
    t_log_ns: int  # its arrival
    sequence: int
    message: Message


def open_scan(path: Path) -> McapScan:
    """Opens an MCAP file for a pass. Raises DeviceNotFound and BadData."""
    try:
        return McapScan(path)
    except NotMcap as error:
        raise BadData(
            f"{path}: not an MCAP file ({error}); give a log that was recorded as MCAP, or another copy of this one"
        ) from error
    except FileNotFoundError as error:
        raise DeviceNotFound(f"{path}: the file does not exist; check the path") from error
    except IsADirectoryError as error:
        raise BadData(f"{path}: a directory; give one of its logs (`companion batch` takes directories)") from error
    except OSError as error:
        raise DeviceNotFound(
            f"{path}: cannot be opened ({error.strerror}); check the path and its permissions"
        ) from error


class McapRecording:
    """A log of this software. The constructor raises DriverError: file missing, not MCAP, of another software, without
    depth.

    `run`: provenance of the log; `snapshot`: the state at its beginning; None: not in the log. After a pass, of a
    recovered log: `lost`: what it lacks; `borrowed`: topic -> the log from which its description was taken."""

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.run: pb.RunInfo | None = None
        self.snapshot: pb.StateSnapshot | None = None
        self.lost: list[str] = []
        self.borrowed: dict[str, str] = {}
        self._infos: dict[str, CameraInfo] = {}
        self._scan: McapScan | None = None
        self.share_read = 0.0
        """Progress of the present pass, 0..1."""
        self._head_damage: Damage | None = None
        self._read_head()

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The cameras described in the log, in order of appearance."""
        return tuple(self._infos.values())

    def __enter__(self) -> McapRecording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file and ends the present pass. May be called twice."""
        if self._scan is not None:
            self._scan.close()
            self._scan = None

    def events(self) -> Iterator[Event]:
        """Depth, attitude and pose in file order. Invalid samples are left out; an invalid image is delivered as one
        unknown pixel, so that its exposure is blind; at damage of the file the pass ends. BadData is raised at the end with
        all problems, after everything readable was delivered."""
        for item in self.events_with():
            if not isinstance(item, LoggedMessage):
                yield item

    def events_with(self, *keys: str) -> Iterator[Event | LoggedMessage]:
        """events(), with messages of these kinds in file order."""
        rejected: list[str] = []
        for item in self._messages((*EVENT_KEYS, *keys), rejected):
            if item.key not in EVENT_KEYS:
                yield item
                continue
            try:
                event = self._event(item)
            except ValueError as error:
                rejected.append(f"{TOPICS[item.key].of(item.camera)}: {error}")
                blind = self._unreadable(item)
                if blind is None:
                    continue
                event = blind
            yield event
        if rejected:
            raise BadData(
                f"{self.path}: {len(rejected)} messages are invalid and were left out (an image among them is blind), "
                f"the first: {rejected[0]}; correct the recording software, or continue without them"
            )

    def messages(self, *keys: str) -> Iterator[LoggedMessage]:
        """The messages of these kinds (keys of TOPICS; none given: all), decoded. Raises BadData as events() does."""
        rejected: list[str] = []
        yield from self._messages(keys or tuple(TOPICS), rejected)
        if rejected:
            raise BadData(f"{self.path}: {len(rejected)} messages could not be decoded, the first: {rejected[0]}")

    def _messages(self, keys: tuple[str, ...], rejected: list[str]) -> Iterator[LoggedMessage]:
        self.close()
        scan = self._scan = open_scan(self.path)
        self.lost, self.borrowed = [], {}
        ours: dict[int, tuple[str, str] | None] = {}
        for item in scan.items():
            self.share_read = scan.share_read
            if isinstance(item, Damage):
                raise BadData(damage_text(self.path, item))
            if isinstance(item, Metadata):
                self.lost += lost_places(item)
                self.borrowed |= borrowed_from(item)
            if not isinstance(item, Logged):
                continue
            if item.channel.id not in ours:
                ours[item.channel.id] = our_channel(item.channel, item.schema)
            found = ours[item.channel.id]
            if found is None or found[0] not in keys:
                continue
            message = TOPICS[found[0]].message()
            try:
                message.ParseFromString(item.message.data)
            except DecodeError as error:
                rejected.append(f"{item.channel.topic}: {error}")
                continue
            yield LoggedMessage(*found, item.message.log_time, item.message.sequence, message)
        self.share_read = 1.0
        self.close()

    def _event(self, item: LoggedMessage) -> Event:
        message = item.message
        if isinstance(message, RawImage):
            return depth_from_message(message, self._infos[item.camera], item.sequence, item.t_log_ns)
        if isinstance(message, pb.AttitudeSample):
            return attitude_from_message(message)
        if isinstance(message, pb.PoseSample):
            return pose_from_message(message)
        raise ValueError(f"{item.key} is not an event")

    def _unreadable(self, item: LoggedMessage) -> DepthFrame | None:
        """A frame of one unknown pixel in place of an invalid image; None where its timestamps are invalid too."""
        if not isinstance(item.message, RawImage):
            return None
        try:
            t_exposure_ns, t_arrival_ns = checked_stamps(stamp_ns(item.message.timestamp), item.t_log_ns)
        except ValueError:
            return None
        return DepthFrame(
            camera=item.camera,
            sequence=item.sequence,
            t_exposure_ns=t_exposure_ns,
            t_arrival_ns=t_arrival_ns,
            depth_mm=np.full((1, 1), UNKNOWN_MM, np.uint16),
        )

    def _read_head(self) -> None:
        """Reads cameras, provenance and state in one pass, which ends early where the file's summary lists the cameras."""
        scan = open_scan(self.path)
        try:
            self._read_descriptions(scan)
            found = {c.id: our_channel(c, scan.schemas.get(c.schema_id)) for c in scan.channels.values()}
            depth = [camera for kind in found.values() if kind is not None for key, camera in [kind] if key == "depth"]
            others = [c for c in scan.channels.values() if found[c.id] is None]
            if not any(found.values()) and (others or self._head_damage is None):
                raise BadData(_refusal(self.path, scan, others))
        finally:
            scan.close()
        missing = [camera for camera in depth if camera not in self._infos]
        if self._head_damage is not None and (missing or not self._infos):
            raise BadData(
                f"{self.path}: damaged at byte {self._head_damage.offset}: {self._head_damage.cause}; the description "
                f"of the cameras is lost. Use another copy of the file, or {_borrow_text(self.path)}"
            )
        if missing:
            names = ", ".join(TOPICS["camera_info"].of(camera) for camera in missing)
            raise BadData(
                f"{self.path}: depth images without the description of their camera ({names} is missing or invalid); "
                f"if it was imported, import the recording again with its intrinsics; otherwise {_borrow_text(self.path)}"
            )

    def _read_descriptions(self, scan: McapScan) -> None:
        awaited = _described(scan)
        begun = False
        for item in scan.items():
            if isinstance(item, Damage):
                self._head_damage = self._head_damage or item
            if not isinstance(item, Logged):
                continue
            found = our_channel(item.channel, item.schema)
            if found is None:
                continue
            key, camera = found
            begun = begun or key in EVENT_KEYS
            if key in ("run", "state", "camera_info"):
                self._describe(key, camera, item.message.data, begun)
            if begun and awaited is not None and awaited <= self._infos.keys():
                return

    def _describe(self, key: str, camera: str, data: bytes, begun: bool) -> None:
        topic = TOPICS[key].of(camera)
        try:
            if key == "camera_info" and camera not in self._infos:
                info = camera_from_message(pb.CameraInfo.FromString(data))
                if info.camera != camera:
                    raise ValueError(f"it describes the camera {info.camera!r}")
                self._infos[camera] = info
            elif key == "run" and self.run is None:
                self.run = pb.RunInfo.FromString(data)
            elif key == "state" and self.snapshot is None and not begun:
                self.snapshot = pb.StateSnapshot.FromString(data)
        except (DecodeError, ValueError) as error:
            raise BadData(f"{self.path}: {topic}: {error}; import the recording again with correct values") from error


def our_channel(channel: Channel, schema: Schema | None) -> tuple[str, str] | None:
    """(key of TOPICS, camera) of a channel of this software; None: another channel."""
    if schema is None or channel.message_encoding != ENCODING:
        return None
    return find_topic(channel.topic, schema.name)


def lost_places(item: Metadata) -> list[str]:
    """The places of the damaged file that a recovered log lacks, with their causes, as text; none for other metadata."""
    return [f"byte {offset}: {cause}" for offset, cause in item.metadata.items()] if item.name == LOST else []


def borrowed_from(item: Metadata) -> dict[str, str]:
    """Topic -> the log from which `companion recover` took its description; none for other metadata."""
    return item.metadata if item.name == BORROWED else {}


def damage_text(path: Path, damage: Damage) -> str:
    """The text of a damage with its remedy, or why it is none."""
    if damage.end and seems_written(path):
        return f"{path}: a process is writing it; what it had written was read"
    return (
        f"{path}: damaged at byte {damage.offset}: {damage.cause}; everything before it was read. `companion recover "
        f"{shell_word(path)}` recovers the readable part"
    )


def _borrow_text(path: Path) -> str:
    """What to do about a log that has lost the description of its cameras."""
    return (
        f"`companion recover {shell_word(path)} --cameras-from LOG.mcap` takes it from another log of the same vehicle and set-up, "
        "such as the next file of the flight"
    )


def _described(scan: McapScan) -> set[str] | None:
    """The cameras with depth images by the file's summary; None without a summary."""
    if scan.summary is None:
        return None
    kinds = (our_channel(c, scan.summary.schemas.get(c.schema_id)) for c in scan.summary.channels.values())
    return {kind[1] for kind in kinds if kind is not None and kind[0] == "depth"}


def _refusal(path: Path, scan: McapScan, others: list[Channel]) -> str:
    schemas = {c.topic: scan.schemas[c.schema_id].name if c.schema_id in scan.schemas else "no schema" for c in others}
    ros_depth = sorted(topic for topic, schema in schemas.items() if schema in _ROS2_DEPTH)
    has = ", ".join(f"{topic} ({schema})" for topic, schema in sorted(schemas.items())[:_LISTED]) or "no topics"
    more = f" and {len(schemas) - _LISTED} more" if len(schemas) > _LISTED else ""
    if ros_depth:
        remedy = f"it contains ROS 2 images ({', '.join(ros_depth)}): `companion import {shell_word(path)} -o OUT.mcap` converts them"
    else:
        remedy = "use a log written by companion, or convert the recording with `companion import`"
    depth, info, attitude = (TOPICS[key] for key in ("depth", "camera_info", "attitude"))
    return (
        f"{path}: not a recording of this software. It lacks depth ({depth.schema} on {depth.of('<name>')}), camera "
        f"({info.schema} on {info.of('<name>')}) and attitude ({attitude.schema} on {attitude.name}); "
        f"it has {has}{more}. Remedy: {remedy}"
    )
