"""ROS 2 recordings: conventions, choice of topics, damage."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cli import main
from companion.importers.report import SHOWN
from companion.importers.ros2_frames import to_ned
from core.frames import rotation_from_euler, rotation_from_quaternion
from core.types import AttitudeSample, CameraInfo, DepthFrame, PoseSample
from drivers.logs.reader import McapRecording
from tests.nightly import first, nightly

from ..recordings import events_of, frames_of
from ..ros2_recording import NS, R_ENU_FLU, RATES_FLU, START_NS, RosFlight, expected_depth, vector

R_FLU_CAMOPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Of a camera that looks forward, in ROS terms."""


def imported(flight: RosFlight, folder: Path, *arguments: str) -> tuple[int, Path]:
    source = flight.write(folder / "in.mcap")
    out = folder / "out.mcap"
    return main(["import", str(source), "-o", str(out), *arguments]), out


def camera_of(path: Path) -> CameraInfo:
    with McapRecording(path) as recording:
        return recording.cameras[0]


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
@pytest.mark.parametrize(("big_endian", "padding"), [(False, 0), (True, 6), *nightly((False, 6), (True, 0))])
def test_depth_of_every_kind(encoding: str, big_endian: bool, padding: int, tmp_path: Path) -> None:
    status, out = imported(RosFlight(encoding=encoding, big_endian=big_endian, padding=padding, frames=2), tmp_path)
    assert status == 0
    frames = frames_of(out)
    assert len(frames) == 2
    for number, frame in enumerate(frames):
        assert frame.depth_mm[0, :5].tolist() == [0, 0, 0, 0, 0]  # unmeasured, saturated, "far", infinite, beyond
        assert np.array_equal(frame.depth_mm[1:], expected_depth(number)[1:])


@pytest.mark.parametrize("kind", ["odometry", "pose", "imu", "tf"])
def test_enu_flu_becomes_ned_frd(kind: str, tmp_path: Path) -> None:
    """0.7 rad left of east is 0.87 rad right of north; nose up and right wing down keep their sign."""
    status, out = imported(RosFlight(motion=(kind,)), tmp_path)
    assert status == 0
    events = events_of(out)
    attitudes = [e for e in events if isinstance(e, AttitudeSample)]
    assert len(attitudes) == 100
    R = rotation_from_quaternion(attitudes[3].q_ned_frd_wxyz)
    assert rotation_from_euler(0.1, 0.2, math.pi / 2 - 0.7) == pytest.approx(R, abs=1e-9)
    assert attitudes[0].t_ns == START_NS - NS // 10
    assert attitudes[0].t_arrival_ns - attitudes[0].t_ns == 4_000_000
    rates = attitudes[0].rates_frd_rad_s
    assert rates == (pytest.approx((0.01, -0.02, -0.03)) if kind in ("odometry", "imu") else None)
    poses = [e for e in events if isinstance(e, PoseSample)]
    if kind == "imu":
        assert poses == []
    else:
        assert poses[0].position_ned_m == pytest.approx((4.0, 3.0, -5.0))


def test_velocity_of_odometry_is_turned_from_the_body(tmp_path: Path) -> None:
    _, out = imported(RosFlight(), tmp_path)
    pose = next(e for e in events_of(out) if isinstance(e, PoseSample))
    expected = rotation_from_euler(0.1, 0.2, math.pi / 2 - 0.7) @ np.array([1.0, -0.5, 0.25])
    assert pose.velocity_ned_m_s == pytest.approx(tuple(expected))


def test_mount_from_static_transforms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Down by 20 degrees (a positive turn about FLU's left axis), 0.2 m ahead, 0.1 m above."""
    down = rotation_from_euler(0.0, math.radians(20), 0.0)
    links = [
        ("base_link", "cam", down, (0.2, 0.0, 0.1)),
        ("cam", "cam_optical", R_FLU_CAMOPTICAL, (0.0, 0.0, 0.0)),
    ]
    status, out = imported(RosFlight(transforms=links), tmp_path)
    assert status == 0
    assert "mount from the transforms base_link -> cam_optical" in capsys.readouterr().out
    mount = camera_of(out).mount
    angles = (mount.roll_rad, mount.pitch_rad, mount.yaw_rad)
    assert angles == pytest.approx((0.0, math.radians(-20), 0.0), abs=1e-9)
    assert (mount.x_m, mount.y_m, mount.z_m) == pytest.approx((0.2, 0.0, -0.1))


IDENTITY = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
TURNED = [0.9998, 0.0, 0.02, 0.0, 1.0, 0.0, -0.02, 0.0, 0.9998]
P = [28.0, 0.0, 20.5, -1.5, 0.0, 27.0, 13.5, 0.0, 0.0, 0.0, 1.0, 0.0]
OF_K, OF_P = (30.0, 30.0, 19.5, 14.5), (28.0, 27.0, 20.5, 13.5)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"d": [0.1, -0.2, 0.0, 0.0, 0.0], "r": IDENTITY, "p": P}, OF_P),
        ({"d": [0.0] * 5, "r": TURNED, "p": P}, OF_P),
        ({"d": [0.0] * 5, "r": IDENTITY, "p": P}, OF_K),  # one image, and drivers may leave P at default values
        ({"d": [0.1, -0.2, 0.0, 0.0, 0.0], "r": IDENTITY, "p": [0.0] * 12}, OF_K),
        ({"d": [], "r": [0.0] * 9, "p": [0.0] * 12}, OF_K),
    ],
)
def test_the_intrinsics_are_those_of_the_rectified_image(
    fields: dict[str, list[float]], expected: tuple[float, ...], tmp_path: Path
) -> None:
    """CameraInfo: K is of the raw image, P of the rectified one, which depth images are."""
    status, out = imported(RosFlight(camera_fields=fields), tmp_path)
    assert status == 0
    k = camera_of(out).intrinsics
    assert (k.fx, k.fy, k.cx, k.cy) == expected


def test_without_transforms_the_mount_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(RosFlight(), tmp_path)[0] == 0
    assert "--mount" in capsys.readouterr().out
    _, out = imported(RosFlight(), tmp_path, "--replace", "--mount", "0,-15,0")
    assert "--mount" not in capsys.readouterr().out
    assert camera_of(out).mount.pitch_rad == pytest.approx(math.radians(-15))


def test_odometry_of_another_body_frame(tmp_path: Path) -> None:
    """A tracking camera mounted backwards tells its own pose; the vehicle's follows from the static transform."""
    back = rotation_from_euler(0.0, 0.0, 3.0)
    links = [("base_link", "tracker", back, (-0.5, 0.0, 0.0))]
    _, out = imported(RosFlight(transforms=links, odometry_child="tracker"), tmp_path)
    events = events_of(out)
    attitude = next(e for e in events if isinstance(e, AttitudeSample))
    R_enu_base = rotation_from_euler(0.1, -0.2, 0.7) @ back.T
    R_ned_enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    flip = np.diag([1.0, -1.0, -1.0])
    assert rotation_from_quaternion(attitude.q_ned_frd_wxyz) == pytest.approx(R_ned_enu @ R_enu_base @ flip, abs=1e-9)
    pose = next(e for e in events if isinstance(e, PoseSample))
    at_base = np.array([3.0, 4.0, 5.0]) - R_enu_base @ np.array([-0.5, 0.0, 0.0])
    assert pose.position_ned_m == pytest.approx(tuple(R_ned_enu @ at_base))


def test_everything_comes_in_order_of_arrival(tmp_path: Path) -> None:
    _, out = imported(RosFlight(), tmp_path)
    arrivals = [e.t_arrival_ns for e in events_of(out)]
    assert arrivals == sorted(arrivals)
    first = frames_of(out)[0]
    assert (first.t_exposure_ns, first.t_arrival_ns) == (START_NS, START_NS + 30_000_000)


def test_the_same_recording_gives_the_same_bytes(tmp_path: Path) -> None:
    flight = RosFlight()
    first = imported(flight, tmp_path)[1].read_bytes()
    assert imported(flight, tmp_path)[1].read_bytes() == first


def test_a_recorder_with_another_clock(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, out = imported(RosFlight(log_offset_ns=1_700_000_000 * NS), tmp_path)
    assert "different clocks" in capsys.readouterr().out
    # the least delay (of the odometry, 4 ms) counts as none
    assert frames_of(out)[0].t_arrival_ns == START_NS + 26_000_000


@pytest.mark.parametrize(
    ("flight", "option", "arguments"),
    [
        (RosFlight(depth_topics=("/a/depth", "/b/depth")), "--depth-topic", "/a/depth, /b/depth"),
        (
            RosFlight(motion=("odometry", "imu")),
            "--attitude-topic",
            "/imu (sensor_msgs/Imu), /odom (nav_msgs/Odometry)",
        ),
        (RosFlight(info_topics=("/x/camera_info", "/y/camera_info")), "--info-topic", "/x/camera_info, /y/camera_info"),
    ],
)
def test_several_candidates_are_listed(
    flight: RosFlight, option: str, arguments: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(flight, tmp_path)[0] == 1
    output = capsys.readouterr().err
    assert arguments in output
    assert option in output
    choice = arguments.split(",")[0].split(" ")[0]
    assert imported(flight, tmp_path, option, choice)[0] == 0


def test_an_imu_without_orientation_is_no_candidate(tmp_path: Path) -> None:
    assert imported(RosFlight(motion=("odometry", "imu without orientation")), tmp_path)[0] == 0


def test_transforms_give_way_to_what_they_are_made_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(RosFlight(motion=("tf", "odometry")), tmp_path)[0] == 0
    assert "attitude from /odom, position from /odom" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flight", "arguments", "expected"),
    [
        (RosFlight(encoding="rgb8"), [], "no depth image in it"),
        (RosFlight(motion=()), [], "no attitude in it; expected Odometry"),
        (RosFlight(info_topics=()), [], "no camera info in it; record /cam/depth/camera_info"),
        (RosFlight(), ["--depth-topic", "/none"], "/none is not in the recording; depth images: /cam/depth/image"),
        (RosFlight(), ["--info-topic", "/none"], "no camera info on /none; available: /cam/depth/camera_info"),
        (RosFlight(), ["--attitude-topic", "/none"], "no attitude on /none; available: /odom"),
        (RosFlight(), ["--pose-topic", "/none"], "no position on /none; available: /odom"),
        (RosFlight(motion=("tf",)), ["--base-frame", "drone"], "no attitude in it"),
    ],
)
def test_what_is_missing_is_named(
    flight: RosFlight, arguments: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out = imported(flight, tmp_path, *arguments)
    assert status == 1
    assert expected in capsys.readouterr().err
    assert not out.exists()


def test_attitude_missing_for_part_of_the_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out = imported(RosFlight(frames=20, motion_until_s=1.0), tmp_path)
    assert status == 1
    assert "10 of 20 frames have no attitude near them, the first 1.00 s after" in capsys.readouterr().err
    assert len(frames_of(out)) == 20


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_cut_recording_keeps_what_was_readable(
    share: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = RosFlight(frames=40, motion_until_s=5.0, encoding="32FC1").write(tmp_path / "in.mcap")
    whole = source.read_bytes()
    source.write_bytes(whole[: int(len(whole) * share)])
    status = main(["import", str(source), "-o", str(tmp_path / "out.mcap")])
    output = capsys.readouterr().err
    assert status == 1
    assert "the file ends there without its summary" in output
    assert "frames kept" in output
    assert len(frames_of(tmp_path / "out.mcap")) >= 1


def test_our_own_log_and_a_strange_file_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, ours = imported(RosFlight(frames=2), tmp_path)
    capsys.readouterr()
    assert main(["import", str(ours), "-o", str(tmp_path / "x.mcap")]) == 1
    assert "a log of this software, or contains one: replay that with `companion replay`" in capsys.readouterr().err
    strange = tmp_path / "strange.mcap"
    strange.write_bytes(b"not at all")
    assert main(["import", str(strange), "-o", str(tmp_path / "x.mcap")]) == 1
    assert "not an MCAP file" in capsys.readouterr().err
    assert main(["import", str(strange.rename(tmp_path / "a.db3")), "-o", str(tmp_path / "x.mcap")]) == 1
    assert "not a readable ROS 2 bag" in capsys.readouterr().err
    assert main(["import", str((tmp_path / "a.db3").rename(tmp_path / "a.bag")), "-o", str(tmp_path / "x.mcap")]) == 1
    assert "convert it first" in capsys.readouterr().err


def test_a_foreign_recording_is_refused(shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = shared_data / "mcap" / "keelson_ais_protobuf.mcap"
    assert main(["import", str(source), "-o", str(tmp_path / "x.mcap")]) == 1
    output = capsys.readouterr().err
    assert "no depth image in it" in output
    assert "keelson.primitives.TimestampedBytes" in output


def test_frames_are_kept_for_any_sequence_number(tmp_path: Path) -> None:
    _, out = imported(RosFlight(frames=15), tmp_path)
    assert [e.sequence for e in events_of(out) if isinstance(e, DepthFrame)] == list(range(15))


def test_a_recording_cut_before_its_first_image_reports_the_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = RosFlight().write(tmp_path / "in.mcap")
    source.write_bytes(source.read_bytes()[:900])
    assert main(["import", str(source), "-o", str(tmp_path / "out.mcap")]) == 1
    output = capsys.readouterr().err
    assert "no message in it that can be read" in output
    assert "the file ends there without its summary" in output


def test_each_damaged_file_is_counted_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A recording is read twice; those beyond the listed ones were counted in both passes."""
    bag = tmp_path / "bag"
    bag.mkdir()
    whole = RosFlight().write(bag / "flight_0.mcap").read_bytes()
    for number in range(1, SHOWN + 3):
        (bag / f"flight_{number}.mcap").write_bytes(whole[:900])
    assert main(["import", str(bag), "-o", str(tmp_path / "out.mcap")]) == 1
    output = capsys.readouterr().err
    assert output.count("the file ends there without its summary") == SHOWN
    assert "... and 2 more: damage" in output


def test_images_without_a_stamp_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = RosFlight(frames=5)
    stamped = flight.image
    flight.image = lambda t_ns, number: stamped(0 if number == 2 else t_ns, number)
    status, out = imported(flight, tmp_path)
    assert status == 1
    assert "image 2: its stamp, 0 ns, is far from its log time" in capsys.readouterr().err
    assert [f.sequence for f in frames_of(out)] == [0, 1, 3, 4]


@pytest.mark.parametrize("seed", first(4, range(12)))
def test_damage_of_any_kind_is_reported_and_never_raised(seed: int, tmp_path: Path) -> None:
    """Bytes changed anywhere in a recording without checksums: in definitions, in lengths, in numbers."""
    flight = RosFlight(frames=4, motion=("odometry", "tf"), motion_until_s=0.5, plain=True)
    whole = flight.write(tmp_path / "in.mcap").read_bytes()
    rng = np.random.default_rng(seed)
    for attempt in range(6):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), 3 * (attempt + 1)):
            data[at] = rng.integers(256)
        (tmp_path / "in.mcap").write_bytes(data)
        status = main(["import", str(tmp_path / "in.mcap"), "-o", str(tmp_path / "out.mcap")])
        assert status in (0, 1)
        if status == 0:
            assert frames_of(tmp_path / "out.mcap")


@pytest.mark.parametrize(("frame", "ned"), [("odom", False), ("map_ned", True), ("NED", True), ("aligned_map", False)])
def test_only_a_whole_part_of_a_frame_name_makes_it_ned(frame: str, ned: bool) -> None:
    assert np.array_equal(to_ned(frame), np.eye(3)) is ned


def test_a_body_frame_named_frd_is_used_without_a_transform(tmp_path: Path) -> None:
    """Read as flu, nose up and the yaw rate would change their sign."""
    status, out = imported(RosFlight(odometry_child="base_link_frd"), tmp_path)
    assert status == 0
    attitude = next(e for e in events_of(out) if isinstance(e, AttitudeSample))
    R_ned_enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    assert rotation_from_quaternion(attitude.q_ned_frd_wxyz) == pytest.approx(R_ned_enu @ R_ENU_FLU, abs=1e-9)
    assert attitude.rates_frd_rad_s == pytest.approx(RATES_FLU)


@pytest.mark.parametrize(("source", "output"), [("in.mcap", "in.mcap"), ("out.mcap.active", "out.mcap")])
def test_the_recording_is_never_written_over(
    source: str, output: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = RosFlight(frames=2).write(tmp_path / source)
    before = path.read_bytes()
    assert main(["import", str(path), "-o", str(tmp_path / output)]) == 1
    assert "give -o another name" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_body_that_nothing_joins_with_the_vehicle_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(RosFlight(odometry_child="t265_pose"), tmp_path)[0] == 0
    assert "no transform connects t265_pose and base_link" in capsys.readouterr().out
    assert imported(RosFlight(), tmp_path, "--replace")[0] == 0
    assert "t265" not in capsys.readouterr().out


def test_a_twist_that_was_never_filled_in_is_not_reported(tmp_path: Path) -> None:
    """Carrying an attitude by rates of zero would freeze it; the turn between two samples is better."""

    class Bare(RosFlight):
        def moved(self, kind: str, t_ns: int) -> tuple[str, str, dict[str, Any]]:
            topic, type_name, message = super().moved(kind, t_ns)
            message["twist"]["twist"] = {"linear": vector(0, 0, 0), "angular": vector(0, 0, 0)}
            return topic, type_name, message

    _, out = imported(Bare(), tmp_path)
    events = events_of(out)
    assert {e.rates_frd_rad_s for e in events if isinstance(e, AttitudeSample)} == {None}
    assert {e.velocity_ned_m_s for e in events if isinstance(e, PoseSample)} == {None}
