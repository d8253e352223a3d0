"""Encodes and decodes the results of the pipeline (osape.v1); its state: state_messages.py. Messages of the hardware:
drivers/logs/codec.py.

Every `..._from_message` raises ValueError for an inconsistent message. Encoding and decoding are lossless: arrays are
float32 on both sides."""

from __future__ import annotations

import math
from typing import Final

from google.protobuf.message import Message

from drivers.logs.codec import set_quaternion, set_vector
from osape_client.proto import osape_v1_pb2 as pb

from .causes import cause_from_number, cause_message
from .decode_model import model_from_message
from .encode_model import set_model
from .results import FrameDecision, PrismsResult
from .sync import AttitudeAt, DropCause, PoseAt, Source
from .transform import LevelTransform

SCHEMA_VERSION: Final = 1
SOURCES: Final = {
    Source.NONE: pb.AttitudeUsed.SOURCE_NONE,
    Source.EXACT: pb.AttitudeUsed.SOURCE_EXACT,
    Source.INTERPOLATED: pb.AttitudeUsed.SOURCE_INTERPOLATED,
    Source.EXTRAPOLATED: pb.AttitudeUsed.SOURCE_EXTRAPOLATED,
}


def wire_bytes(message: Message) -> bytes:
    """The encoded message; equal messages give equal bytes."""
    return message.SerializeToString(deterministic=True)


def prisms_bytes(result: PrismsResult) -> bytes:
    """The result of one frame as an encoded PrismsFrame; for a dropped frame valid is false and the cause is set."""
    model = result.model
    message = pb.PrismsFrame(
        schema_version=SCHEMA_VERSION,
        camera=result.camera,
        sequence=result.sequence,
        t_exposure_ns=result.t_exposure_ns,
        frame=result.frame,
        valid=result.valid,
        cause=cause_message(result.drop if model is None else model.cause),
        cause_text=result.cause_text,
    )
    # fields are set in place: a submessage passed to the constructor is encoded and decoded again
    if result.attitude is not None:
        _set_attitude(message.attitude, result.attitude)
    if result.pose is not None:
        _set_pose(message.pose, result.pose)
    if result.transform is not None:
        message.transform.yaw_rad = result.transform.yaw_rad
        set_vector(message.transform.translation_m, result.transform.translation_m)
    if model is not None:
        set_model(message, model)
    return wire_bytes(message)


def prisms_message(result: PrismsResult) -> pb.PrismsFrame:
    """The decoded message of `prisms_bytes`."""
    return pb.PrismsFrame.FromString(prisms_bytes(result))


def blind_message(camera: str, sequence: int, t_exposure_ns: int, cause_text: str) -> pb.PrismsFrame:
    """The invalid frame of a camera without a usable frame. t_exposure_ns: its newest exposure."""
    return pb.PrismsFrame(
        schema_version=SCHEMA_VERSION,
        camera=camera,
        sequence=sequence,
        t_exposure_ns=t_exposure_ns,
        frame="level",
        valid=False,
        cause=pb.CAUSE_CAMERA,
        cause_text=cause_text,
    )


def _set_attitude(message: pb.AttitudeUsed, attitude: AttitudeAt) -> None:
    message.source = SOURCES[attitude.source]
    set_quaternion(message.q_ned_frd, attitude.q_ned_frd_wxyz)
    message.distance_ns = attitude.distance_ns


def _set_pose(message: pb.PoseUsed, pose: PoseAt) -> None:
    message.source = SOURCES[pose.source]
    set_vector(message.position_ned_m, pose.position_ned_m)
    message.distance_ns, message.reset_counter = pose.distance_ns, pose.reset_counter


def prisms_from_message(message: pb.PrismsFrame) -> PrismsResult:
    """Decodes the result of one frame. The message has no arrival time: t_arrival_ns is 0. Raises ValueError for a
    message whose parts do not fit together."""
    if message.schema_version != SCHEMA_VERSION:
        raise ValueError(
            f"prisms of schema version {message.schema_version}; this version reads {SCHEMA_VERSION}: update the "
            "older side"
        )
    model = model_from_message(message)
    if message.valid and (model is None or not message.HasField("attitude")):
        missing = "stats" if model is None else "attitude"
        raise ValueError(f"a valid frame without {missing}; is the message damaged?")
    drop = DropCause.NONE
    if model is None:
        dropped = cause_from_number(message.cause, DropCause)
        drop = dropped if isinstance(dropped, DropCause) else DropCause.NONE
    return PrismsResult(
        camera=message.camera,
        sequence=message.sequence,
        t_exposure_ns=message.t_exposure_ns,
        t_arrival_ns=0,
        frame=message.frame,
        drop=drop,
        model=model,
        attitude=_attitude_at(message.attitude) if message.HasField("attitude") else None,
        pose=_pose_at(message.pose) if message.HasField("pose") else None,
        transform=_transform(message.transform) if message.HasField("transform") else None,
    )


def _attitude_at(message: pb.AttitudeUsed) -> AttitudeAt:
    q = message.q_ned_frd
    norm = math.hypot(q.w, q.x, q.y, q.z)
    if not abs(norm - 1.0) < 1e-3:  # also NaN
        raise ValueError(f"attitude: the norm of q_ned_frd is {norm:g}, expected 1; is the message damaged?")
    return AttitudeAt((q.w, q.x, q.y, q.z), _source(message.source), message.distance_ns)


def _source(number: int) -> Source:
    try:
        return Source(number)
    except ValueError as error:
        raise ValueError(f"source {number} of a sample is unknown: was this written by a newer version?") from error


def _pose_at(message: pb.PoseUsed) -> PoseAt:
    p = message.position_ned_m
    if not all(map(math.isfinite, (p.x, p.y, p.z))):
        raise ValueError("pose: position_ned_m is not finite; is the message damaged?")
    return PoseAt((p.x, p.y, p.z), _source(message.source), message.distance_ns, message.reset_counter)


def _transform(message: pb.LevelTransform) -> LevelTransform:
    t = message.translation_m
    if not all(map(math.isfinite, (message.yaw_rad, t.x, t.y, t.z))):
        raise ValueError("transform: a number is not finite; is the message damaged?")
    return LevelTransform(message.yaw_rad, (t.x, t.y, t.z))


def decision_message(decision: FrameDecision) -> pb.FrameDecision:
    """Encodes a decision on a frame."""
    return pb.FrameDecision(
        camera=decision.camera,
        sequence=decision.sequence,
        t_exposure_ns=decision.t_exposure_ns,
        t_arrival_ns=decision.t_arrival_ns,
        used=decision.used,
        cause=cause_message(decision.cause),
        attitude=SOURCES[decision.attitude],
        attitude_cutoff_ns=decision.attitude_cutoff_ns,
        pose=SOURCES[decision.pose],
        pose_text=decision.pose_text,
    )
