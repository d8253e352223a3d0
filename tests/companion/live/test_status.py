"""The health report as text, and the commands that print it."""

from __future__ import annotations

import json
import os
import socket
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq

import companion.live.process_usage as process_usage
from companion.cameras.status import CameraCondition, CameraStatus
from companion.cli import main
from companion.diagnostic import Diagnostic, DiagnosticCode
from companion.doctor import service_check
from companion.live.diagnostics import diagnostics_of
from companion.live.health import AutopilotView, CameraView, state_of
from companion.live.health_stream import newest_health
from companion.live.load_text import load_text
from companion.live.status import status_lines
from companion.log.recorder import RecordStatus
from companion.paths import folders
from companion.streams.publisher import Publisher, Stream
from drivers.base import BadData
from drivers.mavlink.link import LinkState
from drivers.mavlink.session import MavlinkSession
from osape_client import run_folder as service_run
from osape_client.proto import osape_v1_pb2 as pb

pytestmark = pytest.mark.process


def report() -> pb.Health:
    h = pb.Health(
        state=pb.Health.STATE_DEGRADED, uptime_ns=65 * 10**9, frames_used=1200, cpu_share=0.08, memory_bytes=210_000_000
    )
    text = "camera right (not required) is blind: lost: the cable is out"
    h.troubles.append(text)
    h.diagnostics.append(Diagnostic(DiagnosticCode.OPTIONAL_CAMERA_UNAVAILABLE, "right", text).message())
    front = pb.CameraHealth(
        camera="front", condition="running", required=True, frames=1210, dropped=3, starts=1, hz=30.0
    )
    front.age_ns = 42_000_000
    right = pb.CameraHealth(
        camera="right", condition="lost", cause="the cable is out", starts=4, last_loss="the cable is out"
    )
    right.last_loss_age_ns = 40_000_000_000
    h.cameras.extend([front, right])
    h.autopilot.CopyFrom(
        pb.AutopilotHealth(
            address="udpin:0.0.0.0:14540", line_open=True, autopilot="PX4", system_id=1, armed=True, attitude_hz=99.0
        )
    )
    h.autopilot.clock.source = pb.ClockEstimate.SOURCE_TIMESYNC
    h.autopilot.clock.bound_ns = 310_000
    h.recording.CopyFrom(pb.RecordingHealth(recording=True, file="/var/log/x.mcap.active", bytes=12_300_000))
    h.frames_dropped["no_attitude"] = 7
    h.latencies.append(pb.Latency(stage="extract", text="extracting", p50_ms=3.1, p95_ms=4.0, p99_ms=6.2))
    return h


def test_mode_and_armed_of_an_old_heartbeat_are_dated() -> None:
    h = report()
    h.autopilot.heartbeat_age_ns = 900_000_000
    assert any(", armed, attitude" in line for line in status_lines(h))
    h.autopilot.heartbeat_age_ns = 74_000_000_000
    assert any(", armed when its last heartbeat arrived, 74 s ago, attitude" in line for line in status_lines(h))


def test_restarts_of_a_camera_are_counted_and_dated() -> None:
    h = report()
    assert not any("restarted" in line for line in status_lines(h) if line.startswith("camera front"))
    h.cameras[1].starts = 2
    assert any(line.endswith("process restarted once, last 40 s ago: the cable is out") for line in status_lines(h))
    h.cameras[1].ClearField("last_loss_age_ns")  # an older service
    assert any(line.endswith("process restarted once, last cause: the cable is out") for line in status_lines(h))


def test_address_and_camera_are_named_once() -> None:
    """The errors of drivers begin with them, as did the lines."""
    h = report()
    h.autopilot.line_open, h.autopilot.line_error = False, "udpin:0.0.0.0:14540: Address already in use"
    h.cameras[1].last_loss = "camera right: the device was lost"
    lines = status_lines(h)
    assert "autopilot: udpin:0.0.0.0:14540 is not open: Address already in use" in lines
    assert any(line.endswith("process restarted 3 times, last 40 s ago: the device was lost") for line in lines)


def test_no_fault_is_ok() -> None:
    h = report()
    h.ClearField("troubles")
    h.ClearField("diagnostics")
    h.state = pb.Health.STATE_ACTIVE
    assert status_lines(h)[:2] == ["ACTIVE, service running for 65 s", "  OK"]


def test_a_computer_with_other_work_is_named_beside_the_faults() -> None:
    """Blindness of an overloaded computer named the age of an exposure only."""
    h = report()
    h.latencies.append(pb.Latency(stage="extract_cpu", text="extracting, processor time", p50_ms=3.0))
    assert not any("computer" in line for line in status_lines(h))
    h.latencies[0].p50_ms, h.latencies[1].p50_ms = 142.6, 15.5
    assert status_lines(h)[2] == (
        "  this computer is busy: a frame took 143 ms for 16 ms of processor time (median); end other programs"
    )
    h.latencies[0].p50_ms, h.latencies[1].p50_ms = 0.3, 0.1  # frames that are dropped before they are processed
    assert not any("computer" in line for line in status_lines(h))
    h.latencies[0].p50_ms, h.latencies[1].p50_ms = 142.6, 130.0  # slow, and not busy
    assert not any("computer" in line for line in status_lines(h))


def test_a_computer_that_is_too_slow_for_its_cameras_is_named() -> None:
    """Two of three frames were superseded, and the report said OK and the times of the stages."""
    h = report()
    h.latencies.append(pb.Latency(stage="publish", text="publishing", p50_ms=0.4))
    h.latencies[0].p50_ms = 65.2
    h.frames_used = 400
    assert load_text(h) == ""  # nothing was left out yet
    h.frames_dropped["busy"] = 812
    assert load_text(h).startswith(
        "this computer is too slow: a frame takes 66 ms (median), and 30 arrive a second; 812 of 1212 were superseded"
    )
    assert "fps" in load_text(h)
    assert f"  {load_text(h)}" in status_lines(h)
    (finding,) = service_check._load_findings(h)
    assert (finding.part, finding.ok, finding.text) == ("computer", False, load_text(h))
    h.latencies[0].p50_ms = 12.0  # frames that were superseded while it started
    assert load_text(h) == ""
    assert service_check._load_findings(h) == []


def test_other_messages_on_the_address_of_the_report_are_an_error(tmp_path: Path) -> None:
    """`companion status` printed a traceback."""
    with (
        published(tmp_path, b"\xff" * 9),
        pytest.raises(BadData, match=r"9 bytes that are no health report.*-c"),
    ):
        newest_health(f"ipc://{tmp_path}/health", 30.0)


def test_a_report_as_text() -> None:
    text = "\n".join(status_lines(report()))
    for part in (
        "DEGRADED, service running for 65 s",
        "! optional_camera_unavailable: camera right (not required) is blind: lost: the cable is out",
        "camera front: running, 30.0 Hz, frame age 42 ms, 3 superseded",
        "camera right: lost, not required, 0.0 Hz, no valid frame yet",
        "process restarted 3 times, last 40 s ago: the cable is out",
        "autopilot: PX4, system 1, armed, attitude 99 Hz",
        "clock synchronised within 0.31 ms",
        "log: /var/log/x.mcap.active, 12.3 MB",
        "frames: 1200 used; dropped: 7 no_attitude (no attitude had arrived)",
        "extracting: 3.1 / 4.0 / 6.2 ms",
        "8 % of a core, 210 MB",
    ):
        assert part in text


@contextmanager
def published(folder: Path, health: pb.Health | bytes) -> Iterator[None]:
    """Publishes a report again and again, as the service does."""
    ended = threading.Event()

    def run() -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        publisher = Publisher(Stream("health", f"ipc://{folder}/health"), context)
        while not ended.wait(0.02):
            publisher.publish(health)
        publisher.close()
        context.term()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.fixture
def run_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / "run"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    return folders().run


@pytest.mark.parametrize(("state", "status"), [(pb.Health.STATE_DEGRADED, 0), (pb.Health.STATE_BLIND, 1)])
def test_the_command_exits_with_what_it_saw(
    run_folder: Path, capsys: pytest.CaptureFixture[str], state: pb.Health.State, status: int
) -> None:
    health = report()
    health.state = state
    with published(run_folder, health):
        assert main(["status", "--json", "--timeout", "60"]) == status
    found = json.loads(capsys.readouterr().out)
    assert found["frames_used"] == "1200"
    assert found["state"] == {pb.Health.STATE_DEGRADED: "degraded", pb.Health.STATE_BLIND: "blind"}[state]
    assert found["autopilot"]["clock"]["source"] == "timesync"
    assert found["frames_dropped"] == {"no_attitude": "7"}
    assert found["texts"] == {"no_attitude": "no attitude had arrived"}
    assert found["diagnostics"][0] == {
        "code": "optional_camera_unavailable",
        "camera": "right",
        "text": "camera right (not required) is blind: lost: the cable is out",
    }


def test_without_a_service_the_command_names_the_cause(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", "--timeout", "0.1"]) == 1
    assert "the service does not run" in capsys.readouterr().err


def test_keys_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["keys", str(tmp_path / "keys"), "--client", "ground"]) == 0
    out = capsys.readouterr().out
    assert "server.secret (mode 600)" in out
    assert "ground.secret (mode 600)" in out
    assert (tmp_path / "keys" / "clients" / "ground.public").exists()
    assert main(["keys", str(tmp_path / "keys"), "--client", "ground"]) == 1
    assert "there is such a client" in capsys.readouterr().err


# ---- what is wrong, and how bad it is -----------------------------------------------------------------------------


def camera(
    name: str, blind: str = "", required: bool = True, condition: CameraCondition = CameraCondition.RUNNING
) -> CameraView:
    status = CameraStatus(camera=name, condition=condition, cause="", since_ns=0)
    return CameraView(status=status, required=required, blind=blind, age_ns=None, hz=0.0)


@pytest.mark.parametrize(
    ("cameras", "state"),
    [
        ([], pb.Health.STATE_BLIND),
        ([camera("a")], pb.Health.STATE_ACTIVE),
        ([camera("a", "silent")], pb.Health.STATE_BLIND),
        ([camera("a"), camera("b", "silent")], pb.Health.STATE_BLIND),
        ([camera("a"), camera("b", "silent", required=False)], pb.Health.STATE_DEGRADED),
        ([camera("b", "silent", required=False)], pb.Health.STATE_BLIND),
    ],
)
def test_the_whole_is_blind_when_a_required_camera_is_or_all_are(cameras: list[CameraView], state: int) -> None:
    wrong = [Diagnostic(DiagnosticCode.CAMERA_UNAVAILABLE, "", v.blind) for v in cameras if v.blind]
    assert state_of(cameras, wrong, started=True) == state
    assert state_of(cameras, wrong, started=False) == pb.Health.STATE_STARTING


def test_diagnostics_name_the_worst_first() -> None:
    found = diagnostics_of(
        [camera("a", "no frame for 0.6 s", condition=CameraCondition.SILENT)],
        None,
        RecordStatus(fault="recording stopped: full"),
        "the pipeline does not respond",
    )
    assert [(d.code, d.camera, d.text) for d in found] == [
        ("thread_stalled", "", "the pipeline does not respond"),
        ("camera_unavailable", "a", "camera a is blind: no frame for 0.6 s"),
        ("no_autopilot_configured", "", "no autopilot is configured: set [autopilot] address"),
        ("recording_fault", "", "recording stopped: full"),
    ]


def test_a_camera_without_an_attitude_comes_after_the_cause_of_that() -> None:
    """It stood first, and read as a fault of the camera."""
    cameras = [
        camera("a", "no attitude had arrived"),
        camera("b", "no frame for 0.6 s", condition=CameraCondition.SILENT),
    ]
    status = MavlinkSession().status(0)
    for is_open, cause in ((False, "link_closed"), (True, "no_heartbeat")):
        link = LinkState(open=is_open, error="no such device", warning="this link is slow", alive_ns=0)
        view = AutopilotView(address="x", link_state=link, status=status, attitude_age_ns=None)
        found = diagnostics_of(cameras, view, None, "")
        places = [(d.code, d.camera) for d in found]
        assert places[:3] == [("camera_unavailable", "b"), (cause, ""), ("camera_unavailable", "a")]
        assert places[3:] == ([("link_slow", "")] if is_open else [])


def test_temperatures_are_those_of_the_sensors_that_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number, (kind, reading) in enumerate(
        {"cpu-thermal": "51234\n", "off": None, "odd": "warm\n", "npu": "-3000\n"}.items()
    ):
        zone = tmp_path / f"thermal_zone{number}"
        zone.mkdir()
        (zone / "type").write_text(f"{kind}\n")
        if reading is not None:
            (zone / "temp").write_text(reading)
    monkeypatch.setattr(process_usage, "THERMAL", tmp_path)
    report = pb.Health()
    process_usage.ProcessUsage().fill(report)
    assert [(t.sensor, t.celsius) for t in report.temperatures] == [
        ("cpu-thermal", pytest.approx(51.234)),
        ("npu", -3.0),
    ]
    assert report.memory_bytes > 10_000_000


def test_the_folders_are_those_that_systemd_gives(run_folder: Path) -> None:
    assert folders().run == run_folder
    assert os.environ["STATE_DIRECTORY"] == str(folders().state)


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A temporary folder for sockets: the name of a socket has at most 107 characters, and `tmp_path` may have 80."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def test_the_system_s_service_is_found_unless_the_user_runs_one(
    short_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Compiled kernels in the user's cache are no service."""
    for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(short_path))
    monkeypatch.setattr(service_run, "SYSTEM_RUN", short_path / "system")
    cache = short_path / ".cache" / "osape-companion"
    cache.mkdir(parents=True)
    assert service_run.run_folder() == cache / "run"
    (short_path / "system").mkdir()
    assert service_run.run_folder() == short_path / "system"
    assert folders().run == cache / "run"
    assert service_run.run_folder() == short_path / "system"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as service:
        service.bind(str(cache / "run" / "health"))
        assert service_run.run_folder() == short_path / "system"
        service.listen()
        assert service_run.run_folder() == cache / "run"
    assert (cache / "run" / "health").is_socket()  # left behind, as by a service that was killed
    assert service_run.run_folder() == short_path / "system"
