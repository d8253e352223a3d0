"""Writes logs. The same input gives the same bytes."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.base import BadData, Event, EventSource
from drivers.logs.codec import attitude_message, calibration_message, camera_message, depth_parts, pose_message
from drivers.logs.topics import ENCODING, TOPICS, camera_name_fits
from osape_client.proto import osape_v1_pb2 as pb

from ..error_text import is_no_space
from ..pipeline.encode import decision_message, prisms_bytes, wire_bytes
from ..pipeline.results import FrameDecision, Output
from ..pipeline.state import PipelineState
from ..pipeline.state_messages import state_message
from ..pipeline.tracking import TracksResult
from .foxglove_scene import scene_message, transform_messages
from .log_file import ACTIVE, CHUNK_BYTES, LIBRARY, finish_file, open_locked, refuse_output
from .mcap_writer import ZSTD_LEVEL, McapWriter, Part


class LogWriter:
    """A log being written. As a context manager it is finished at the end, and left as .active after an exception; it is
    deleted after Ctrl-C and where the disk takes no more, since it is made again from its source.

    Raises OSError (no space, no permission), FileInUseError, UnfinishedLogError, and ValueError for an output that exists and
    is not a log, and for timestamps and names that a log cannot hold.

    level: of zstandard, see `McapWriter`."""

    def __init__(self, path: Path | str, level: int = ZSTD_LEVEL) -> None:
        self.path = Path(path)
        refuse_output(self.path, replace=True)
        self.active_path = self.path.with_name(self.path.name + ACTIVE)
        self._file: BinaryIO = open_locked(self.active_path, replace=False)
        self._writer = McapWriter(self._file, CHUNK_BYTES, level)
        self._writer.start(LIBRARY)
        self._schemas: dict[str, int] = {}
        self._names: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._infos: dict[str, CameraInfo] = {}
        self._run: pb.RunInfo | None = None
        self._last_ns = 0

    def __enter__(self) -> LogWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            try:
                self.finish()
            except OSError as failed:
                self._end_unfinished(failed)
                raise
        else:
            self._end_unfinished(error)

    def _end_unfinished(self, error: BaseException | None) -> None:
        if isinstance(error, KeyboardInterrupt) or is_no_space(error):
            self.discard()
        else:
            self.abandon()

    @property
    def bytes_written(self) -> int:
        """Bytes written to the file, without the open chunk."""
        return 0 if self._file.closed else self._file.tell()

    def sync(self) -> None:
        """Ends the open chunk and flushes the file to the disk. Raises OSError."""
        self._writer.end_chunk()
        self._file.flush()
        os.fdatasync(self._file.fileno())

    @property
    def in_place(self) -> bool:
        """Whether the file is still at its path: neither it nor its directory was deleted or moved."""
        try:
            return os.path.samestat(os.stat(self.active_path), os.fstat(self._file.fileno()))
        except OSError:
            return False

    def abandon(self) -> None:
        """Closes the file as FILE.active."""
        with contextlib.suppress(OSError):  # a full disk refuses the rest of the buffer
            self._file.close()

    def discard(self) -> None:
        """Deletes the unfinished file."""
        self.active_path.unlink(missing_ok=True)  # before the lock ends: it is the file of this process
        self.abandon()

    def begin(
        self, run: pb.RunInfo, cameras: Iterable[CameraInfo], state: PipelineState | None = None, t_ns: int = 0
    ) -> None:
        """Writes the opening content. t_ns: time of its records, best that of the first event."""
        self._run, self._infos = run, {info.camera: info for info in cameras}
        self._describe(t_ns)
        for info in self._infos.values():
            self.write("calibration", calibration_message(info, t_ns), t_ns, camera=info.camera)
        self.write("state", state_message(state or PipelineState()), t_ns)

    def _describe(self, t_ns: int) -> None:
        """Writes what no frame can be replayed without."""
        if self._run is not None:
            self.write("run", self._run, t_ns)
        for info in self._infos.values():
            self.write("camera_info", camera_message(info), t_ns, camera=info.camera)

    def event(self, event: Event) -> None:
        """Writes an event of the hardware, at its arrival time."""
        arrival_ns = event.t_arrival_ns
        if isinstance(event, DepthFrame):
            at = (arrival_ns, event.camera, event.sequence, event.t_exposure_ns)
            self._write("depth", depth_parts(event), *at)
        elif isinstance(event, AttitudeSample):
            self.write("attitude", attitude_message(event), arrival_ns, publish_ns=event.t_ns)
        elif isinstance(event, PoseSample):
            self.write("pose", pose_message(event), arrival_ns, publish_ns=event.t_ns)

    def output(self, output: Output, scene: bool = True, transforms: bool = True, prisms: bytes | None = None) -> None:
        """Writes an output of the pipeline, at the arrival of its frame; with drawings for viewers where requested.
        prisms: the encoded message, if available."""
        at = (output.t_arrival_ns, output.camera, output.sequence, output.t_exposure_ns)
        if isinstance(output, FrameDecision):
            self.write("decision", decision_message(output), *at)
            return
        self._write("prisms", (prisms or prisms_bytes(output),), *at)
        if scene:
            self.write("scene", scene_message(output), *at)
        for transform in transform_messages(output, self._infos[output.camera]) if transforms else ():
            self.write("transform", transform, output.t_arrival_ns, publish_ns=output.t_exposure_ns)

    def tracks(self, result: TracksResult, data: bytes) -> None:
        """Writes the tracked obstacles after a frame. data: the encoded message."""
        self._write("tracks", (data,), result.t_arrival_ns, result.camera, result.sequence, result.t_exposure_ns)

    def write(
        self,
        key: str,
        message: Message,
        t_ns: int,
        camera: str = "",
        sequence: int = 0,
        publish_ns: int | None = None,
    ) -> None:
        """Writes one message of the table of topics. t_ns: its arrival."""
        self._write(key, (wire_bytes(message),), t_ns, camera, sequence, publish_ns)

    def _write(
        self, key: str, parts: tuple[Part, ...], t_ns: int, camera: str, sequence: int, publish_ns: int | None
    ) -> None:
        publish_ns = t_ns if publish_ns is None else publish_ns
        if not 0 <= t_ns < 1 << 63 or publish_ns >= 1 << 63:
            raise ValueError(
                f"log: timestamp {t_ns} ns cannot be written; timestamps count from the start of the system's clock"
            )
        if not 0 <= sequence < 1 << 32:
            raise ValueError(f"log: sequence {sequence} cannot be written; expected 0..{(1 << 32) - 1}")
        self._last_ns = t_ns
        channel = self._channels.get((key, camera)) or self._open_channel(key, camera)
        # a stamp before the clock's zero (wrong clock estimate) stays in the message; the record's time cannot be
        # negative
        self._writer.add_message(channel, t_ns, parts, max(0, publish_ns), sequence)

    def _open_channel(self, key: str, camera: str) -> int:
        topic = TOPICS[key]
        if camera and not camera_name_fits(camera):
            raise ValueError(f"log: camera name {camera!r}; use letters, digits, dot, dash and underscore")
        if topic.schema not in self._schemas:
            data = schema_bytes(topic.message)
            self._schemas[topic.schema] = self._writer.register_schema(topic.schema, ENCODING, data)
        name = topic.of(camera)
        if name not in self._names:
            self._names[name] = self._writer.register_channel(name, ENCODING, self._schemas[topic.schema])
        self._channels[key, camera] = self._names[name]
        return self._names[name]

    def finish(self) -> None:
        """Writes the end of the file, with the opening descriptions once more in case the beginning is damaged later, and renames
        it. May be called twice."""
        if self._file.closed:
            return
        self._describe(self._last_ns)
        finish_file(self._writer, self._file, self.active_path, self.path)


def schema_bytes(kind: type[Message]) -> bytes:
    """The schema of a message type with its dependencies, dependencies first: it makes the log self-describing."""
    files: dict[str, Any] = {}

    def add(descriptor: Any) -> None:
        for needed in descriptor.dependencies:
            add(needed)
        files.setdefault(descriptor.name, descriptor)

    add(kind.DESCRIPTOR.file)
    collection = FileDescriptorSet()
    for descriptor in files.values():
        descriptor.CopyToProto(collection.file.add())
    return wire_bytes(collection)


def write_recording(source: EventSource, path: Path | str, run: pb.RunInfo) -> None:
    """Writes the events of a source into a log without prisms. Without a frame nothing is written.
    When the source raises BadData, the log is finished with the events delivered before, and the error is raised."""
    begun = has_frames = False
    with LogWriter(path) as log:
        try:
            for event in source.events():
                if not begun:
                    begun = True
                    log.begin(run, source.cameras, t_ns=event.t_arrival_ns)
                log.event(event)
                has_frames |= isinstance(event, DepthFrame)
        finally:
            if not has_frames:
                log.discard()
            elif isinstance(sys.exception(), BadData):
                log.finish()
