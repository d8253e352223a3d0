"""Items that the threads of the service pass to the pipeline and the recorder, besides frames and samples."""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample


@dataclass(frozen=True, slots=True)
class SupersededFrame:
    """A frame that a newer frame of its camera replaced before its use; its pixels are discarded."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class RawMavlink:
    """A MAVLink message as received."""

    data: bytes
    t_arrival_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class LogMessage:
    """A message for the log only."""

    key: str  # its key in the table of topics
    message: Message
    t_arrival_ns: int


TimedItem = AttitudeSample | PoseSample | DepthFrame | SupersededFrame | RawMavlink | LogMessage
Item = TimedItem | CameraInfo
