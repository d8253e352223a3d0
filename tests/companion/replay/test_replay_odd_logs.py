"""`companion replay` of logs whose state, stamps, images or positions are beyond what a flight has."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from companion.cli import main
from companion.log.log_writer import LogWriter, write_recording
from companion.log.provenance import run_info
from core.types import AttitudeSample, DepthFrame, PoseSample
from drivers.logs.codec import attitude_message, camera_message, depth_message
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import Events
from .test_replay import SMALL, prisms_of


def test_a_state_that_cannot_be_used_is_reported_with_the_file(tmp_path, capsys):
    path = tmp_path / "odd.mcap"
    sample = pb.AttitudeSample(t_ns=1, t_arrival_ns=1, q_ned_frd=pb.Quaternion(w=3.0))
    with LogWriter(path) as log:
        log.write("camera_info", camera_message(SMALL), 0, camera="front")
        log.write("state", pb.StateSnapshot(attitudes=[sample]), 0)
        for event in SimulatedFlight("demo", cameras=(SMALL,), duration_s=0.2).events():
            log.event(event)
    assert main(["replay", str(path)]) == 1
    output = capsys.readouterr().err
    assert "odd.mcap: /state: attitude at 1 ns: quaternion norm 3" in output
    assert "Use another copy" in output


@pytest.mark.parametrize("odd", ["stamp of an image", "arrival of an attitude", "arrival of an image"])
def test_a_stamp_beyond_every_clock_costs_its_own_message_only(odd, tmp_path, capsys):
    path, out = tmp_path / "odd.mcap", tmp_path / "out.mcap"
    number = 0
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (SMALL,))
        for event in SimulatedFlight("demo", cameras=(SMALL,), duration_s=0.5).events():
            message = depth_message(event) if isinstance(event, DepthFrame) else None
            number += message is not None
            if message is not None and number == 2 and odd == "stamp of an image":
                message.timestamp.seconds = 1 << 62
                log.write("depth", message, event.t_arrival_ns, "front", 1)
            elif message is not None and number == 2 and odd == "arrival of an image":
                log.write("depth", message, (1 << 62) + 1, "front", 1)
            elif number == 2 and isinstance(event, AttitudeSample) and odd == "arrival of an attitude":
                number += 100
                late = attitude_message(event)
                late.t_arrival_ns = -5
                log.write("attitude", late, event.t_arrival_ns)
            else:
                log.event(event)
    assert main(["replay", str(path), "-o", str(out)]) == 1
    assert "1 messages are invalid and were left out" in capsys.readouterr().err
    assert len(prisms_of(out)) == (6 if odd == "arrival of an attitude" else 5)


def test_an_image_of_another_size_in_a_log_is_published_as_blind(tmp_path, capsys):
    path, out = tmp_path / "odd.mcap", tmp_path / "out.mcap"
    number = 0
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (SMALL,))
        for event in SimulatedFlight("demo", cameras=(SMALL,), duration_s=0.5).events():
            if isinstance(event, DepthFrame):
                number += 1
                if number == 2:
                    event = dataclasses.replace(event, depth_mm=np.full((20, 30), 5000, np.uint16))
            log.event(event)
    assert main(["replay", str(path), "-o", str(out)]) == 1
    assert "an image among them is blind" in capsys.readouterr().err
    valid = [message.valid for message in prisms_of(out)]
    assert valid == [True, False] + [True] * (len(valid) - 2)
    assert len(valid) == number


def test_a_position_beyond_float32_publishes_in_level(tmp_path):
    """In ned a wall there would be of infinite numbers, and valid."""
    path, out = tmp_path / "far.mcap", tmp_path / "out.mcap"
    events = [
        dataclasses.replace(e, position_ned_m=(1e39, 0.0, 0.0)) if isinstance(e, PoseSample) else e
        for e in SimulatedFlight("demo", cameras=(SMALL,), duration_s=0.2).events()
    ]
    write_recording(Events(events, (SMALL,)), path, run_info("simulated"))
    assert main(["replay", str(path), "-o", str(out)]) == 0
    prisms = prisms_of(out)
    assert {p.frame for p in prisms} == {"level"}
    assert all(np.isfinite(p.planes.corners_m).all() for p in prisms)


def test_a_frame_that_comes_twice_is_not_called_blind(tmp_path, capsys):
    events = list(SimulatedFlight("demo", cameras=(SMALL,), duration_s=0.2).events())
    twice = next(i for i, e in enumerate(events) if isinstance(e, DepthFrame))
    path = tmp_path / "twice.mcap"
    write_recording(Events([*events[: twice + 1], *events[twice:]], (SMALL,)), path, run_info("simulated"))
    assert main(["replay", str(path)]) == 1
    output = capsys.readouterr().err
    assert "1 of 4 frames were dropped and 0 of them are published as blind" in output
    assert "check the camera's timestamps" in output
    assert "attitude" not in output


def test_a_mask_outside_of_the_image_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As one that was drawn in a larger image: the service and the doctor named it, a replay did not."""
    log = Path(__file__).parents[2] / "data" / "window.mcap"
    with McapRecording(log) as recording:
        (info,) = recording.cameras
    (config := tmp_path / "masked.toml").write_text(
        f'[[camera]]\nname = "{info.camera}"\nkind = "mcap"\nmasks = "9000,0 9900,60"\n'
    )
    assert main(["replay", str(log), "-c", str(config)]) == 0
    assert f"companion: warning: camera {info.camera}: masks: no pixel of the image" in capsys.readouterr().err
    assert main(["replay", str(log)]) == 0
    assert "masks" not in capsys.readouterr().err
