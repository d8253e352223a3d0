"""ROS 2 recordings as people have them: PX4's messages, compressed depth, bags, missing orientation."""

from __future__ import annotations

import math
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cli import main
from core.frames import rotation_from_euler, rotation_from_quaternion
from core.types import AttitudeSample, PoseSample

from ..recordings import events_of, frames_of
from ..ros2_recording import DEFINITIONS, NS, START_NS, RosFlight, expected_depth

R_NED_FRD = rotation_from_euler(0.1, 0.2, math.pi / 2 - 0.7)


def imported(source: Path, *arguments: str) -> tuple[int, Path]:
    out = source.parent / "out.mcap"
    return main(["import", str(source), "-o", str(out), *arguments]), out


@pytest.mark.parametrize("motion", [("px4 attitude",), ("px4 odometry",), ("px4 attitude", "px4 odometry")])
def test_px4_messages_give_the_attitude(motion: tuple[str, ...], tmp_path: Path) -> None:
    status, out = imported(RosFlight(motion=motion).write(tmp_path / "in.mcap"))
    assert status == 0
    events = events_of(out)
    attitudes = [e for e in events if isinstance(e, AttitudeSample)]
    assert len(attitudes) == 100
    R = rotation_from_quaternion(attitudes[3].q_ned_frd_wxyz)
    np.testing.assert_allclose(R, R_NED_FRD, atol=1e-6)
    assert attitudes[0].t_ns == START_NS - NS // 10
    poses = [e for e in events if isinstance(e, PoseSample)]
    assert bool(poses) is ("px4 odometry" in motion)
    if poses:
        assert poses[0].position_ned_m == pytest.approx((4.0, 3.0, -5.0))
        assert poses[0].velocity_ned_m_s == pytest.approx(R_NED_FRD @ [1.0, -0.5, 0.25], abs=1e-6)


def test_the_position_of_px4_is_used_where_its_estimator_calls_it_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = RosFlight(motion=("px4 attitude", "px4 odometry", "px4 position"), px4_valid_from_s=0.5)
    status, out = imported(flight.write(tmp_path / "in.mcap"))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "position from /fmu/out/vehicle_local_position" in captured.out
    assert "30 of 100 positions of /fmu/out/vehicle_local_position are not valid" in captured.out
    poses = [e for e in events_of(out) if isinstance(e, PoseSample)]
    assert len(poses) == 70
    assert poses[0].t_ns == START_NS + NS // 2
    assert poses[0].position_ned_m == pytest.approx((4.0, 3.0, -5.0))
    assert poses[0].velocity_ned_m_s == pytest.approx((1.0, -0.5, 0.25))
    assert len({p.reset_counter for p in poses[:25]}) == 1
    assert poses[25].reset_counter != poses[24].reset_counter


def test_positions_with_a_damaged_stamp_are_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every fifth of the 95 valid ones. They were left out without a report."""
    flight = RosFlight(motion=("px4 attitude", "px4 position"))
    position = flight.px4_position

    def damaged(t_ns: int, stamp_us: int) -> Any:
        return position(t_ns, stamp_us if (t_ns - START_NS) // 1_000_000 % 100 else stamp_us + 600_000_000)

    monkeypatch.setattr(flight, "px4_position", damaged)
    status, _ = imported(flight.write(tmp_path / "in.mcap"))
    assert status == 1
    assert "19 positions have a stamp far from their log time; left out" in capsys.readouterr().err


def test_an_odometry_of_px4_alone_is_used_with_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = RosFlight(motion=("px4 odometry",), px4_odometry={"reset_counter": 7})
    status, out = imported(flight.write(tmp_path / "in.mcap"))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "record /fmu/out/vehicle_local_position" in captured.err
    assert {e.reset_counter for e in events_of(out) if isinstance(e, PoseSample)} == {7}


@pytest.mark.parametrize("frame", [0, 2])
def test_an_odometry_whose_axes_do_not_point_north_gives_no_position(
    frame: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = RosFlight(motion=("px4 odometry",), px4_odometry={"pose_frame": frame})
    status, out = imported(flight.write(tmp_path / "in.mcap"))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "100 of 100 positions of /fmu/out/vehicle_odometry are not valid, or not in ned" in captured.out
    events = events_of(out)
    assert not any(isinstance(e, PoseSample) for e in events)
    assert any(isinstance(e, AttitudeSample) for e in events)


@pytest.mark.parametrize("frame", [0, 2])
def test_a_velocity_in_an_unknown_frame_is_left_out(frame: int, tmp_path: Path) -> None:
    flight = RosFlight(motion=("px4 odometry",), px4_odometry={"velocity_frame": frame})
    _, out = imported(flight.write(tmp_path / "in.mcap"))
    assert {e.velocity_ned_m_s for e in events_of(out) if isinstance(e, PoseSample)} == {None}


def test_an_odometry_of_a_failed_estimator_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = RosFlight(motion=("px4 odometry",), px4_odometry={"quality": -1})
    status, _ = imported(flight.write(tmp_path / "in.mcap"))
    assert status == 1
    assert "no attitude in it" in capsys.readouterr().err


def test_px4_stamps_of_its_own_clock_are_mapped_to_the_images(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = RosFlight(motion=("px4 attitude", "px4 position"), px4_clock_ns=-90 * NS)
    status, out = imported(flight.write(tmp_path / "in.mcap"))
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "UXRCE_DDS_SYNCT" in captured.out
    poses = [e for e in events_of(out) if isinstance(e, PoseSample)]
    assert abs(poses[0].t_ns - START_NS) <= 5_000_000
    attitudes = [e for e in events_of(out) if isinstance(e, AttitudeSample)]
    assert abs(attitudes[10].t_ns - (START_NS + NS // 10)) <= 5_000_000  # the smallest delay, 4 ms, is taken as none


@pytest.mark.parametrize("codec", ["png", "rvl"])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_compressed_depth(encoding: str, codec: str, tmp_path: Path) -> None:
    flight = RosFlight(encoding=encoding, codec=codec, depth_topics=("/cam/depth/image/compressedDepth",), frames=2)
    flight.info_topics = ("/cam/depth/image/camera_info",)
    status, out = imported(flight.write(tmp_path / "in.mcap"))
    assert status == 0
    for number, frame in enumerate(frames_of(out)):
        wanted = expected_depth(number).astype(float)
        # 32FC1 has steps of the inverse depth: at Z metres, Z * Z millimetres for A = 1000
        tolerance = 0 if encoding == "16UC1" else 1 + (wanted / 1000) ** 2
        assert (np.abs(frame.depth_mm - wanted) <= tolerance).all()


def test_a_colour_image_is_not_taken_for_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = RosFlight(encoding="rgb8", depth_topics=("/cam/colour/compressedDepth",))
    assert imported(flight.write(tmp_path / "in.mcap"))[0] == 1
    assert "no depth image" in capsys.readouterr().err


def test_an_imu_without_orientation_is_named_with_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(RosFlight(motion=("imu without orientation",)).write(tmp_path / "in.mcap"))[0] == 1
    output = capsys.readouterr().err
    assert "100 Imu messages of /imu are marked as having no orientation" in output
    assert "imu_filter_madgwick" in output


def test_a_copy_in_text_mode_is_recognised(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = RosFlight().write(tmp_path / "in.mcap")
    source.write_bytes(source.read_bytes().replace(b"\r\n", b"\n"))
    assert source.read_bytes()[:8].hex(" ") == "89 4d 43 41 50 30 0a 01"
    for arguments in (["import", str(source), "-o", str(tmp_path / "o.mcap")], ["info", str(source)]):
        assert main(arguments) == 1
        assert "text mode" in capsys.readouterr().err


# ---- bags -----------------------------------------------------------------------------------------------------------


def write_bag(folder: Path, entries: list[Any], storage: str, definitions: bool = True) -> Path:
    """A bag of rosbags' own writer."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags is not installed (extra recordings)")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for kind, text in DEFINITIONS.items():
        if kind.startswith("px4_msgs"):
            store.register(typesys.get_types_from_msg(text, kind))
    plugin = rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbag2.StoragePlugin.SQLITE3
    with rosbag2.Writer(folder, version=9 if definitions else 8, storage_plugin=plugin) as writer:
        connections = {}
        for log_ns, topic, kind, content in entries:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            message = ros_message(store, kind, content)
            writer.write(connections[topic], log_ns, store.serialize_cdr(message, kind))
    return folder


def ros_message(store: Any, kind: str, content: Any) -> Any:
    """The message of rosbags from nested dictionaries."""
    _, fields = store.fielddefs[kind]
    values = {}
    for name, (node, described) in fields:
        value = content[name]
        if int(node) == 2:  # another message
            value = ros_message(store, described, value)
        elif int(node) in (3, 4):  # array, sequence
            (inner, what), _ = described
            if int(inner) == 2:
                value = [ros_message(store, what, v) for v in value]
            elif isinstance(value, bytes):
                value = np.frombuffer(value, np.uint8)
            else:
                value = np.array(value, what[0])
        values[name] = value
    return store.types[kind](**values)


def full(entries: list[Any]) -> list[Any]:
    """With the fields that the tests' own CameraInfo leaves out."""
    rest = {
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }
    return [
        (t, topic, kind, message | rest if kind.endswith("CameraInfo") else message)
        for t, topic, kind, message in entries
    ]


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("motion", ["odometry", "px4 attitude"])
def test_a_bag_folder(storage: str, motion: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", full(RosFlight(motion=(motion,)).entries()), storage)
    status, out = imported(bag)
    assert status == 0, capsys.readouterr().err
    frames = frames_of(out)
    assert len(frames) == 10
    assert np.array_equal(frames[3].depth_mm[1:], expected_depth(3)[1:])
    attitudes = [e for e in events_of(out) if isinstance(e, AttitudeSample)]
    np.testing.assert_allclose(rotation_from_quaternion(attitudes[3].q_ned_frd_wxyz), R_NED_FRD, atol=1e-6)


def test_a_bag_without_a_definition_of_the_position(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its fields differ between versions of PX4: it is left out, and the rest is used."""
    entries = full(RosFlight(motion=("px4 attitude", "px4 position")).entries())
    bag = write_bag(tmp_path / "bag", entries, "sqlite3", definitions=False)
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        database.execute("DELETE FROM message_definitions")
    status, out = imported(bag)
    captured = capsys.readouterr()
    assert status == 0, captured.err
    assert "100 messages of /fmu/out/vehicle_local_position do not fit their definition" in captured.err
    assert len(frames_of(out)) == 10


def test_a_db3_file_and_a_folder_without_metadata(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = write_bag(tmp_path / "bag", full(RosFlight(motion=("px4 odometry",)).entries()), "sqlite3")
    (database,) = bag.glob("*.db3")
    (alone := tmp_path / "alone.db3").write_bytes(database.read_bytes())
    status, out = imported(alone)
    assert status == 0, capsys.readouterr().err
    assert len(frames_of(out)) == 10
    (bag / "metadata.yaml").unlink()
    status, out = imported(bag, "--replace")
    assert status == 0, capsys.readouterr().err
    assert len(frames_of(out)) == 10


def _refusal(source: Path, capsys: pytest.CaptureFixture[str]) -> str:
    assert imported(source)[0] == 1
    return capsys.readouterr().err


def test_each_fault_of_a_bag_has_its_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`ros2 bag reindex` was advised for each, which repairs no database."""
    bag = write_bag(tmp_path / "bag", full(RosFlight(motion=("px4 odometry",)).entries()), "sqlite3")
    (database,) = bag.glob("*.db3")
    whole = database.read_bytes()
    (cut := tmp_path / "cut.db3").write_bytes(whole[: len(whole) // 2])
    assert "use another copy" in _refusal(cut, capsys)
    (other := tmp_path / "other.db3").write_bytes(b"12345678")
    assert "not a database of SQLite" in _refusal(other, capsys)
    (bag / "metadata.yaml").write_bytes(b"\xff\xfe")
    message = _refusal(bag, capsys)
    assert str(bag) in message
    assert "move metadata.yaml to another place" in message
    (bag / "metadata.yaml").unlink()
    assert imported(bag)[0] == 0


def test_damage_that_shows_within_a_database_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It can be opened, and an error of SQLite ended the command with a traceback."""
    bag = write_bag(tmp_path / "bag", full(RosFlight(motion=("px4 odometry",)).entries()), "sqlite3")
    (database,) = bag.glob("*.db3")
    with sqlite3.connect(
        database
    ) as connection:  # a message of many pages, each of which begins with the next one's number
        (page,) = connection.execute("PRAGMA page_size").fetchone()
        connection.execute("UPDATE messages SET data = ? WHERE id = 5", (b"z" * 4 * page,))
    damaged = bytearray(database.read_bytes())
    begin = damaged.index(b"z" * (page - 4)) // page * page
    damaged[begin : begin + 4] = b"\xff" * 4
    (alone := tmp_path / "alone.db3").write_bytes(damaged)
    assert f"{alone}: not a readable ROS 2 bag" in _refusal(alone, capsys)


@pytest.mark.parametrize("value", ["abc", 1.5])
def test_a_log_time_that_is_no_integer_is_damage(
    value: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A field of SQLite can hold any type. It ended the command with a traceback."""
    bag = write_bag(tmp_path / "bag", full(RosFlight(motion=("px4 odometry",)).entries()), "sqlite3")
    (database,) = bag.glob("*.db3")
    with sqlite3.connect(database) as connection:
        connection.execute("UPDATE messages SET timestamp = ? WHERE id = 20", (value,))
    message = _refusal(database, capsys)
    assert f"{database}: not a readable ROS 2 bag ({value!r} is no log time)" in message
    assert "it is damaged" in message


def test_a_recording_without_a_readable_message_is_called_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (path := tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    message = _refusal(path, capsys)
    assert "no message in it that can be read" in message
    assert "kept" not in message


def test_split_files_are_one_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    whole = RosFlight(frames=20, motion_until_s=3.0).write(tmp_path / "whole.mcap")
    assert imported(whole)[0] == 0
    expected = [f.t_exposure_ns for f in frames_of(tmp_path / "out.mcap")]
    RosFlight(frames=20, motion_until_s=3.0).write_parts(bag, parts=11)
    status, out = imported(bag, "--replace")
    assert status == 0, capsys.readouterr().err
    assert [f.t_exposure_ns for f in frames_of(out)] == expected  # part 10 comes after part 9


@pytest.mark.parametrize(("topic", "number"), [("/cam/depth/image", 0), ("/cam/depth/image", 2), ("/odom", 2)])
def test_messages_of_another_type_on_a_topic_are_left_out(
    topic: str, number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Images of two types ended with a traceback; two positions of PX4 replaced all of an odometry."""
    flight, folder = RosFlight(), tmp_path / "bag"
    folder.mkdir()
    flight.write(folder / "bag_1.mcap")
    t_ns = START_NS + 3 * NS // 10 + flight.latency_ns
    odd = (
        ("px4_msgs/msg/VehicleLocalPosition", flight.px4_position(t_ns, t_ns // 1000))
        if topic == "/odom"
        else ("sensor_msgs/msg/CompressedImage", flight.compressed(t_ns, 3))
    )
    flight.write_entries(folder / f"bag_{number}.mcap", [(t_ns, topic, *odd)])
    status, out = imported(folder)
    captured = capsys.readouterr()
    assert status == 1
    if number == 0:  # no image has the type of the first
        assert f"{topic}: 10 messages are sensor_msgs/Image, the first is sensor_msgs/CompressedImage" in captured.err
        return
    expected = "sensor_msgs/Image" if topic == "/cam/depth/image" else "nav_msgs/Odometry"
    assert f"{topic}: 1 message is {odd[0].replace('/msg', '')}, the first is {expected}; left out" in captured.err
    events = events_of(out)
    assert len(frames_of(out)) == 10
    assert sum(isinstance(e, PoseSample) for e in events) == 100


def test_a_bag_without_rosbags_names_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.db3").write_bytes(b"SQLite format 3\0")
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    assert imported(tmp_path / "a.db3")[0] == 1
    assert "need rosbags" in capsys.readouterr().err
