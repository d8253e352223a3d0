"""`companion replay` of logs from which a part was lost, as `companion recover` writes them."""

from __future__ import annotations

import fcntl
import json
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.opcode import Opcode

from companion.cli import main
from companion.log.log_file import open_locked
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.log.recover import recover
from companion.replay.replay import Options, replay
from drivers.logs.chunk_search import FRAME
from drivers.logs.codec import camera_message
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

from .test_replay import SMALL


@pytest.fixture(scope="module")
def chunked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A replayed flight of 1.5 s in several chunks."""
    folder = tmp_path_factory.mktemp("chunked")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("companion.log.log_writer.CHUNK_BYTES", 30_000)
        with LogWriter(folder / "in.mcap") as log:
            log.begin(run_info("simulated"), (SMALL,))
            for event in SimulatedFlight("demo", cameras=(SMALL,), duration_s=1.5).events():
                log.event(event)
        replay(folder / "in.mcap", Options(output=folder / "flight.mcap"))
    return folder / "flight.mcap"


def with_damaged_chunk(source: Path, path: Path, number: int) -> Path:
    """A copy with one wrong byte in the chunk of this number."""
    data, at, chunks = bytearray(source.read_bytes()), 8, []
    while at + FRAME.size < len(data) - 8:
        opcode, length = FRAME.unpack_from(data, at)
        if opcode == Opcode.CHUNK:
            chunks.append(at)
        at += FRAME.size + length
    data[chunks[number] + 100] ^= 0x10
    path.write_bytes(data)
    return path


def test_a_log_without_its_first_chunk_is_replayed_after_recovery(chunked, tmp_path, capsys):
    """The configuration and the cameras are described again at its end."""
    bad = with_damaged_chunk(chunked, tmp_path / "bad.mcap", 0)
    assert main(["replay", str(bad)]) == 1
    assert f"companion recover {bad}" in capsys.readouterr().err
    assert main(["recover", str(bad)]) == 0
    capsys.readouterr()
    with McapRecording(tmp_path / "bad.recovered.mcap") as recording, McapRecording(chunked) as original:
        assert recording.cameras == original.cameras
        assert recording.run == original.run
    assert main(["replay", "--json", str(tmp_path / "bad.recovered.mcap")]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] > 5


@pytest.mark.parametrize("number", [0, 2])
def test_the_report_names_what_a_recovered_log_lacks(chunked, tmp_path, capsys, number):
    """This explains a difference from the recorded results."""
    result = recover(with_damaged_chunk(chunked, tmp_path / "bad.mcap", number))
    main(["replay", "--check", str(result.output)])
    captured = capsys.readouterr()
    assert "recovered from a damaged file" in captured.out
    assert "results of the frames after it may differ from those in flight" in captured.out
    assert f"byte {result.damages[0].offset}: {result.damages[0].cause}" in captured.out


def test_a_log_recovered_from_a_cut_file_lacks_nothing_before_its_end(chunked, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(chunked.read_bytes()[: chunked.stat().st_size * 2 // 3])
    assert main(["replay", "--check", str(recover(cut).output)]) == 0
    assert "recovered from" not in capsys.readouterr().out


def test_a_log_recovered_from_one_with_a_damaged_summary_lacks_nothing(chunked, tmp_path, capsys):
    """All messages are before the summary."""
    data = bytearray(chunked.read_bytes())
    data[-20] ^= 1
    (tmp_path / "bad.mcap").write_bytes(data)
    assert main(["replay", "--json", str(recover(tmp_path / "bad.mcap").output)]) == 0
    assert json.loads(capsys.readouterr().out)["lost"] == []


def test_lost_descriptions_are_taken_from_another_log(chunked, tmp_path, capsys):
    """Of a log that was cut and has lost its first chunk neither copy of them is left."""
    cut, bad = tmp_path / "cut.mcap", tmp_path / "bad.mcap"
    cut.write_bytes(chunked.read_bytes()[: chunked.stat().st_size * 2 // 3])
    with_damaged_chunk(cut, bad, 0)
    assert main(["replay", str(bad)]) == 1
    assert f"companion recover {bad} --cameras-from LOG.mcap" in capsys.readouterr().err
    whole = recover(bad).output
    assert main(["replay", str(whole)]) == 1
    assert f"companion recover {whole} --cameras-from LOG.mcap" in capsys.readouterr().err
    for damaged in (bad, whole):
        out = tmp_path / f"{damaged.stem}.out.mcap"
        assert main(["recover", str(damaged), "--cameras-from", str(chunked), "-o", str(out)]) == 0
        capsys.readouterr()
        assert main(["replay", "--json", str(out)]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["frames"] > 5
        with McapRecording(out) as recording, McapRecording(chunked) as original:
            assert recording.cameras == original.cameras
            assert recording.run == original.run
            assert len(list(recording.events())) > 5
            assert len(recording.lost) == 1


def test_descriptions_that_are_there_are_never_replaced(chunked, tmp_path, capsys):
    assert main(["recover", str(chunked), "--cameras-from", str(chunked), "-o", str(tmp_path / "out.mcap")]) == 2
    assert "no description of a camera is lost" in capsys.readouterr().err
    assert not (tmp_path / "out.mcap").exists()


def test_a_log_of_other_cameras_has_no_description_to_take(chunked, tmp_path, capsys):
    other = tmp_path / "other.mcap"
    with LogWriter(other) as log:
        log.begin(run_info("simulated"), (replace(SMALL, camera="rear"),))
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(chunked.read_bytes()[: chunked.stat().st_size * 2 // 3])
    assert main(["recover", str(with_damaged_chunk(bad, bad, 0)), "--cameras-from", str(other)]) == 2
    assert f"{other}: has no /camera/front/info" in capsys.readouterr().err


@pytest.fixture
def without_cameras(chunked, tmp_path) -> Path:
    """A log that has lost the descriptions of its cameras at both ends."""
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(chunked.read_bytes()[: chunked.stat().st_size * 2 // 3])
    return with_damaged_chunk(cut, tmp_path / "bad.mcap", 0)


@pytest.mark.parametrize(
    ("other_camera", "text"),
    [
        (replace(SMALL, mount=replace(SMALL.mount, yaw_rad=SMALL.mount.yaw_rad + 0.01)), "another mount than /tf"),
        (replace(SMALL, mount=replace(SMALL.mount, x_m=SMALL.mount.x_m + 0.01)), "another mount than /tf"),
        (
            replace(SMALL, intrinsics=replace(SMALL.intrinsics, width=2 * SMALL.intrinsics.width)),
            f"and these have {SMALL.intrinsics.width}x{SMALL.intrinsics.height}",
        ),
    ],
)
def test_the_description_of_another_set_up_is_refused(without_cameras, tmp_path, capsys, other_camera, text):
    """A wrong mount or size puts obstacles and free space at a wrong place."""
    other = tmp_path / "other.mcap"
    with LogWriter(other) as log:
        log.begin(run_info("simulated"), (other_camera,))
    assert main(["recover", str(without_cameras), "--cameras-from", str(other)]) == 2
    error = capsys.readouterr().err
    assert f"{other}: /camera/front/info" in error
    assert text in error
    assert not (tmp_path / "bad.recovered.mcap").exists()


@pytest.mark.parametrize("description", [pb.CameraInfo(), camera_message(replace(SMALL, camera="rear"))])
def test_a_wrong_description_in_the_other_log_is_refused(without_cameras, tmp_path, capsys, description):
    """It is not valid, or of another camera than its topic."""
    with LogWriter(tmp_path / "other.mcap") as log:
        log.begin(run_info("simulated"), ())
        log.write("camera_info", description, 0, camera="front")
    assert main(["recover", str(without_cameras), "--cameras-from", str(tmp_path / "other.mcap")]) in (1, 2)
    assert "other.mcap: /camera/front/info" in capsys.readouterr().err
    assert not (tmp_path / "bad.recovered.mcap").exists()


def test_a_log_states_from_which_other_its_descriptions_are(without_cameras, chunked, tmp_path, capsys):
    assert main(["recover", str(without_cameras), "--cameras-from", str(chunked)]) == 0
    once = tmp_path / "bad.recovered.mcap"
    with McapRecording(once) as recording:
        times_ns = [message.t_log_ns for message in recording.messages()]
    assert times_ns[:2] == [times_ns[2]] * 2  # they do not lengthen the flight
    (tmp_path / "twice.mcap").write_bytes(once.read_bytes()[:-100])
    assert main(["recover", str(tmp_path / "twice.mcap")]) == 0
    origins = {topic: str(chunked) for topic in ("/run", "/camera/front/info")}
    for log in (once, tmp_path / "twice.recovered.mcap"):
        capsys.readouterr()
        for command in ("info", "replay"):
            main([command, str(log)])
            assert f"/run, /camera/front/info are from another log ({chunked})" in capsys.readouterr().out
            main([command, "--json", str(log)])
            assert json.loads(capsys.readouterr().out)["descriptions_from"] == origins


def test_other_logs_have_no_description_of_another(chunked, tmp_path, capsys):
    recovered = recover(with_damaged_chunk(chunked, tmp_path / "bad.mcap", 2)).output
    for log in (chunked, recovered):
        for command in ("info", "replay"):
            main([command, "--json", str(log)])
            assert json.loads(capsys.readouterr().out)["descriptions_from"] == {}


def test_the_repeated_description_is_not_another_camera(chunked, capsys):
    assert main(["info", "--json", str(chunked)]) == 0
    assert [camera["camera"] for camera in json.loads(capsys.readouterr().out)["cameras"]] == ["front"]


def test_damage_before_the_end_of_a_log_that_is_being_written_is_damage(chunked, tmp_path, capsys):
    """Not all that was written could be read."""
    path = with_damaged_chunk(chunked, tmp_path / "flight.mcap", 2)
    with path.open("rb") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        assert main(["replay", str(path)]) == 1
    error = capsys.readouterr().err
    assert "damaged at byte" in error
    assert "what it had written was read" not in error


def test_a_log_that_is_being_written_is_no_damage(chunked, tmp_path, capsys):
    """The remedy was `companion recover`, which refuses a log that is being written."""
    with open_locked(tmp_path / "flight.mcap.active", replace=False) as stream:
        stream.write(chunked.read_bytes()[: chunked.stat().st_size * 2 // 3])
        stream.flush()
        assert main(["replay", str(tmp_path / "flight.mcap.active")]) == 1
        error = capsys.readouterr().err
    assert "a process is writing it; what it had written was read" in error
    assert "recover" not in error
    assert main(["replay", str(tmp_path / "flight.mcap.active")]) == 1
    assert "companion recover" in capsys.readouterr().err
