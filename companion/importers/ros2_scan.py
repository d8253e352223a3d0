"""The first pass over a ROS 2 recording: its topics, and everything that it holds except the images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median_low
from typing import Any

from drivers.mavlink.tlog import map_boot_clock

from ..pipeline.sync import NS
from .report import Report
from .ros2_decode import CAMERA_INFO, COMPRESSED, IMAGE, MOTION_TYPES, TF
from .ros2_files import RosItem, RosRecording
from .ros2_frames import TransformTree, rigid
from .ros2_motion import Motion
from .ros2_px4 import PX4_TYPES, VEHICLE_LOCAL_POSITION, px4_stamp_ns

CLOCKS_APART_NS = 5 * NS
"""Log times farther than this from the stamps belong to another clock (simulated time, a recorder without a clock)."""
MAX_STAMP_ERROR_NS = 60 * NS
"""A stamp farther than this from its arrival is damaged or was never set."""


def stamp_ns(header: Any) -> int:
    """The header's stamp, ns."""
    return int(header.stamp.sec) * NS + int(header.stamp.nanosec)


class RosScan:
    """What a recording holds, and how its log times and stamps are related.

    Attributes:
        types: topic -> type of its first message; those of another type are left out.
        counts: topic -> number of messages of this type.
        first_images: topic -> the first image.
        infos: topic -> the first CameraInfo.
        static_tree: the constant transforms.
        motion: attitudes and positions."""

    def __init__(self, recording: RosRecording, path: Path, base_frame: str, report: Report) -> None:
        """path: of the recording, for the report."""
        self._path, self._report = path, report
        self.types: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        self.first_images: dict[str, Any] = {}
        self.infos: dict[str, Any] = {}
        self.static_tree = TransformTree()
        self.motion = Motion(base_frame)
        self._delays_ns: list[int] = []
        self._image_delays_ns: list[int] = []
        self._log_span_ns: dict[str, tuple[int, int]] = {}
        self._scan(recording)
        self._offset_ns = self._clock_offset()
        self._map_px4_stamps()

    def span_ns(self, topic: str) -> tuple[int, int]:
        """First and last log time of a topic on the stamps' clock."""
        first_ns, last_ns = self._log_span_ns[topic]
        return first_ns - self._offset_ns, last_ns - self._offset_ns

    @property
    def recorder_behind_ns(self) -> int | None:
        """By which the log times are usually before the stamps of the motion; 0: they are after them, or there is no motion. None:
        log times and stamps are of different clocks."""
        if self._offset_ns:
            return None
        return max(0, -median_low(self._delays_ns)) if self._delays_ns else 0

    def arrival_ns(self, log_ns: int, t_ns: int) -> int | None:
        """The arrival on the stamps' clock, not before the measurement; None for an implausible stamp."""
        arrival_ns = log_ns - self._offset_ns
        return max(arrival_ns, t_ns) if t_ns > 0 and abs(arrival_ns - t_ns) <= MAX_STAMP_ERROR_NS else None

    def _scan(self, recording: RosRecording) -> None:
        """Reads all messages, of images and camera infos the first of each topic."""
        undecoded: Counter[str] = Counter()
        others: Counter[tuple[str, str]] = Counter()
        for item in recording.items():
            topic, kind = item.topic, item.kind
            if kind != self.types.setdefault(topic, kind):
                others[topic, kind] += 1
                continue
            self.counts[topic] += 1
            first_ns, last_ns = self._log_span_ns.get(topic, (item.log_ns, item.log_ns))
            self._log_span_ns[topic] = min(first_ns, item.log_ns), max(last_ns, item.log_ns)
            if self._is_read(topic, kind):
                message = item.decode()
                if message is None:
                    undecoded[topic] += 1
                else:
                    self._take(item, message)
        self._report_undecoded(undecoded)
        for (topic, kind), number in others.items():
            what = "1 message is" if number == 1 else f"{number} messages are"
            text = f"{self._path}: {topic}: {what} {kind}, the first is {self.types[topic]}; left out"
            self._report.problem("type", text)

    def _is_read(self, topic: str, kind: str) -> bool:
        if kind in (IMAGE, COMPRESSED):
            return topic not in self.first_images
        if kind == CAMERA_INFO:
            return topic not in self.infos
        return kind == TF or kind in MOTION_TYPES

    def _take(self, item: RosItem, message: Any) -> None:
        topic, kind = item.topic, item.kind
        if kind in (IMAGE, COMPRESSED):
            self.first_images[topic] = message
            self._image_delays_ns.append(item.log_ns - stamp_ns(message.header))
        elif kind == CAMERA_INFO:
            self.infos[topic] = message
        elif kind == TF:
            self._transforms(topic, message, item.log_ns)
        elif kind in PX4_TYPES:
            self.motion.add_message(topic, kind, message, px4_stamp_ns(message), item.log_ns)
        else:
            self._delays_ns.append(item.log_ns - stamp_ns(message.header))
            self.motion.add_message(topic, kind, message, stamp_ns(message.header), item.log_ns)

    def _report_undecoded(self, undecoded: Counter[str]) -> None:
        for topic, number in undecoded.items():
            text = f"{self._path}: {number} messages of {topic} do not fit their definition in the file"
            if self.types[topic] == VEHICLE_LOCAL_POSITION:  # a better position than others, but not the only one
                self._report.warning("decode", f"{text}, or have none: their positions are not used")
            else:
                self._report.problem("decode", text)

    def _map_px4_stamps(self) -> None:
        """Maps the stamps of PX4 to those of the images where its clock was not synchronised (UXRCE_DDS_SYNCT = 0)."""
        for topic, points in self.motion.px4_points().items():
            if abs(median_low(log_ns - t_ns for t_ns, log_ns in points) - self._offset_ns) <= CLOCKS_APART_NS:
                continue
            self.motion.restamp(topic, self._boot_clock(points))
            self._report.note(
                f"stamps of {topic} are of PX4's own clock: mapped to the log times by the smallest delay; set the PX4 "
                "parameter UXRCE_DDS_SYNCT to 1 for exact stamps"
            )

    def _boot_clock(self, points: Sequence[tuple[int, int]]) -> Callable[[int], int]:
        """Maps a stamp in ns to the stamps' clock of the other messages. points: stamps with their log times."""
        drift, offset_us = map_boot_clock([(t_ns // 1_000_000, log_ns // 1000) for t_ns, log_ns in points])
        return lambda t_ns: round(t_ns * (1.0 + drift) + 1000.0 * offset_us) - self._offset_ns

    def _transforms(self, topic: str, message: Any, log_ns: int) -> None:
        for transform in message.transforms:
            if not topic.endswith("tf_static"):
                self._delays_ns.append(log_ns - stamp_ns(transform.header))
                self.motion.add_moving(topic, transform, stamp_ns(transform.header), log_ns)
                continue
            placed = rigid(transform.transform.translation, transform.transform.rotation)
            if placed is not None:
                self.static_tree.add(transform.header.frame_id, transform.child_frame_id, placed)
                self.motion.tree.add(transform.header.frame_id, transform.child_frame_id, placed)

    def _clock_offset(self) -> int:
        """Offset of the log times from the stamps' clock; 0 unless they belong to another clock."""
        delays_ns = self._delays_ns or self._image_delays_ns
        if not delays_ns:
            return 0
        usual = median_low(delays_ns)
        if abs(usual) <= CLOCKS_APART_NS:
            return 0
        self._report.note(
            "log times and stamps belong to different clocks: the smallest delay between them is assumed to be zero"
        )
        return min(d for d in delays_ns if abs(d - usual) <= CLOCKS_APART_NS)
