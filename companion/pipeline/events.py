"""What the threads of the service hand to the pipeline and the recorder, beside frames and samples."""

from __future__ import annotations

from dataclasses import dataclass

from google.protobuf.message import Message

from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample


@dataclass(frozen=True, slots=True)
class SupersededFrame:
    """A frame that a newer one replaced; its pixels are gone."""

    camera: str
    sequence: int
    t_exposure_ns: int
    t_arrival_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class RawFrame:
    """A MAVLink message as it came."""

    data: bytes
    t_arrival_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class LogMessage:
    """For the log alone: a message of the table of topics by its key."""

    key: str
    message: Message
    t_arrival_ns: int


Sample = AttitudeSample | PoseSample | DepthFrame | SupersededFrame | RawFrame | LogMessage
Item = Sample | CameraInfo
