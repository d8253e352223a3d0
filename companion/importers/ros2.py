"""Reads a ROS 2 recording (MCAP, bag folder, .db3) with depth images, camera info and the vehicle's attitude.

Two passes: the first (`ros2_scan`) reads everything except the images, then topics are chosen; the second delivers the
images with the samples that had arrived. The log time is the arrival time, the header's stamp the time of measurement."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from core.types import AttitudeSample, CameraInfo, DepthFrame, Intrinsics, PoseSample
from drivers.base import BadData, Event
from drivers.logs.topics import TOPICS

from ..pipeline.sync import NS
from .flight_log import flight_log_samples
from .report import ImportOptions, Report, attitude_rate_problem, uncovered
from .ros2_depth import depth_of, encoding_of
from .ros2_files import open_ros
from .ros2_frames import DEPTH_TYPES, mount_of, rectified_camera
from .ros2_scan import RosScan, stamp_ns
from .ros2_stamps import ImageStamps

_Sample = TypeVar("_Sample", AttitudeSample, PoseSample)


class Ros2Source:
    """A ROS 2 recording (EventSource). The constructor reads it and raises BadData with the list of topics when none,
    or more than one, fits."""

    def __init__(self, path: Path, options: ImportOptions, report: Report) -> None:
        self._path, self._options, self._report = path, options, report
        self._recording = open_ros(path, report)
        self._scan = RosScan(self._recording, path, options.topics.base_frame, report)
        self._depth_topic = self._choose_depth()
        self._info = self._camera_info()
        self._attitudes, self._poses = self._samples()
        self.frame_count = self._scan.counts[self._depth_topic]
        self.files: dict[int, str] = {}

    @property
    def cameras(self) -> tuple[CameraInfo, ...]:
        """The camera."""
        return (self._info,)

    def events(self) -> Iterator[Event]:
        """All events in order of arrival."""
        items: list[AttitudeSample | PoseSample] = [*self._attitudes, *self._poses]
        waiting = sorted(items, key=lambda s: s.t_arrival_ns)
        next_sample, newest_ns, exposures = 0, 0, []
        stamps = ImageStamps(str(self._path), self._depth_topic, self._scan.recorder_behind_ns)
        for number, (log_ns, message) in enumerate(self._images()):
            t_ns = stamp_ns(message.header)
            arrived_ns = self._scan.arrival_ns(log_ns, t_ns)
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
                stamps.add(number, t_ns, log_ns)
                exposures.append(t_ns)
                yield frame
        yield from waiting[next_sample:]
        stamps.report(self._report)
        self._report_uncovered(exposures)

    def _report_uncovered(self, exposures: list[int]) -> None:
        """Reports frames without an attitude near them."""
        stamps, sync = [a.t_ns for a in self._attitudes], self._options.sync
        missing = uncovered(exposures, stamps, sync)
        if too_slow := attitude_rate_problem(exposures, stamps, sync):
            self._report.problem("attitude", f"{self._path}: {too_slow}")
        elif missing:
            begin = (missing[0] - exposures[0]) / NS
            self._report.problem(
                "attitude",
                f"{self._path}: {len(missing)} of {len(exposures)} frames have no attitude near them, the first "
                f"{begin:.2f} s after the first frame; they are kept without attitude",
            )

    def _frame(self, number: int, t_ns: int, arrival_ns: int, message: Any) -> DepthFrame | None:
        k = self._info.intrinsics
        where = f"{self._path}: {self._depth_topic} image {number}"
        try:
            depth_mm = depth_of(self._scan.types[self._depth_topic], message)
        except BadData as error:
            self._report.problem("image", f"{where}: {error}")
            return None
        height, width = depth_mm.shape
        if (width, height) != (k.width, k.height):
            self._report.problem(
                "image", f"{where}: {width}x{height} pixels, but the camera info is for {k.width}x{k.height}"
            )
            return None
        return DepthFrame(
            camera=self._info.camera, sequence=number, t_exposure_ns=t_ns, t_arrival_ns=arrival_ns, depth_mm=depth_mm
        )

    def _images(self) -> Iterator[tuple[int, Any]]:
        topic, kind = self._depth_topic, self._scan.types[self._depth_topic]
        for item in self._recording.items():
            if item.topic == topic and item.kind == kind:
                message = item.decode()
                if message is None:
                    self._report.problem("image", f"{self._path}: an image of {topic} cannot be decoded")
                else:
                    yield item.log_ns, message

    def _choose_depth(self) -> str:
        images = {t: encoding_of(self._scan.types[t], m) for t, m in self._scan.first_images.items()}
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
            raise BadData(f"{self._path}: {self._why_no_depth()}")
        return depth[0]

    def _why_no_depth(self) -> str:
        """Why no topic has depth images, and what to do."""
        if not self._scan.types:
            return "no message in it that can be read; use another copy or another recording"
        ours = any(kind in {t.schema for t in TOPICS.values()} for kind in self._scan.types.values())
        if ours and not self._scan.first_images:
            return "it is a log of this software, or contains one: replay that with `companion replay`"
        return f"no depth image in it; {self._found_text()}"

    def _found_text(self) -> str:
        expected = "expected sensor_msgs/Image or compressedDepth with 16UC1 or 32FC1"
        if self._scan.first_images:
            return f"{expected}; its images are {self._images_text()}: record the depth topic of the camera"
        kinds = sorted(set(self._scan.types.values()))
        there = ", ".join(f"{kind} ({self._topics_of(kind)})" for kind in kinds[:6])
        return f"{expected}, found {there}"

    def _images_text(self) -> str:
        images = sorted(self._scan.first_images.items())
        named = (f"{topic} ({encoding_of(self._scan.types[topic], message)})" for topic, message in images)
        return ", ".join(named)

    def _topics_of(self, kind: str) -> str:
        topics = sorted(t for t, k in self._scan.types.items() if k == kind)
        return topics[0] if len(topics) == 1 else f"{topics[0]} and {len(topics) - 1} more"

    def _camera_info(self) -> CameraInfo:
        topic = self._options.topics.camera_info or self._info_topic()
        if topic not in self._scan.infos:
            raise BadData(
                f"{self._path}: no camera info on {topic}; available: {_joined(list(self._scan.infos)) or 'none'}"
            )
        k_message, image = self._scan.infos[topic], self._scan.first_images[self._depth_topic]
        if any(abs(d) > 1e-6 for d in k_message.d):
            self._report.note(
                f"{topic} contains a lens distortion: depth images are assumed to be rectified, so that its matrix P applies"
            )
        try:
            intrinsics = Intrinsics(int(k_message.width), int(k_message.height), *rectified_camera(k_message))
            info = CameraInfo(self._options.camera.name, intrinsics)
            base, optical = self._options.topics.base_frame, image.header.frame_id
            chain = self._scan.static_tree.between(base, optical)
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
        if beside in self._scan.infos:
            return beside
        if len(self._scan.infos) == 1:
            return next(iter(self._scan.infos))
        if not self._scan.infos:
            raise BadData(
                f"{self._path}: no camera info in it; record {beside} with the images, or give the images as a directory with "
                "intrinsics.json"
            )
        raise BadData(
            f"{self._path}: no camera info beside {self._depth_topic}; available: "
            f"{_joined(list(self._scan.infos))}; choose with --info-topic"
        )

    def _samples(self) -> tuple[list[AttitudeSample], list[PoseSample]]:
        topics = self._options.topics
        if self._options.tlog is not None:
            span_ns = self._scan.span_ns(self._depth_topic)
            return flight_log_samples(self._options.tlog, span_ns, (), self._options, self._report)
        attitude = self._attitude_topic()
        pose = self._pose_topic(attitude)
        self._report.note(f"attitude from {attitude}, position from {pose or 'no topic'}")
        self._report_px4_positions(pose)
        invalid = self._scan.motion.unusable[attitude]
        if invalid:
            self._report.problem(
                "attitude",
                f"{self._path}: {invalid} attitudes of {attitude} are not rotations, or of a failed estimator; left out",
            )
        to_child = self._scan.static_tree.between
        for unconnected in self._scan.motion.unconnected_frames(attitude, to_child):
            self._report.note(
                f"no transform connects {unconnected} and {topics.base_frame}: {attitude} is assumed to be the "
                "attitude of the vehicle; otherwise record /tf_static, or choose with --base-frame"
            )
        attitudes = self._scan.motion.attitudes(attitude, to_child)
        poses = self._scan.motion.poses(pose, to_child) if pose else []
        return self._with_arrival(attitudes, "attitudes"), self._with_arrival(poses, "positions")

    def _report_px4_positions(self, pose: str | None) -> None:
        """Reports positions of PX4 that were left out, and a topic of positions without a validity flag."""
        for topic, number in self._scan.motion.invalid_positions.items():
            self._report.note(
                f"{number} of {self._scan.counts[topic]} positions of {topic} are not valid, or not in ned; left out"
            )
        if self._scan.motion.is_unconfirmed(pose):
            self._report.warning(
                "position",
                f"{self._path}: PX4 sends {pose} also while its position is not valid, as indoors without GPS: the "
                "merged world is then wrong; record /fmu/out/vehicle_local_position, which reports whether it is valid",
            )

    def _attitude_topic(self) -> str:
        """The topic with the attitude. Raises BadData with what was found."""
        wanted, there = self._options.topics.attitude, self._scan.motion.attitude_topics()
        named = ", ".join(f"{t} ({self._scan.types[t]})" for t in there)
        if wanted is not None and wanted not in there:
            raise BadData(f"{self._path}: no attitude on {wanted}; available: {named or 'none'}")
        if wanted is None and len(there) > 1:
            raise BadData(f"{self._path}: several topics with attitude: {named}; choose with --attitude-topic")
        if wanted is None and not there:
            raise BadData(f"{self._path}: no attitude in it; {self._scan.motion.hint()}")
        return wanted or there[0]

    def _pose_topic(self, attitude: str) -> str | None:
        """The topic with the position; None: there is none for this attitude. Raises BadData with what was found."""
        wanted, there = self._options.topics.pose, self._scan.motion.pose_topics()
        if wanted is not None and wanted not in there:
            raise BadData(f"{self._path}: no position on {wanted}; available: {_joined(there) or 'none'}")
        return wanted or self._scan.motion.usual_pose_topic(attitude)

    def _with_arrival(self, samples: list[_Sample], what: str) -> list[_Sample]:
        """The samples with their arrival on the stamps' clock in place of the log time; without those of implausible stamps,
        which are reported. what: their name in the report."""
        arrivals_ns = (self._scan.arrival_ns(s.t_arrival_ns, s.t_ns) for s in samples)
        kept = [replace(s, t_arrival_ns=t) for s, t in zip(samples, arrivals_ns, strict=True) if t is not None]
        if lost := len(samples) - len(kept):
            self._report.problem("stamp", f"{self._path}: {lost} {what} have a stamp far from their log time; left out")
        return kept


def _joined(topics: list[str]) -> str:
    return ", ".join(sorted(topics))
