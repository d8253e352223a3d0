"""Reads what a log contains: topics with their rates and gaps, cameras, decisions, damage."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Final

from google.protobuf.message import DecodeError
from mcap.records import Metadata

from core.types import CameraInfo
from drivers.logs.codec import camera_from_message
from drivers.logs.reader import borrowed_from, lost_places, open_scan, our_channel
from drivers.logs.record_scanner import Damage, Logged
from osape_client.decode import cause_code
from osape_client.proto import osape_v1_pb2 as pb

from ..console import counted

NS: Final = 1_000_000_000
_GAP_MEDIANS: Final = 3.0
"""An interval longer than this multiple of the median is a gap."""


@dataclass(slots=True)
class TopicInfo:
    """The messages of one type on a topic."""

    topic: str
    schema: str
    key: str | None
    size: int = 0
    undecodable: int = 0  # number of messages that could not be decoded
    fault: str = ""  # of the first of these
    times_ns: list[int] = field(default_factory=list)  # of their records, in file order

    @property
    def intervals_ns(self) -> list[int]:
        """Intervals between records."""
        return [b - a for a, b in pairwise(self.times_ns)]

    @property
    def rate_hz(self) -> float | None:
        """Mean rate; None with fewer than two records or no time between them."""
        span = self.times_ns[-1] - self.times_ns[0] if self.times_ns else 0
        return (len(self.times_ns) - 1) * NS / span if span > 0 else None

    def gaps(self) -> list[tuple[int, int]]:
        """(begin, length) in ns of the gaps."""
        intervals = self.intervals_ns
        if len(intervals) < 2:
            return []
        most = _GAP_MEDIANS * max(1.0, median(intervals))
        return [(t, dt) for t, dt in zip(self.times_ns, intervals, strict=False) if dt > most]

    @property
    def steps_back(self) -> int:
        """Number of records older than their predecessor."""
        return sum(dt < 0 for dt in self.intervals_ns)


@dataclass(slots=True)
class LogInfo:
    """The content of a file."""

    path: Path
    size: int = 0
    # by the topic and the names of its type and encoding
    topics: dict[tuple[str, str, str], TopicInfo] = field(default_factory=dict)
    cameras: list[CameraInfo] = field(default_factory=list)
    run: pb.RunInfo | None = None
    decisions: Counter[str] = field(default_factory=Counter)
    valid: int = 0
    invalid: Counter[str] = field(default_factory=Counter)
    damages: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)  # places that a recovered log lacks
    borrowed: dict[str, str] = field(default_factory=dict)  # topic -> the log from which its description was taken

    @property
    def ours(self) -> bool:
        """Whether the file contains a topic of this software."""
        return any(info.key is not None for info in self.topics.values())

    @property
    def undecodable(self) -> list[str]:
        """Topics with messages that cannot be decoded, as text."""
        return [
            f"{topic.topic}: {counted(topic.undecodable, 'message')} cannot be decoded, the first: {topic.fault}"
            for topic in self.topics.values()
            if topic.undecodable
        ]

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """The first and the last timestamp."""
        times = [t for info in self.topics.values() for t in (min(info.times_ns), max(info.times_ns))]
        return (min(times), max(times)) if times else None


def read_log_info(path: Path) -> LogInfo:
    """Reads an MCAP file of any origin. Raises DriverError for another file."""
    info = LogInfo(path)
    scan = open_scan(path)
    try:
        info.size = scan.size
        for item in scan.items():
            if isinstance(item, Damage):
                info.damages.append(f"byte {item.offset}: {item.cause}")
            elif isinstance(item, Logged):
                _take(info, item)
            elif isinstance(item, Metadata):
                info.lost += lost_places(item)
                info.borrowed |= borrowed_from(item)
    finally:
        scan.close()
    return info


def _take(info: LogInfo, item: Logged) -> None:
    schema = item.schema.name if item.schema is not None else ""
    name = item.channel.topic, schema, item.channel.message_encoding
    if name not in info.topics:
        found = our_channel(item.channel, item.schema)
        info.topics[name] = TopicInfo(item.channel.topic, schema, found[0] if found else None)
    topic = info.topics[name]
    topic.times_ns.append(item.message.log_time)
    topic.size += len(item.message.data)
    try:
        _read(info, topic.key, item.message.data)
    except (DecodeError, ValueError) as error:
        topic.undecodable += 1
        topic.fault = topic.fault or str(error)


def _read(info: LogInfo, key: str | None, data: bytes) -> None:
    if key == "camera_info":
        camera = camera_from_message(pb.CameraInfo.FromString(data))
        if camera not in info.cameras:
            info.cameras.append(camera)
    elif key == "run":
        info.run = info.run or pb.RunInfo.FromString(data)
    elif key == "decision":
        decision = pb.FrameDecision.FromString(data)
        info.decisions["used" if decision.used else cause_code(decision.cause)] += 1
    elif key == "prisms":
        prisms = pb.PrismsFrame.FromString(data)
        if prisms.valid:
            info.valid += 1
        else:
            info.invalid[cause_code(prisms.cause)] += 1
