"""Reads a ROS 2 recording (MCAP) with depth images, camera info and the vehicle's attitude.

Two passes: the first reads everything except the images and chooses topics; the second delivers the images with the
samples that had arrived. The log time is the arrival time, the header's stamp the time of measurement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median_low
from typing import Any

from core.types import AttitudeSample, CameraInfo, DepthFrame, Intrinsics, PoseSample
from drivers.base import BadData, Event
from drivers.logs.reader import open_scan
from drivers.logs.record_scanner import Damage, Logged
from drivers.logs.topics import TOPICS

from ..pipeline.sync import NS
from .report import ImportOptions, Report, uncovered
from .ros2_decode import CAMERA_INFO, IMAGE, MOTION_TYPES, TF, Ros2Decoder, type_of
from .ros2_frames import DEPTH_TYPES, TransformTree, depth_from_image, mount_of, rigid
from .ros2_motion import Motion

CLOCKS_APART_NS = 5 * NS
"""Log times farther than this from the stamps belong to another clock (simulated time, a recorder without a clock)."""


MAX_STAMP_ERROR_NS = 60 * NS
"""A stamp farther than this from its arrival is damaged or was never set."""


def stamp_ns(header: Any) -> int:
    """The header's stamp, ns."""
    return int(header.stamp.sec) * NS + int(header.stamp.nanosec)


class Ros2Source:
    """A ROS 2 recording (EventSource). The constructor reads it and raises BadData with the list of topics when none,
    or more than one, fits."""

    def __init__(self, path: Path, options: ImportOptions, report: Report) -> None:
        self._path, self._options, self._report = path, options, report
        self._decode = Ros2Decoder()
        self._types: dict[str, str] = {}
        self._first_images: dict[str, Any] = {}
        self._infos: dict[str, Any] = {}
        self._counts: dict[str, int] = {}
        self._static_tree = TransformTree()
        self._motion = Motion(options.topics.base_frame)
        self._delays_ns: list[int] = []
        self._scan_topics()
        self._offset_ns = self._clock_offset()
        self._depth_topic = self._choose_depth()
        self._info = self._camera_info()
        self._attitudes, self._poses = self._samples()
        self.frame_count = self._counts[self._depth_topic]
        self.shift_ns = 0

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The camera."""
        return (self._info,)

    def close(self) -> None:
        """Does nothing: no file stays open."""

    def events(self) -> Iterator[Event]:
        """All events in order of arrival."""
        items: list[AttitudeSample | PoseSample] = [*self._attitudes, *self._poses]
        waiting = sorted(items, key=lambda s: s.t_arrival_ns)
        next_sample, newest_ns, exposures = 0, 0, []
        for number, (log_ns, message) in enumerate(self._images()):
            t_ns = stamp_ns(message.header)
            arrived_ns = self._arrival_ns(log_ns, t_ns)
            if arrived_ns is None:
                self._report.problem(
                    "stamp",
                    f"{self._path}: {self._depth_topic} image {number}: its stamp, {t_ns} ns, is far from its log "
                    "time; left out, since it cannot have an attitude",
                )
                continue
            arrival_ns = newest_ns = max(newest_ns, arrived_ns)
            while next_sample < len(waiting) and waiting[next_sample].t_arrival_ns <= arrival_ns:
                yield waiting[next_sample]
                next_sample += 1
            frame = self._frame(number, t_ns, arrival_ns, message)
            if frame is not None:
                exposures.append(t_ns)
                yield frame
        yield from waiting[next_sample:]
        missing = uncovered(exposures, [a.t_ns for a in self._attitudes], self._options.sync)
        if missing:
            begin = (missing[0] - exposures[0]) / NS
            self._report.problem(
                "attitude",
                f"{self._path}: {len(missing)} of {len(exposures)} frames have no attitude near them, the first "
                f"{begin:.2f} s after the first frame; they are kept without attitude",
            )

    def _frame(self, number: int, t_ns: int, arrival_ns: int, message: Any) -> DepthFrame | None:
        k = self._info.intrinsics
        where = f"{self._path}: {self._depth_topic} image {number}"
        if (message.width, message.height) != (k.width, k.height):
            self._report.problem(
                "image",
                f"{where}: {message.width}x{message.height} pixels, but the camera info says {k.width}x{k.height}",
            )
            return None
        try:
            depth_mm = depth_from_image(message)
        except BadData as error:
            self._report.problem("image", f"{where}: {error}")
            return None
        return DepthFrame(
            camera=self._info.camera, sequence=number, t_exposure_ns=t_ns, t_arrival_ns=arrival_ns, depth_mm=depth_mm
        )

    def _images(self) -> Iterator[tuple[int, Any]]:
        for item in self._messages():
            if item.channel.topic == self._depth_topic:
                message = self._decode(item)
                if message is None:
                    self._report.problem("image", f"{self._path}: an image of {self._depth_topic} cannot be decoded")
                else:
                    yield item.message.log_time, message

    def _messages(self) -> Iterator[Logged]:
        """ROS messages in file order; damage is reported once."""
        scan = open_scan(self._path)
        try:
            for item in scan.items():
                if isinstance(item, Damage):
                    text = f"{self._path}: {item.cause} (byte {item.offset}); the readable part was kept"
                    if text not in self._report.problems:
                        self._report.problem("damage", text)
                elif isinstance(item, Logged) and item.schema is not None:
                    yield item
        finally:
            scan.close()

    def _scan_topics(self) -> None:
        undecoded: dict[str, int] = {}
        for item in self._messages():
            topic, kind = item.channel.topic, type_of(item.schema.name if item.schema else "")
            self._types[topic] = kind
            self._counts[topic] = self._counts.get(topic, 0) + 1
            once = self._first_images if kind == IMAGE else self._infos if kind == CAMERA_INFO else None
            if (once is not None and topic in once) or not (once is not None or kind == TF or kind in MOTION_TYPES):
                continue
            message = self._decode(item)
            if message is None:
                undecoded[topic] = undecoded.get(topic, 0) + 1
            elif once is not None:
                once[topic] = message
            elif kind == TF:
                self._transforms(topic, message, item.message.log_time)
            else:
                self._delays_ns.append(item.message.log_time - stamp_ns(message.header))
                self._motion.add_message(topic, kind, message, stamp_ns(message.header), item.message.log_time)
        for topic, number in undecoded.items():
            self._report.problem(
                "decode", f"{self._path}: {number} messages of {topic} do not fit their definition in the file"
            )

    def _transforms(self, topic: str, message: Any, log_ns: int) -> None:
        for transform in message.transforms:
            if not topic.endswith("tf_static"):
                self._delays_ns.append(log_ns - stamp_ns(transform.header))
                self._motion.add_moving(topic, transform, stamp_ns(transform.header), log_ns)
                continue
            placed = rigid(transform.transform.translation, transform.transform.rotation)
            if placed is not None:
                self._static_tree.add(transform.header.frame_id, transform.child_frame_id, placed)
                self._motion.add_static(transform.header.frame_id, transform.child_frame_id, placed)

    def _clock_offset(self) -> int:
        """Offset of the log times from the stamps' clock; 0 unless they belong to another clock."""
        if not self._delays_ns:
            return 0
        usual = median_low(self._delays_ns)
        if abs(usual) <= CLOCKS_APART_NS:
            return 0
        self._report.note(
            "log times and stamps belong to different clocks: the smallest delay between them is assumed to be zero"
        )
        return min(d for d in self._delays_ns if abs(d - usual) <= CLOCKS_APART_NS)

    def _arrival_ns(self, log_ns: int, t_ns: int) -> int | None:
        """The arrival on the stamps' clock, not before the measurement; None for an implausible stamp."""
        arrival_ns = log_ns - self._offset_ns
        return max(arrival_ns, t_ns) if t_ns > 0 and abs(arrival_ns - t_ns) <= MAX_STAMP_ERROR_NS else None

    def _choose_depth(self) -> str:
        images = {t: m.encoding for t, m in self._first_images.items()}
        depth = [t for t, encoding in images.items() if encoding in DEPTH_TYPES]
        wanted = self._options.topics.depth
        if wanted is not None and wanted not in depth:
            is_there = f"is {images[wanted]}" if wanted in images else "is not in the recording"
            raise BadData(f"{self._path}: {wanted} {is_there}; depth images: {_joined(depth) or 'none'}")
        if wanted is not None:
            return wanted
        if len(depth) > 1:
            raise BadData(f"{self._path}: several topics with depth: {_joined(depth)}; choose with --depth-topic")
        if not depth:
            raise BadData(f"{self._path}: no depth image in it; {self._found_text()}")
        return depth[0]

    def _found_text(self) -> str:
        ours = sum(kind in {t.schema for t in TOPICS.values()} for kind in self._types.values())
        if ours and not self._first_images:
            return "it is a log of this software: replay it directly"
        kinds = sorted(set(self._types.values()))
        there = ", ".join(f"{kind} ({self._topics_of(kind)})" for kind in kinds[:6]) or "nothing at all"
        compressed = [t for t, kind in self._types.items() if kind == "sensor_msgs/CompressedImage"]
        hint = f"; compressed images ({compressed[0]}) must be republished as sensor_msgs/Image" if compressed else ""
        return f"expected sensor_msgs/Image 16UC1 or 32FC1, found {there}{hint}"

    def _topics_of(self, kind: str) -> str:
        topics = sorted(t for t, k in self._types.items() if k == kind)
        return topics[0] if len(topics) == 1 else f"{topics[0]} and {len(topics) - 1} more"

    def _camera_info(self) -> CameraInfo:
        topic = self._options.topics.camera_info or self._info_topic()
        if topic not in self._infos:
            raise BadData(f"{self._path}: no camera info on {topic}; available: {_joined(list(self._infos)) or 'none'}")
        k_message, image = self._infos[topic], self._first_images[self._depth_topic]
        fx, _, cx, _, fy, cy = list(k_message.k)[:6]
        if any(abs(d) > 1e-6 for d in k_message.d):
            self._report.note(
                f"{topic} contains a lens distortion: it is ignored, since depth images are assumed to be rectified"
            )
        try:
            intrinsics = Intrinsics(int(k_message.width), int(k_message.height), fx, fy, cx, cy)
            info = CameraInfo(self._options.camera.name, intrinsics)
            base, optical = self._options.topics.base_frame, image.header.frame_id
            chain = self._static_tree.between(base, optical)
            if chain is not None:
                info = CameraInfo(info.camera, intrinsics, mount_of(chain, base))
                self._report.note(f"mount from the transforms {base} -> {optical}")
            elif self._options.camera.pitch_deg is None:
                self._report.note(
                    f"no transform connects {base} and {optical}: the camera is assumed to look forward, level; "
                    "otherwise give --mount ROLL,PITCH,YAW"
                )
            return self._options.camera.applied_to(info)
        except ValueError as error:
            raise BadData(f"{self._path}: {topic}: {error}") from error

    def _info_topic(self) -> str:
        beside = self._depth_topic.rsplit("/", 1)[0] + "/camera_info"
        if beside in self._infos:
            return beside
        if len(self._infos) == 1:
            return next(iter(self._infos))
        raise BadData(
            f"{self._path}: no camera info beside {self._depth_topic}; available: "
            f"{_joined(list(self._infos)) or 'none'}; choose with --info-topic"
        )

    def _samples(self) -> tuple[list[AttitudeSample], list[PoseSample]]:
        topics = self._options.topics
        attitude = _choose_topic(self._path, "attitude", topics.attitude, self._motion.attitude_topics(), self._types)
        pose_topics = self._motion.pose_topics()
        pose: str | None = topics.pose
        if pose is None:
            pose = attitude if attitude in pose_topics else pose_topics[0] if len(pose_topics) == 1 else None
        elif pose not in pose_topics:
            raise BadData(f"{self._path}: no position on {pose}; available: {_joined(pose_topics) or 'none'}")
        self._report.note(f"attitude from {attitude}, position from {pose or 'no topic'}")
        invalid = self._motion.unusable(attitude)
        if invalid:
            self._report.problem(
                "attitude", f"{self._path}: {invalid} attitudes of {attitude} are not rotations; left out"
            )
        to_child = self._static_tree.between
        for unconnected in self._motion.unconnected_frames(attitude, to_child):
            self._report.note(
                f"no transform connects {unconnected} and {topics.base_frame}: {attitude} is assumed to be the "
                "attitude of the vehicle; otherwise record /tf_static, or choose with --base-frame"
            )
        attitudes, poses = (
            self._motion.attitudes(attitude, to_child),
            self._motion.poses(pose, to_child) if pose else [],
        )
        kept = [self._attitude(a) for a in attitudes], [self._pose(p) for p in poses]
        lost = sum(a is None for a in kept[0])
        if lost:
            self._report.problem(
                "stamp", f"{self._path}: {lost} attitudes have a stamp far from their log time; left out"
            )
        return [a for a in kept[0] if a is not None], [p for p in kept[1] if p is not None]

    def _attitude(self, a: AttitudeSample) -> AttitudeSample | None:
        arrival_ns = self._arrival_ns(a.t_arrival_ns, a.t_ns)
        return None if arrival_ns is None else replace(a, t_arrival_ns=arrival_ns)

    def _pose(self, p: PoseSample) -> PoseSample | None:
        arrival_ns = self._arrival_ns(p.t_arrival_ns, p.t_ns)
        return None if arrival_ns is None else replace(p, t_arrival_ns=arrival_ns)


def _choose_topic(path: Path, what: str, wanted: str | None, there: list[str], types: dict[str, str]) -> str:
    named = ", ".join(f"{t} ({types[t]})" for t in there)
    if wanted is not None:
        if wanted not in there:
            raise BadData(f"{path}: no {what} on {wanted}; available: {named or 'none'}")
        return wanted
    if len(there) == 1:
        return there[0]
    if there:
        raise BadData(f"{path}: several topics with {what}: {named}; choose with --{what}-topic")
    raise BadData(
        f"{path}: no {what} in it; expected Odometry, PoseStamped, Imu with an orientation, or transforms of the base frame "
        "(--base-frame)"
    )


def _joined(topics: list[str]) -> str:
    return ", ".join(sorted(topics))
