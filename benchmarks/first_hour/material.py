"""The recordings of the personas, made from the log of a demo: a ROS 2 bag and a TUM RGB-D folder; and a folder of depth
images with a PX4 log."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from mcap_ros2.writer import Writer

from companion.ros2.frames import camera_transform, vehicle_transforms
from core.frames import R_CAMFRD_OPTICAL, rotation_from_quaternion
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.logs.reader import McapRecording
from tests.companion.flight_logs import write_ulog
from tests.companion.recordings import write_folder
from tests.companion.ros2_recording import DEFINITIONS, header, quaternion, vector

FRAMES: Final = 60
SKIPPED: Final = 10
"""Frames at the beginning, which have few attitudes before them."""
START_NS: Final = 1_700_000_000_000_000_000
R_ENU_NED: Final = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def make(log: Path, folder: Path) -> None:
    """Writes prisms.mcap, bag.mcap, tum/ and folder/ into a folder."""
    folder.mkdir(parents=True)
    (folder / "prisms.mcap").write_bytes(log.read_bytes())
    with McapRecording(log) as source:
        info = source.cameras[0]
        events = list(source.events())
    frames = [e for e in events if isinstance(e, DepthFrame)][SKIPPED : SKIPPED + FRAMES]
    first_ns = frames[0].t_exposure_ns
    attitudes = [e for e in events if isinstance(e, AttitudeSample) and e.t_ns > first_ns - 500_000_000]
    poses = {e.t_ns: e for e in events if isinstance(e, PoseSample)}
    _bag(folder / "bag.mcap", info, frames, attitudes, poses)
    _tum(folder / "tum", info, frames, attitudes, poses)
    write_folder(folder / "folder", 60)
    write_ulog(folder / "folder" / "flight.ulg", 7.0)


def _place(t_ns: int, poses: dict[int, PoseSample]) -> tuple[float, float, float]:
    nearest = min(poses, key=lambda t: abs(t - t_ns), default=None)
    return (0.0, 0.0, -1.5) if nearest is None else poses[nearest].position_ned_m


def _bag(path: Path, info: CameraInfo, frames: list[DepthFrame], attitudes: list[AttitudeSample], poses: Any) -> None:
    """Depth, CameraInfo, odometry and /tf_static, in the frames of ROS."""
    i, m = info.intrinsics, info.mount
    shift_ns = START_NS - frames[0].t_exposure_ns
    camera = camera_transform(m, "front_optical")
    w, x, y, z = camera.q_wxyz
    entries: list[tuple[int, str, str, dict[str, Any]]] = [
        (0, "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [{
            "header": header(START_NS, camera.parent), "child_frame_id": camera.child,
            "transform": {"translation": vector(*camera.translation_m), "rotation": {"x": x, "y": y, "z": z, "w": w}},
        }]}),
    ]  # fmt: skip
    for frame in frames:
        t_ns = frame.t_exposure_ns + shift_ns
        head = header(t_ns, "front_optical")
        described = {
            "header": head,
            "height": i.height,
            "width": i.width,
            "distortion_model": "plumb_bob",
            "d": [0.0] * 5,
            "k": [i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0],
            "r": [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0],
            "p": [i.fx, 0.0, i.cx, 0.0, 0.0, i.fy, i.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
        image = {
            "header": head,
            "height": i.height,
            "width": i.width,
            "encoding": "16UC1",
            "is_bigendian": 0,
            "step": 2 * i.width,
            "data": frame.depth_mm.astype("<u2").tobytes(),
        }
        entries.append((t_ns + 30_000_000, "/camera/depth/camera_info", "sensor_msgs/msg/CameraInfo", described))
        entries.append((t_ns + 30_000_000, "/camera/depth/image_rect_raw", "sensor_msgs/msg/Image", image))
    for sample in attitudes:
        t_ns = sample.t_ns + shift_ns
        entries.append((t_ns, "/odom", "nav_msgs/msg/Odometry", _odometry(t_ns, sample, poses)))
    with path.open("wb") as stream:
        writer = Writer(stream)
        schemas = {kind: writer.register_msgdef(kind, text) for kind, text in DEFINITIONS.items()}
        for t_ns, topic, kind, message in sorted(entries, key=lambda e: e[0]):
            writer.write_message(
                topic, schemas[kind], message, log_time=t_ns or START_NS, publish_time=t_ns or START_NS
            )
        writer.finish()


def _odometry(t_ns: int, sample: AttitudeSample, poses: Any) -> dict[str, Any]:
    stabilized, base = vehicle_transforms(sample.q_ned_frd_wxyz, _place(sample.t_ns, poses))
    R = rotation_from_quaternion(stabilized.q_wxyz) @ rotation_from_quaternion(base.q_wxyz)
    return {
        "header": header(t_ns, "map"),
        "child_frame_id": "base_link",
        "pose": {
            "pose": {"position": vector(*stabilized.translation_m), "orientation": quaternion(R)},
            "covariance": [0.0] * 36,
        },
        "twist": {"twist": {"linear": vector(0, 0, 0), "angular": vector(0, 0, 0)}, "covariance": [0.0] * 36},
    }


def _tum(folder: Path, info: CameraInfo, frames: list[DepthFrame], attitudes: list[AttitudeSample], poses: Any) -> None:
    """depth.txt, groundtruth.txt (optical frame in east, north, up), intrinsics.json and the images, 5000 per metre."""
    (folder / "depth").mkdir(parents=True)
    i = info.intrinsics
    names = {"width": i.width, "height": i.height, "fx": i.fx, "fy": i.fy, "cx": i.cx, "cy": i.cy}
    (folder / "intrinsics.json").write_text(str(names).replace("'", '"'))
    lines = []
    for frame in frames:
        name = f"depth/{frame.t_exposure_ns * 1e-9:.6f}.png"
        lines.append(f"{frame.t_exposure_ns * 1e-9:.6f} {name}")
        depth = np.minimum(frame.depth_mm.astype(np.uint32) * 5, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / name), depth)
    (folder / "depth.txt").write_text("\n".join(lines) + "\n")
    truth = []
    for sample in attitudes:
        q = quaternion(R_ENU_NED @ rotation_from_quaternion(sample.q_ned_frd_wxyz) @ R_CAMFRD_OPTICAL)
        north, east, down = _place(sample.t_ns, poses)
        truth.append(f"{sample.t_ns * 1e-9:.6f} {east} {north} {-down} {q['x']} {q['y']} {q['z']} {q['w']}")
    (folder / "groundtruth.txt").write_text("\n".join(truth) + "\n")
