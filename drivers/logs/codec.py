"""Encodes and decodes the messages of the hardware.

Every `..._from_message` raises ValueError with the invalid value; the caller adds file and topic."""

from __future__ import annotations

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp

from core.types import AttitudeSample, CameraInfo, CameraMount, DepthFrame, Intrinsics, PoseSample
from osape_client.proto import osape_v1_pb2 as pb

NS = 1_000_000_000
_LAST_NS = 1 << 62
"""Later timestamps (after 146 years) are damaged."""


def stamp(t_ns: int) -> Timestamp:
    """A time of the monotonic clock as a Timestamp message."""
    seconds, nanos = divmod(t_ns, NS)
    return Timestamp(seconds=seconds, nanos=nanos)


def stamp_ns(timestamp: Timestamp) -> int:
    """The time of a Timestamp message, ns."""
    return int(timestamp.seconds) * NS + int(timestamp.nanos)


def checked_stamps(t_ns: int, t_arrival_ns: int) -> tuple[int, int]:
    """Returns both. Raises ValueError for impossible times: a measurement may lie before the clock's zero (a wrong
    clock estimate), an arrival may not."""
    if not -_LAST_NS < t_ns < _LAST_NS:
        raise ValueError(f"timestamp {t_ns} ns is out of range")
    if not 0 <= t_arrival_ns < _LAST_NS:
        raise ValueError(f"arrival {t_arrival_ns} ns is out of range")
    return t_ns, t_arrival_ns


def optical_frame(camera: str) -> str:
    """The name of a camera's optical frame in a log."""
    return f"{camera}_optical"


def set_vector(message: pb.Vector3, v: tuple[float, float, float]) -> None:
    """Sets x, y, z of a message in place; a submessage passed to a constructor is encoded and decoded again."""
    message.x, message.y, message.z = v


def set_quaternion(message: pb.Quaternion, q_wxyz: tuple[float, float, float, float]) -> None:
    """Sets w, x, y, z of a message in place."""
    message.w, message.x, message.y, message.z = q_wxyz


def attitude_message(sample: AttitudeSample) -> pb.AttitudeSample:
    """Encodes an attitude sample."""
    message = pb.AttitudeSample(
        t_ns=sample.t_ns, t_arrival_ns=sample.t_arrival_ns, stamp_error_ns=sample.stamp_error_ns
    )
    set_quaternion(message.q_ned_frd, sample.q_ned_frd_wxyz)
    if sample.rates_frd_rad_s is not None:
        set_vector(message.rates_frd_rad_s, sample.rates_frd_rad_s)
    return message


def attitude_from_message(message: pb.AttitudeSample) -> AttitudeSample:
    """Decodes an attitude sample."""
    q, rates = message.q_ned_frd, message.rates_frd_rad_s
    return AttitudeSample(
        *checked_stamps(message.t_ns, message.t_arrival_ns),
        (q.w, q.x, q.y, q.z),
        (rates.x, rates.y, rates.z) if message.HasField("rates_frd_rad_s") else None,
        max(0, message.stamp_error_ns),
    )


def pose_message(sample: PoseSample) -> pb.PoseSample:
    """Encodes a position sample."""
    message = pb.PoseSample(
        t_ns=sample.t_ns,
        t_arrival_ns=sample.t_arrival_ns,
        reset_counter=sample.reset_counter,
        stamp_error_ns=sample.stamp_error_ns,
    )
    set_vector(message.position_ned_m, sample.position_ned_m)
    if sample.velocity_ned_m_s is not None:
        set_vector(message.velocity_ned_m_s, sample.velocity_ned_m_s)
    return message


def pose_from_message(message: pb.PoseSample) -> PoseSample:
    """Decodes a position sample."""
    p, v = message.position_ned_m, message.velocity_ned_m_s
    return PoseSample(
        *checked_stamps(message.t_ns, message.t_arrival_ns),
        (p.x, p.y, p.z),
        (v.x, v.y, v.z) if message.HasField("velocity_ned_m_s") else None,
        message.reset_counter,
        max(0, message.stamp_error_ns),
    )


def camera_message(info: CameraInfo) -> pb.CameraInfo:
    """Encodes a camera's description."""
    k, mount = info.intrinsics, info.mount
    return pb.CameraInfo(
        camera=info.camera,
        width_px=k.width,
        height_px=k.height,
        fx_px=k.fx,
        fy_px=k.fy,
        cx_px=k.cx,
        cy_px=k.cy,
        mount_roll_rad=mount.roll_rad,
        mount_pitch_rad=mount.pitch_rad,
        mount_yaw_rad=mount.yaw_rad,
        lever_arm_frd_m=pb.Vector3(x=mount.x_m, y=mount.y_m, z=mount.z_m),
        min_range_m=info.min_range_m,
        max_range_m=info.max_range_m,
        ke_per_m=info.ke_per_m,
        marks_smooth=info.marks_smooth,
        bias_per_m=info.bias_per_m,
    )


def camera_from_message(message: pb.CameraInfo) -> CameraInfo:
    """Decodes a camera's description."""
    arm = message.lever_arm_frd_m
    return CameraInfo(
        message.camera,
        Intrinsics(message.width_px, message.height_px, message.fx_px, message.fy_px, message.cx_px, message.cy_px),
        CameraMount(message.mount_roll_rad, message.mount_pitch_rad, message.mount_yaw_rad, arm.x, arm.y, arm.z),
        message.min_range_m,
        message.max_range_m,
        message.ke_per_m,
        message.marks_smooth,
        message.bias_per_m,
    )


def calibration_message(info: CameraInfo, t_ns: int) -> CameraCalibration:
    """The intrinsics for viewers; depth images are rectified, so there is no distortion."""
    k = info.intrinsics
    return CameraCalibration(
        timestamp=stamp(t_ns),
        frame_id=optical_frame(info.camera),
        width=k.width,
        height=k.height,
        K=[k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def depth_message(frame: DepthFrame) -> RawImage:
    """A depth image as foxglove.RawImage 16UC1, millimetres. Sequence and arrival are in the log's record."""
    height, width = frame.depth_mm.shape
    return RawImage(
        timestamp=stamp(frame.t_exposure_ns),
        frame_id=optical_frame(frame.camera),
        width=width,
        height=height,
        encoding="16UC1",
        step=2 * width,
        data=frame.depth_mm.astype("<u2", copy=False).tobytes(),
    )


def depth_parts(frame: DepthFrame) -> tuple[bytes, memoryview, bytes]:
    """The encoding of depth_message(frame) in three consecutive parts; the second, the pixels, is not copied."""
    height, width = frame.depth_mm.shape
    pixels = np.ascontiguousarray(frame.depth_mm, "<u2").reshape(-1).view(np.uint8).data
    head = RawImage(
        timestamp=stamp(frame.t_exposure_ns), width=width, height=height, encoding="16UC1", step=2 * width
    ).SerializeToString(deterministic=True)
    tail = RawImage(frame_id=optical_frame(frame.camera)).SerializeToString(deterministic=True)
    return head + _DATA_TAG + _varint(len(pixels)), pixels, tail


_DATA_TAG = bytes([RawImage.DESCRIPTOR.fields_by_name["data"].number << 3 | 2])
"""Key before RawImage.data: fields are in the order of their numbers, frame_id follows."""


def _varint(value: int) -> bytes:
    """A length as protobuf varint: seven bits per byte, lowest first."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def depth_from_message(message: RawImage, info: CameraInfo, sequence: int, t_arrival_ns: int) -> DepthFrame:
    """Decodes a depth image; rows may be padded."""
    if message.encoding not in ("16UC1", "mono16"):
        raise ValueError(f"image encoding {message.encoding!r}, expected 16UC1 (uint16 millimetres)")
    width, height, step = message.width, message.height, message.step
    k = info.intrinsics
    if (width, height) != (k.width, k.height):
        raise ValueError(f"image of {width}x{height}, but its camera info says {k.width}x{k.height}")
    data = message.data  # protobuf copies it at each access
    if step < 2 * width or step % 2 or len(data) != step * height:
        raise ValueError(f"image of {width}x{height} with rows of {step} bytes holds {len(data)} bytes")
    t_exposure_ns, t_arrival_ns = checked_stamps(stamp_ns(message.timestamp), t_arrival_ns)
    rows = np.frombuffer(data, dtype="<u2").reshape(height, step // 2)
    depth_mm = np.ascontiguousarray(rows[:, :width], dtype=np.uint16)
    return DepthFrame(
        camera=info.camera,
        sequence=sequence,
        t_exposure_ns=t_exposure_ns,
        t_arrival_ns=t_arrival_ns,
        depth_mm=depth_mm,
    )
