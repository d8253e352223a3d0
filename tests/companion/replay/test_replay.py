"""`companion replay` on small flights: the same bytes, the check, errors."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from companion.cli import main
from companion.config.loader import Config, config_from_text
from companion.error_text import error_text
from companion.log.log_writer import LogWriter, schema_bytes, write_recording
from companion.log.provenance import run_info
from companion.pipeline.configured import make_pipeline
from companion.pipeline.encode import prisms_message, wire_bytes
from companion.pipeline.state import PipelineState
from companion.pipeline.state_messages import state_from_message
from companion.replay.replay import Options, replay
from companion.replay.replay_report import replay_problems, report
from companion.self_check.exposure_offset import ExposureOffset, OffsetState
from core.types import AttitudeSample, CameraInfo, DepthFrame, Intrinsics
from drivers.logs.reader import McapRecording
from drivers.logs.topics import TOPICS
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import Events, flight, write_flight

SMALL = CameraInfo("front", Intrinsics(96, 72, 67.5, 67.5, 47.5, 35.5), ke_per_m=0.0015)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def recorded(folder) -> Path:
    """A simulated flight of a second; most frames lie between attitudes."""
    events = list(SimulatedFlight("demo", cameras=(SMALL,), duration_s=1.0).events())
    exposures = {e.t_exposure_ns for e in events if isinstance(e, DepthFrame)}
    later = sorted(exposures)[1:]
    events = [e for e in events if not (isinstance(e, AttitudeSample) and e.t_ns in later)]
    path = folder / "recorded.mcap"
    write_recording(Events(events, (SMALL,)), path, run_info("simulated"))
    return path


@pytest.fixture(scope="module")
def replayed(folder, recorded) -> Path:
    path = folder / "replayed.mcap"
    assert main(["replay", str(recorded), "-o", str(path)]) == 0
    return path


def prisms_of(path: Path) -> list[pb.PrismsFrame]:
    with McapRecording(path) as recording:
        return [item.message for item in recording.messages("prisms")]


def test_a_mistake_does_not_wait_for_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for command in ("replay.command", "viewer.command"):
        monkeypatch.setattr(f"companion.{command}.ensure_compiled", lambda *modes: pytest.fail("kernels were compiled"))
    assert main(["replay", str(tmp_path / "absent.mcap")]) == 1
    assert main(["view", str(tmp_path / "absent.mcap"), "-o", str(tmp_path / "out")]) == 1


def test_a_replay_holds_everything_and_the_input(recorded, replayed):
    with McapRecording(replayed) as out, McapRecording(recorded) as source:
        keys = {item.key for item in out.messages()}
        assert keys == set(TOPICS) - {
            "mavlink",
            "clock",
            "health",
            "tracks",
            "team",
            "neighbours",
        }  # what only a live run has, or is off by default
        assert out.cameras == source.cameras
        assert json.loads(out.run.config_json)["sync"]["max_gap_s"] == 0.15
    prisms = prisms_of(replayed)
    assert len(prisms) >= 8
    assert all(p.valid and len(p.prisms) for p in prisms)
    sources = {p.attitude.source for p in prisms}
    assert sources >= {pb.AttitudeUsed.SOURCE_EXACT, pb.AttitudeUsed.SOURCE_INTERPOLATED}


def test_a_replay_of_a_replay_is_the_same_file(folder, replayed):
    again = folder / "again.mcap"
    assert main(["replay", str(replayed), "-o", str(again)]) == 0
    assert again.read_bytes() == replayed.read_bytes()


def test_another_process_writes_the_same_bytes(folder, recorded, replayed):
    """With an empty cache of compiled code too: test_end_to_end."""
    other = folder / "other.mcap"
    environment = {**os.environ, "PYTHONHASHSEED": "123"}
    script = "import sys; from companion.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", script, "replay", str(recorded), "-o", str(other)]
    subprocess.run(command, env=environment, check=True, capture_output=True, timeout=400)
    assert other.read_bytes() == replayed.read_bytes()


def test_the_check_of_a_replay_passes(replayed, capsys):
    assert main(["replay", str(replayed), "--check", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["check"]["passed"] is True
    assert report["check"]["compared"] == report["frames"] == len(prisms_of(replayed))
    assert report["check"]["missing_from_log"] == report["check"]["without_depth"] == []


def rewritten(path: Path, target: Path, change) -> Path:
    """A copy of a log in which `change(key, message)` has altered messages in place; True leaves one out."""
    with target.open("wb") as stream, McapRecording(path) as recording:
        writer = Writer(stream)
        writer.start()
        channels: dict[str, int] = {}
        for item in recording.messages():
            if change(item.key, item.message):
                continue
            topic = TOPICS[item.key]
            name = topic.of(item.camera)
            if name not in channels:
                schema = writer.register_schema(topic.schema, "protobuf", schema_bytes(topic.message))
                channels[name] = writer.register_channel(name, "protobuf", schema)
            writer.add_message(channels[name], item.t_log_ns, wire_bytes(item.message), item.t_log_ns, item.sequence)
        writer.finish()
    return target


def test_the_check_finds_one_changed_float(folder, replayed, capsys):
    frame = prisms_of(replayed)[3]

    def change(key, message):
        if key == "prisms" and message.sequence == frame.sequence:
            message.planes.corners_m[7] = float(np.nextafter(np.float32(message.planes.corners_m[7]), np.float32(99)))

    altered = rewritten(replayed, folder / "altered.mcap", change)
    assert main(["replay", str(altered), "--check"]) == 1
    captured = capsys.readouterr()
    assert "NOT equal" in captured.out
    assert f"frame {frame.sequence}, exposed at {frame.t_exposure_ns} ns: planes.corners_m[7] is" in captured.err
    assert main(["replay", str(altered), "--check", "--tolerance", "1e-4"]) == 0


def test_the_check_ignores_what_belongs_to_publication(folder, replayed):
    def change(key, message):
        if key == "prisms":
            message.publication.boot_id = "another"
            message.publication.age_ns = 12345

    assert main(["replay", str(rewritten(replayed, folder / "published.mcap", change)), "--check"]) == 0


def test_frames_missing_from_the_log_are_listed_as_not_comparable(folder, replayed, capsys):
    gone = [p.sequence for p in prisms_of(replayed)][2:4]
    holes = rewritten(replayed, folder / "holes.mcap", lambda key, m: key == "prisms" and m.sequence in gone)
    assert main(["replay", str(holes), "--check", "--json"]) == 0
    check = json.loads(capsys.readouterr().out)["check"]
    assert [entry["sequence"] for entry in check["missing_from_log"]] == gone
    assert main(["replay", str(holes), "--check"]) == 0
    assert f"2 frames not comparable, missing from the log: front {gone[0]}, front {gone[1]}" in capsys.readouterr().out


def test_a_frame_that_the_live_run_passed_over_is_passed_over_again(folder, replayed, capsys):
    """It changed no state then, so it must not now; without its prisms and depth-to-state effect all others are equal."""
    busy = prisms_of(replayed)[4].sequence
    with McapRecording(replayed) as recording:
        pipeline = make_pipeline_of(recording)
        expected = {}
        for event in recording.events():
            if getattr(event, "sequence", None) != busy:
                for output in pipeline.handle(event)[1:]:
                    expected[output.sequence] = output

    def change(key, message):
        if key == "decision" and message.sequence == busy:
            message.used, message.cause = False, pb.CAUSE_BUSY
        if key == "prisms" and message.sequence != busy:
            message.CopyFrom(prisms_message(expected[message.sequence]))
        return key == "prisms" and message.sequence == busy

    live = rewritten(replayed, folder / "busy.mcap", change)
    assert main(["replay", str(live), "--check", "--json"]) == 0
    check = json.loads(capsys.readouterr().out)["check"]
    assert check["missing_from_log"] == []
    assert check["compared"] == len(expected)


def make_pipeline_of(recording: McapRecording, state: PipelineState | None = None):
    return make_pipeline(config_from_text(recording.run.config_json), recording.cameras, state)


def test_the_check_fails_when_there_is_nothing_to_compare(recorded, folder, replayed, capsys):
    assert main(["replay", str(recorded), "--check"]) == 1
    assert "nothing to compare" in capsys.readouterr().err
    bare = folder / "bare.mcap"
    assert main(["replay", str(replayed), "-o", str(bare), "--no-depth"]) == 0
    assert bare.stat().st_size < replayed.stat().st_size
    assert main(["replay", str(bare), "--check"]) == 1
    assert "nothing to compare" in capsys.readouterr().err


@pytest.fixture(scope="module")
def tail(folder, replayed):
    """The second half of a flight with the state the first half left: (path, state)."""
    path = folder / "tail.mcap"
    with McapRecording(replayed) as recording:
        pipeline = make_pipeline_of(recording)
        events = list(recording.events())
        half = len(events) // 2
        for event in events[:half]:
            pipeline.handle(event)
        state = pipeline.state()
        with LogWriter(path) as log:
            log.begin(recording.run, recording.cameras, state, events[half].t_arrival_ns)
            left = {p.sequence: p for p in prisms_of(replayed)}
            for event in events[half:]:
                log.event(event)
                if hasattr(event, "sequence"):
                    log.write("prisms", left[event.sequence], event.t_arrival_ns, "front", event.sequence)
    return path, state


def test_a_log_that_begins_in_mid_flight_checks_exactly(replayed, tail):
    """Bit by bit the same prisms."""
    path, state = tail
    assert main(["replay", str(path), "--check"]) == 0
    result = replay(path, Options(check=True))
    assert 0 < result.comparison.compared < len(prisms_of(replayed))
    with McapRecording(path) as recording:
        assert state_from_message(recording.snapshot) == state


def test_the_snapshot_matters(folder, tail):
    """The same tail without its snapshot differs: what the test above proves is not empty."""
    without = rewritten(tail[0], folder / "no-state.mcap", lambda key, message: key == "state")
    assert main(["replay", str(without), "--check"]) == 1


def test_a_configuration_given_overrides_the_logs(folder, replayed, tmp_path):
    config = tmp_path / "level.toml"
    config.write_text("[sync]\nuse_pose = false\n[output]\nscene = false\ntransforms = false\n")
    out = folder / "level.mcap"
    assert main(["replay", str(replayed), "-c", str(config), "-o", str(out)]) == 0
    assert {p.frame for p in prisms_of(out)} == {"level"}
    with McapRecording(out) as recording:
        assert not list(recording.messages("scene", "transform"))
        assert json.loads(recording.run.config_json)["sync"]["use_pose"] is False
    assert main(["replay", str(out), "--check"]) == 0, "the configuration in the log is used from then on"


def test_a_configuration_moves_the_camera(folder, replayed, tmp_path):
    config = tmp_path / "mount.toml"
    config.write_text('[[camera]]\nname = "front"\npitch_deg = 5.0\n')
    out = folder / "mount.mcap"
    assert main(["replay", str(replayed), "-c", str(config), "-o", str(out)]) == 0
    with McapRecording(out) as recording:
        assert recording.cameras[0].mount.pitch_rad == pytest.approx(np.radians(5.0))
    assert main(["replay", str(out), "--check"]) == 0


# ---- errors -----------------------------------------------------------------------------------------------------


def test_attitude_missing_for_part_of_the_flight(tmp_path, capsys):
    events = [e for e in flight(20) if not (isinstance(e, AttitudeSample) and 5_500_000_000 < e.t_ns < 6_200_000_000)]
    path, out = write_flight(tmp_path / "gap.mcap", events), tmp_path / "out.mcap"
    assert main(["replay", str(path), "-o", str(out), "--json"]) == 1
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert report["frames"] == 20
    dropped = sum(report["dropped"].values())
    assert dropped > 4
    assert "too old to be carried forward" in captured.err
    assert "Record the autopilot's attitude at 50 Hz" in captured.err
    assert "max_gap_s" not in captured.err  # it is no remedy for an attitude that is too old, and a safety key
    prisms = prisms_of(out)
    assert len(prisms) == 20, "blind is a message, never silence"
    assert sum(not p.valid for p in prisms) >= dropped


def test_a_log_that_ends_with_an_image_holds_what_the_flight_dropped_before(tmp_path, capsys):
    """As it ends after a kill: the last image is in it, what was made of that one is not."""
    events = [e for e in flight(12) if not (isinstance(e, AttitudeSample) and e.t_ns < 5_300_000_000)]
    path, out = write_flight(tmp_path / "late.mcap", events), tmp_path / "out.mcap"
    assert main(["replay", str(path), "-o", str(out)]) == 1
    frames = [p.sequence for p in prisms_of(out)]
    assert [p.valid for p in prisms_of(out)].count(False) >= 1
    for gone, status in ((frames[-1:], 0), (frames[-3:], 0), (frames[5:6], 1)):
        cut = rewritten(
            out, tmp_path / "cut.mcap", lambda key, m, gone=gone: key in ("prisms", "decision") and m.sequence in gone
        )
        capsys.readouterr()
        assert main(["replay", str(cut), "--check"]) == status, gone
        assert "missing from the log" in capsys.readouterr().out


def test_a_cut_log_is_replayed_as_far_as_it_goes(folder, replayed, tmp_path, capsys):
    cut, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    cut.write_bytes(replayed.read_bytes()[:-50])
    assert main(["replay", str(cut), "-o", str(out)]) == 1
    assert "companion recover" in capsys.readouterr().err
    assert out.read_bytes() == replayed.read_bytes()


def test_input_and_output_must_differ(recorded, capsys):
    before = recorded.read_bytes()
    assert main(["replay", str(recorded), "-o", str(recorded)]) == 1
    assert "would overwrite this input" in capsys.readouterr().err
    assert recorded.read_bytes() == before


def test_a_foreign_log_is_a_failure_with_a_message(shared_data, capsys):
    assert main(["replay", str(shared_data / "mcap" / "keelson_ais_protobuf.mcap")]) == 1
    captured = capsys.readouterr()
    assert captured.err.startswith("companion: error: ")
    assert captured.out == ""


def test_an_output_that_cannot_be_written(recorded, tmp_path, capsys):
    assert main(["replay", str(recorded), "-o", str(tmp_path / "none" / "out.mcap")]) == 1
    assert "No such file or directory; check the path" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full, a disk without space")
def test_a_full_disk_is_reported(recorded, tmp_path, capsys):
    (tmp_path / "out.mcap.active").symlink_to("/dev/full")
    assert main(["replay", str(recorded), "-o", str(tmp_path / "out.mcap"), "--replace"]) == 1
    err = capsys.readouterr().err
    assert "No space left on device while writing" in err
    assert "kept as" not in err
    assert [p for p in tmp_path.iterdir() if p.name.startswith("out.mcap")] == []


def test_a_part_is_named_only_if_it_was_kept(tmp_path):
    """`companion recover` on a full disk leaves none, and was said to have kept FILE.active."""
    error = OSError(28, "No space left on device")
    assert error_text(error, tmp_path / "a.mcap") == (
        f"{tmp_path / 'a.mcap'}: No space left on device while writing; check the free space, "
        "or give -o a path on another disk"
    )


def test_a_failed_replay_leaves_no_output_behind(tmp_path, recorded):
    config = tmp_path / "bad.toml"
    config.write_text("[sync]\nmax_gap = 1\n")
    assert main(["replay", str(recorded), "-c", str(config), "-o", str(tmp_path / "out.mcap")]) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.toml"]


def test_a_log_without_images_is_a_failure(tmp_path, capsys):
    path = write_flight(tmp_path / "blind.mcap", [e for e in flight(3) if not hasattr(e, "depth_mm")])
    assert main(["replay", str(path)]) == 1
    assert "no depth image" in capsys.readouterr().err


def test_problems_of_an_empty_run_are_reported(recorded):
    result = replay(recorded, Options())
    assert replay_problems(result) == []
    emptied = dataclasses.replace(result.counts, frames=0)
    result.counts = emptied
    assert "no depth image" in replay_problems(result)[0]


def test_an_unfinished_log_is_never_written_over(tmp_path, recorded, capsys):
    """OUT.mcap is written as OUT.mcap.active, which here is the input."""
    active = tmp_path / "flight.mcap.active"
    active.write_bytes(recorded.read_bytes())
    assert main(["replay", str(active), "-o", str(tmp_path / "flight.mcap")]) == 1
    assert "give -o another name" in capsys.readouterr().err
    assert active.read_bytes() == recorded.read_bytes()


def test_an_output_that_is_no_log_is_left_as_it_is(tmp_path, recorded, capsys):
    config = tmp_path / "mine.toml"
    config.write_text("[sync]\n")
    assert main(["replay", str(recorded), "-o", str(config)]) == 1
    assert "exists and is not a log" in capsys.readouterr().err
    assert config.read_text() == "[sync]\n"
    assert list(tmp_path.iterdir()) == [config]


def test_a_configuration_for_another_camera_is_refused(tmp_path, recorded, capsys):
    """Its mount would go nowhere."""
    config = tmp_path / "c.toml"
    config.write_text('[[camera]]\nname = "fornt"\npitch_deg = -20\n')
    assert main(["replay", str(recorded), "-c", str(config)]) == 1
    output = capsys.readouterr().err
    assert '"fornt"' in output
    assert "its camera front has no section; correct the name" in output
    config.write_text('[[camera]]\nname = "front"\n[[camera]]\nname = "rear"\n')
    assert main(["replay", str(recorded), "-c", str(config)]) == 0


def log_of_a_newer_version(source: Path, path: Path) -> Path:
    """A copy whose configuration has a key that this version does not know."""
    with McapRecording(source) as recording:
        run = run_info("live", Config())
        run.software = "osape-companion 99.0"
        run.config_json = run.config_json.replace('"service": {', '"service": {"of_the_future": 1,')
        with LogWriter(path) as log:
            log.begin(run, recording.cameras)
            for event in recording.events():
                log.event(event)
    return path


def test_a_log_of_a_newer_version_is_replayed_with_a_configuration_of_this_one(tmp_path, recorded, capsys):
    """It was computed to the end, and then refused."""
    newer = log_of_a_newer_version(recorded, tmp_path / "newer.mcap")
    assert main(["replay", str(newer)]) == 1
    error = capsys.readouterr().err
    assert "[service] of_the_future: no such key" in error
    assert "made by osape-companion 99.0, this is osape-companion" in error
    assert "give a configuration with -c FILE" in error
    (tmp_path / "mine.toml").touch()
    output = tmp_path / "out.mcap"
    assert main(["replay", str(newer), "-c", str(tmp_path / "mine.toml"), "-o", str(output)]) == 0
    assert prisms_of(output)


def test_the_offset_to_add_is_named_where_the_configured_one_is_unknown(tmp_path, recorded):
    """The line to paste took it for 0: it would have removed the configured offset."""
    newer = log_of_a_newer_version(recorded, tmp_path / "newer.mcap")
    for log, remedy in ((recorded, "set `exposure_offset_ms = 18.3`"), (newer, "add 18.3 to exposure_offset_ms")):
        result = replay(log, Options(config=Config()))
        result.exposure_offsets = (
            ExposureOffset(camera="front", state=OffsetState.MEASURED, offset_s=0.0183, sigma_s=0.0004, pairs=90),
        )
        (offset,) = report(result, log, None, [])["exposure_offsets"]
        assert remedy in offset["warning"]
