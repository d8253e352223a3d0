"""ROS 2 recordings written by the tests: message definitions, and a writer of a short flight."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer
from numpy.typing import NDArray

from companion.importers.ros2_frames import R_FRD_FLU, R_NED_ENU
from core.frames import rotation_from_euler

from .rvl_encoder import encode_rvl

HEADER = "std_msgs/Header header\n"
_LINE = "=" * 80 + "\nMSG: "
_HEADER = _LINE + "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_TIME = _LINE + "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_VECTOR = _LINE + "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
_POINT = _LINE + "geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
_QUATERNION = _LINE + "geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
_POSE = _LINE + "geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
_TWIST = _LINE + "geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"

DEFINITIONS = {
    "sensor_msgs/msg/Image": HEADER
    + "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"
    + _HEADER
    + _TIME,
    "sensor_msgs/msg/CameraInfo": HEADER
    + "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
    + _HEADER
    + _TIME,
    "sensor_msgs/msg/Imu": HEADER
    + "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    + "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    + "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    + _HEADER
    + _TIME
    + _QUATERNION
    + _VECTOR,
    "geometry_msgs/msg/PoseStamped": HEADER
    + "geometry_msgs/Pose pose\n"
    + _HEADER
    + _TIME
    + _POSE
    + _POINT
    + _QUATERNION,
    "nav_msgs/msg/Odometry": HEADER
    + "string child_frame_id\ngeometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n"
    + _HEADER
    + _TIME
    + _LINE
    + "geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\nfloat64[36] covariance\n"
    + _LINE
    + "geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance\n"
    + _POSE
    + _TWIST
    + _POINT
    + _VECTOR
    + _QUATERNION,
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"
    + _LINE
    + "geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    + _LINE
    + "geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    + _HEADER
    + _TIME
    + _VECTOR
    + _QUATERNION,
    "std_msgs/msg/String": "string data\n",
    "sensor_msgs/msg/CompressedImage": HEADER + "string format\nuint8[] data\n" + _HEADER + _TIME,
    "px4_msgs/msg/VehicleAttitude": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\nfloat32[4] delta_q_reset\nuint8 quat_reset_counter\n"
    ),
    "px4_msgs/msg/VehicleOdometry": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint8 POSE_FRAME_NED = 1\nuint8 pose_frame\nfloat32[3] position\n"
        "float32[4] q\nuint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity\n"
        "float32[3] position_variance\nfloat32[3] orientation_variance\nfloat32[3] velocity_variance\n"
        "uint8 reset_counter\nint8 quality\n"
    ),
    "px4_msgs/msg/VehicleLocalPosition": (
        "uint64 timestamp\nuint64 timestamp_sample\nbool xy_valid\nbool z_valid\nbool v_xy_valid\nbool v_z_valid\n"
        "float32 x\nfloat32 y\nfloat32 z\nfloat32[2] delta_xy\nuint8 xy_reset_counter\nfloat32 delta_z\n"
        "uint8 z_reset_counter\nfloat32 vx\nfloat32 vy\nfloat32 vz\n"
    ),
}

NS = 1_000_000_000
START_NS = 100 * NS
WIDTH, HEIGHT = 40, 30


def header(t_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": t_ns // NS, "nanosec": t_ns % NS}, "frame_id": frame}


def quaternion(R: NDArray[np.float64]) -> dict[str, float]:
    """Of a rotation of less than 180 degrees, by its trace."""
    w = math.sqrt(max(1e-12, 1.0 + R[0, 0] + R[1, 1] + R[2, 2])) / 2
    x, y, z = (R[2, 1] - R[1, 2]) / (4 * w), (R[0, 2] - R[2, 0]) / (4 * w), (R[1, 0] - R[0, 1]) / (4 * w)
    return {"x": float(x), "y": float(y), "z": float(z), "w": float(w)}


def vector(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": float(x), "y": float(y), "z": float(z)}


R_ENU_FLU = rotation_from_euler(0.1, -0.2, 0.7)
"""The attitude of the test's vehicle in ROS terms: rolled, pitched by -0.2 about the left axis (nose UP), 0.7 rad to the
left of east."""
POSITION_ENU = (3.0, 4.0, 5.0)
RATES_FLU = (0.01, 0.02, 0.03)


@dataclass
class RosFlight:
    """What is written: by default a second of depth at 10 Hz, odometry at 50 Hz."""

    encoding: str = "16UC1"
    codec: str = "png"
    big_endian: bool = False
    padding: int = 0
    frames: int = 10
    depth_frame: str = "cam_optical"
    motion: tuple[str, ...] = ("odometry",)
    odometry_child: str = "base_link"
    transforms: list[tuple[str, str, NDArray[np.float64], tuple[float, float, float]]] = field(default_factory=list)
    depth_topics: tuple[str, ...] = ("/cam/depth/image",)
    info_topics: tuple[str, ...] = ("/cam/depth/camera_info",)
    latency_ns: int = 30_000_000
    log_offset_ns: int = 0
    motion_until_s: float = 2.0
    plain: bool = False
    stamp_offset_ns: int = 0
    """Added to the stamps of images and of motion."""
    px4_clock_ns: int = 0
    """Added to the stamps of PX4."""
    px4_odometry: dict[str, Any] = field(default_factory=dict)
    """Fields of VehicleOdometry in place of the usual ones."""
    camera_fields: dict[str, Any] = field(default_factory=dict)
    """Fields of CameraInfo in place of the usual ones."""
    px4_valid_from_s: float = 0.0
    """The position of PX4 is valid from this time after the first image on; its counters step by 1 after 0.5 s more."""

    def entries(self) -> list[tuple[int, str, str, dict[str, Any]]]:
        """(log time, topic, type, message) in order of log time."""
        return sorted(self._entries(), key=lambda e: e[0])

    def write(self, path: Path) -> Path:
        """The recording as MCAP."""
        return self.write_entries(path, self.entries())

    def write_parts(self, folder: Path, parts: int) -> None:
        """The recording as several files, as a recorder splits it. The types have other numbers in each."""
        entries, kinds = self.entries(), ["sensor_msgs/msg/Image", "nav_msgs/msg/Odometry"]
        for i in range(parts):
            some = entries[i * len(entries) // parts : (i + 1) * len(entries) // parts]
            self.write_entries(folder / f"bag_{i}.mcap", some, kinds if i % 2 else kinds[::-1])

    def write_entries(
        self, path: Path, entries: list[tuple[int, str, str, dict[str, Any]]], first_kinds: Sequence[str] = ()
    ) -> Path:
        """These messages as MCAP. first_kinds: types that have the lowest numbers in the file."""
        with path.open("wb") as stream:
            compression = CompressionType.NONE if self.plain else CompressionType.ZSTD
            writer = Writer(stream, chunk_size=16_384, compression=compression, enable_crcs=not self.plain)
            schemas = {
                k: writer.register_msgdef(k, DEFINITIONS[k]) for k in dict.fromkeys([*first_kinds, *DEFINITIONS])
            }
            for log_ns, topic, kind, message in entries:
                stamp = log_ns + self.log_offset_ns
                writer.write_message(topic, schemas[kind], message, log_time=stamp, publish_time=stamp)
            writer.finish()
        return path

    def _entries(self) -> list[tuple[int, str, str, dict[str, Any]]]:
        entries: list[tuple[int, str, str, dict[str, Any]]] = []
        for topic in self.info_topics:
            entries.append((START_NS, topic, "sensor_msgs/msg/CameraInfo", self.camera_info()))
        if self.transforms:
            entries.append((START_NS, "/tf_static", "tf2_msgs/msg/TFMessage", self.static()))
        for i in range(self.frames):
            t_ns = START_NS + i * NS // 10
            for topic in self.depth_topics:
                stamp_ns = t_ns + self.stamp_offset_ns
                if topic.endswith("/compressedDepth"):
                    message = self.compressed(stamp_ns, i)
                    entries.append((t_ns + self.latency_ns, topic, "sensor_msgs/msg/CompressedImage", message))
                else:
                    entries.append((t_ns + self.latency_ns, topic, "sensor_msgs/msg/Image", self.image(stamp_ns, i)))
        for i in range(int(self.motion_until_s * 50)):
            t_ns = START_NS - NS // 10 + i * NS // 50
            entries += [(t_ns + 4_000_000, *self.moved(kind, t_ns + self.stamp_offset_ns)) for kind in self.motion]
        return entries

    def camera_info(self) -> dict[str, Any]:
        k = [30.0, 0.0, 19.5, 0.0, 30.0, 14.5, 0.0, 0.0, 1.0]
        return {
            "header": header(START_NS, self.depth_frame),
            "height": HEIGHT,
            "width": WIDTH,
            "distortion_model": "plumb_bob",
            "d": [0.0] * 5,
            "k": k,
            "r": [0.0] * 9,
            "p": [0.0] * 12,
        } | self.camera_fields

    def image(self, t_ns: int, number: int) -> dict[str, Any]:
        millimetres = expected_depth(number)
        order = ">" if self.big_endian else "<"
        if self.encoding == "32FC1":
            metres = millimetres.astype(np.float32) / np.float32(1000)
            metres[0, :4] = [np.nan, np.inf, -np.inf, -1.0]
            metres[0, 4] = 70.0  # more than millimetres can hold
            rows = metres.astype(f"{order}f4")
        elif self.encoding == "rgb8":
            rows = np.zeros((HEIGHT, WIDTH * 3), np.uint8)
        else:
            raw = millimetres.copy()
            raw[0, :5] = [0, 65535, 65534, 0, 0]
            rows = raw.astype(f"{order}u2")
        data = b"".join(r.tobytes() + b"\xee" * self.padding for r in rows)
        return {
            "header": header(t_ns, self.depth_frame),
            "height": HEIGHT,
            "width": WIDTH,
            "encoding": self.encoding,
            "is_bigendian": int(self.big_endian),
            "step": len(data) // HEIGHT,
            "data": data,
        }

    def compressed(self, t_ns: int, number: int) -> dict[str, Any]:
        """As image_transport's compressedDepth: 12 bytes of parameters, then a PNG or RVL."""
        a, b = 1000.0, -1.5
        raw = expected_depth(number)
        if self.encoding == "32FC1":
            with np.errstate(divide="ignore"):
                raw = np.where(raw > 0, np.rint(a / (raw / 1000.0) + b), 0).astype(np.uint16)
        if self.codec == "rvl":
            content = encode_rvl(raw)
        else:
            done, png = cv2.imencode(".png", raw)
            assert done
            content = png.tobytes()
        data = struct.pack("<iff", 0, a, b) + content
        return {
            "header": header(t_ns, self.depth_frame),
            "format": f"{self.encoding}; compressedDepth {self.codec}",
            "data": data,
        }

    def px4(self, kind: str, t_ns: int) -> tuple[str, str, dict[str, Any]]:
        """PX4's messages of the same motion, in ned and frd."""
        q = quaternion(R_NED_ENU @ R_ENU_FLU @ R_FRD_FLU)
        stamp_us = (t_ns + self.px4_clock_ns) // 1000
        message: dict[str, Any] = {
            "timestamp": stamp_us + 500,
            "timestamp_sample": stamp_us,
            "q": [q[k] for k in "wxyz"],
        }
        if kind == "px4 attitude":
            message |= {"delta_q_reset": [1.0, 0.0, 0.0, 0.0], "quat_reset_counter": 0}
            return "/fmu/out/vehicle_attitude", "px4_msgs/msg/VehicleAttitude", message
        if kind == "px4 position":
            return (
                "/fmu/out/vehicle_local_position",
                "px4_msgs/msg/VehicleLocalPosition",
                self.px4_position(t_ns, stamp_us),
            )
        rates = R_FRD_FLU @ np.array(RATES_FLU)
        message |= {
            "pose_frame": 1,
            "position": [float(v) for v in R_NED_ENU @ np.array(POSITION_ENU)],
            "velocity_frame": 3,
            "velocity": [1.0, -0.5, 0.25],
            "angular_velocity": [float(v) for v in rates],
            "reset_counter": 0,
            "quality": 0,
            **{f"{name}_variance": [0.0] * 3 for name in ("position", "orientation", "velocity")},
        } | self.px4_odometry
        return "/fmu/out/vehicle_odometry", "px4_msgs/msg/VehicleOdometry", message

    def px4_position(self, t_ns: int, stamp_us: int) -> dict[str, Any]:
        after_s = (t_ns - START_NS) / NS - self.px4_valid_from_s
        x, y, z = (float(v) for v in R_NED_ENU @ np.array(POSITION_ENU))
        return {
            "timestamp": stamp_us + 500,
            "timestamp_sample": stamp_us,
            **dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid"), after_s >= 0.0),
            "v_z_valid": True,
            **dict(zip(("x", "y", "z"), (x, y, z), strict=True)),
            **dict(zip(("vx", "vy", "vz"), (1.0, -0.5, 0.25), strict=True)),
            "delta_xy": [0.0, 0.0],
            "delta_z": 0.0,
            "xy_reset_counter": 3 + (after_s >= 0.5),
            "z_reset_counter": 9,
        }

    def moved(self, kind: str, t_ns: int) -> tuple[str, str, dict[str, Any]]:
        if kind.startswith("px4"):
            return self.px4(kind, t_ns)
        pose = {"position": vector(*POSITION_ENU), "orientation": quaternion(R_ENU_FLU)}
        if kind == "odometry":
            twist = {"linear": vector(1.0, 0.5, -0.25), "angular": vector(*RATES_FLU)}
            return (
                "/odom",
                "nav_msgs/msg/Odometry",
                {
                    "header": header(t_ns, "odom"),
                    "child_frame_id": self.odometry_child,
                    "pose": {"pose": pose, "covariance": [0.0] * 36},
                    "twist": {"twist": twist, "covariance": [0.0] * 36},
                },
            )
        if kind == "pose":
            return "/pose", "geometry_msgs/msg/PoseStamped", {"header": header(t_ns, "map"), "pose": pose}
        if kind in ("imu", "imu without orientation"):
            zeros = [0.0] * 9
            return (
                "/imu",
                "sensor_msgs/msg/Imu",
                {
                    "header": header(t_ns, "base_link"),
                    "orientation": quaternion(R_ENU_FLU) if kind == "imu" else quaternion(np.eye(3)),
                    "orientation_covariance": zeros if kind == "imu" else [-1.0, *zeros[1:]],
                    "angular_velocity": vector(*RATES_FLU),
                    "angular_velocity_covariance": zeros,
                    "linear_acceleration": vector(0, 0, 9.8),
                    "linear_acceleration_covariance": zeros,
                },
            )
        half = rotation_from_euler(0.0, 0.0, 0.7)  # map -> odom, then odom -> base_link
        rest = half.T @ R_ENU_FLU
        position = half.T @ (np.array(POSITION_ENU) - np.array([1.0, 0.0, 0.0]))
        links = [("map", "odom", half, (1.0, 0.0, 0.0)), ("odom", "base_link", rest, tuple(position))]
        return "/tf", "tf2_msgs/msg/TFMessage", {"transforms": [transform(t_ns, *link) for link in links]}

    def static(self) -> dict[str, Any]:
        return {"transforms": [transform(START_NS, *link) for link in self.transforms]}


def transform(t_ns: int, parent: str, child: str, R: NDArray[np.float64], t_m: Any) -> dict[str, Any]:
    return {
        "header": header(t_ns, parent),
        "child_frame_id": child,
        "transform": {"translation": vector(*t_m), "rotation": quaternion(R)},
    }


def expected_depth(number: int) -> NDArray[np.uint16]:
    """(HEIGHT, WIDTH) uint16, before the invalid pixels of the first row."""
    return (900 + 7 * number + np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)).astype(np.uint16)
