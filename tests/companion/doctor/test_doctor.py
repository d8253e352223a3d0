"""`companion doctor`: each part is tried as the service would use it, and what is wrong comes with its remedy."""

from __future__ import annotations

import json
import os
import socket
import threading
from collections.abc import Iterator
from itertools import chain, repeat
from pathlib import Path

import pytest
import zmq

from companion.cli import main
from companion.doctor import autopilot_check, computer_check, service_check
from companion.doctor.doctor import print_findings
from companion.doctor.finding import Finding
from companion.live.health_stream import address_in_use
from companion.streams.publisher import Publisher, Stream
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, PtyEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port
from tests.waiting import PATIENCE_S

from ..live_service import Live, flown

pytestmark = pytest.mark.process

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 10.0
device = "{cable}"

[autopilot]
address = "udpin:127.0.0.1:{port}"
attitude_hz = 20.0

[avoid]
send = true
"""


@pytest.fixture
def live(tmp_path: Path, renders: Path, monkeypatch: pytest.MonkeyPatch) -> Live:
    live = Live(tmp_path, CONFIG, renders)
    for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY", "CACHE_DIRECTORY"):
        monkeypatch.setenv(name, live.environment[name])
    return live


@pytest.fixture(params=[PX4, ARDUPILOT])
def line(live: Live, request: pytest.FixtureRequest) -> Iterator[AutopilotLink]:
    with flown(live, request.param) as line:
        line.change(lambda a: a.parameters.update(PARAMETERS[request.param]))
        yield line


def examined(live: Live, capsys: pytest.CaptureFixture[str], patience: str = "60") -> tuple[int, dict[str, dict]]:
    """(status, part -> its first fault, with the texts of all its faults; without a fault its first finding)."""
    status = main(["doctor", "-c", str(live.config), "--json", "--patience", patience])
    findings = json.loads(capsys.readouterr().out)
    assert findings["ok"] == (status == 0)
    assert [f for f in findings["findings"] if f["ok"] and f["code"]] == []
    parts: dict[str, dict] = {}
    for finding in sorted(findings["findings"], key=lambda f: f["ok"]):
        known = parts.setdefault(finding["part"], finding)
        if known is not finding and not finding["ok"]:
            known["text"] += "; " + finding["text"]
    return status, parts


def test_no_fault_is_found(live: Live, line: AutopilotLink, capsys: pytest.CaptureFixture[str]) -> None:
    status, findings = examined(live, capsys)
    assert status == 0, findings
    assert findings["camera front"]["text"].startswith("160x120, ")
    assert line.autopilot.profile.kind in findings["autopilot"]["text"]
    parts = {
        "safety keys",
        "expert keys",
        "service",
        "camera front",
        "autopilot",
        "attitude",
        "clock",
        "firmware",
        "parameters",
        "to check by hand",
        "log",
        "kernels",
    }
    assert set(findings) == parts
    assert "_OPTION" not in findings["parameters"]["text"], "switches without a function are not listed"
    hidden = "MAV_x_FORWARD" if line.autopilot.profile.kind == PX4 else "MAV_CMD_DO_AUX_FUNCTION with function 40"
    assert hidden in findings["to check by hand"]["text"]
    assert line.change(lambda a: a.of_kind("PARAM_SET")) == []


def test_without_obstacle_output_missing_parameters_are_no_fault(
    live: Live, capsys: pytest.CaptureFixture[str]
) -> None:
    """As with `companion simulate-autopilot`, which answers no request for a parameter."""
    live.config.write_text(live.config.read_text().replace("send = true", "send = false"))
    with flown(live, PX4) as line:
        line.change(lambda a: a.parameters.clear())
        status, findings = examined(live, capsys)
    assert "CP_DIST" in findings["parameters"]["text"] or "no parameter" in findings["parameters"]["text"]
    assert status == 0, findings


@pytest.fixture
def without_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rates, which are measured for three seconds, are no subject."""
    monkeypatch.setattr(autopilot_check, "RATE_WINDOW_NS", 0)


@pytest.mark.usefixtures("without_rates")
def test_what_keeps_it_from_braking_is_reported(
    live: Live, line: AutopilotLink, capsys: pytest.CaptureFixture[str]
) -> None:
    px4 = line.autopilot.profile.kind == PX4
    bad = {"CP_DIST": -1.0} if px4 else {"PRX1_TYPE": 0}
    heading = {"MPC_YAW_MODE": 1, "RTL_HDG_MD": 0} if px4 else {"FLTMODE_GCSBLOCK": 1 << 12, "WP_YAW_BEHAVIOR": 0}
    line.change(lambda a: a.parameters.update(bad | heading))
    live.config.write_text(live.config.read_text() + "[guard]\nenabled = true\n")
    status, findings = examined(live, capsys)
    assert status == 1
    assert next(iter(bad)) in findings["parameters"]["text"]
    assert next(iter(heading)) in findings["guard"]["text"]
    assert "set it to" in findings["guard"]["text"]


def test_a_camera_that_is_not_there_is_named(live: Live, capsys: pytest.CaptureFixture[str]) -> None:
    live.cable.unlink()
    live.config.write_text(live.config.read_text().split("[autopilot]")[0])
    status, findings = examined(live, capsys, "60")
    assert status == 1
    assert "unplugged" in findings["camera front"]["text"]
    assert "set [autopilot] address" in findings["autopilot"]["text"]
    assert findings["kernels"]["text"].startswith("compiled; loaded in")
    assert findings["log"]["ok"]


def test_an_autopilot_that_is_not_there_is_named(live: Live, capsys: pytest.CaptureFixture[str]) -> None:
    live.config.write_text("[autopilot]" + live.config.read_text().split("[autopilot]")[1])
    status, findings = examined(live, capsys, "1")
    assert status == 1
    assert (
        f"no heartbeat on udpin:127.0.0.1:{live.port}: check that the autopilot is on" in findings["autopilot"]["text"]
    )


def test_a_line_that_cannot_be_had_and_a_folder_that_cannot_be_written(
    live: Live, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    live.config.write_text(
        f'[autopilot]\naddress = "serial:/dev/serial/by-id/none-{free_port()}:921600"\n[record]\nfolder = "/logs"\n'
    )
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    status, findings = examined(live, capsys, "1")
    assert status == 1
    assert "the link is not open" in findings["autopilot"]["text"]
    assert "[record] folder" in findings["log"]["text"]
    assert "[[camera]]" in findings["cameras"]["text"]


def test_a_full_disk_is_reported(
    live: Live, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    live.config.write_text("[record]\nleast_free_mb = 100000\n")
    monkeypatch.setattr(computer_check, "free_bytes", lambda folder: 5_000_000)
    assert "5 MB free" in examined(live, capsys, "1")[1]["log"]["text"]


def test_a_running_service_is_asked(live: Live, capsys: pytest.CaptureFixture[str]) -> None:
    """The running service reports a missing autopilot after its start; the doctor opens neither its camera nor its link."""
    try:
        health = live.subscribe("health", pb.Health)
        live.start()
        health.wait(lambda h: True, PATIENCE_S)
        status, findings = examined(live, capsys, str(PATIENCE_S))
        assert status == 1
        assert "no heartbeat of an autopilot" in findings["service"]["text"]
        assert set(findings) == {"safety keys", "expert keys", "service", "log", "kernels"}
        assert live.stop() == 0
    finally:
        live.close()


def test_a_service_that_is_there_and_reports_nothing_keeps_its_cameras(
    live: Live, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as held:
        held.bind(str(live.folder / "run" / "health"))
        held.listen()
        status, findings = examined(live, capsys, "0.5")
        assert status == 1
        assert "sent no health report within 0.5 s" in findings["service"]["text"]
        assert set(findings) == {"safety keys", "expert keys", "service", "log", "kernels"}
    assert not address_in_use(f"ipc://{live.folder}/run/health")

    def closed(address: str) -> bool:
        raise PermissionError

    monkeypatch.setattr(service_check, "address_in_use", closed)
    findings = examined(live, capsys, "1")[1]
    assert "may not be read by this user" in findings["service"]["text"]
    assert set(findings) == {"safety keys", "expert keys", "service", "log", "kernels"}


def test_the_doctor_waits_for_a_starting_service_and_uses_its_report(
    live: Live, capsys: pytest.CaptureFixture[str]
) -> None:
    live.config.write_text('[record]\nrecord = "off"\n')
    with zmq.Context() as context:
        publisher = Publisher(Stream("health", f"ipc://{live.folder}/run/health"), context)
        starting = pb.Health(state=pb.Health.STATE_STARTING, troubles=["starting: the kernels are loaded"])
        reports = chain([starting] * 20, repeat(pb.Health(state=pb.Health.STATE_ACTIVE)))
        over = threading.Event()

        def send() -> None:
            while not over.wait(0.05):
                publisher.publish(next(reports))

        builder = threading.Thread(target=send)
        builder.start()
        assert main(["doctor", "-c", str(live.config), "--patience", str(PATIENCE_S)]) == 0
        over.set()
        builder.join()
        publisher.close()
    findings = capsys.readouterr().out
    assert "ok  service: running: OK" in findings
    assert "no fault found" in findings


def test_whether_a_tcp_port_is_held_is_reported_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert address_in_use(f"tcp://127.0.0.1:{port}")
        assert address_in_use(f"tcp://*:{port}")
    assert not address_in_use(f"tcp://127.0.0.1:{port}")


def test_findings_as_text(live: Live, capsys: pytest.CaptureFixture[str]) -> None:
    live.config.write_text('[record]\nrecord = "off"\n')
    assert main(["doctor", "-c", str(live.config), "--patience", "1"]) == 1
    findings = capsys.readouterr().out
    assert "ok  service: not running; its parts are checked by this command" in findings
    (cameras,) = [line for line in findings.splitlines() if line.startswith(" !  cameras: none is configured")]
    assert cameras.endswith(" [no_camera_configured]")
    assert "no fault found" not in findings


def test_a_finding_shows_its_code_once(capsys: pytest.CaptureFixture[str]) -> None:
    """The code leads to the table of remedies; a finding of the service begins with it."""
    findings = [
        Finding("service", False, "link_slow: the link is too slow", "link_slow"),
        Finding("link", False, "the link is not open", "link_closed"),
        Finding("computer", False, "this computer is busy"),
        Finding("kernels", True, "compiled"),
    ]
    assert not print_findings(findings)
    assert capsys.readouterr().out.splitlines() == [
        " !  service: link_slow: the link is too slow",
        " !  link: the link is not open [link_closed]",
        " !  computer: this computer is busy",
        "ok  kernels: compiled",
    ]


def test_wrong_use(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.config.installed.INSTALLED", tmp_path / "none.toml")
    assert main(["doctor"]) == 1
    assert "`companion setup` writes one" in capsys.readouterr().err
    assert main(["doctor", "-c", str(tmp_path / "none.toml")]) == 1
    assert "`companion configs` lists" in capsys.readouterr().err


@pytest.mark.usefixtures("without_rates")
@pytest.mark.parametrize(("baud", "good"), [(57_600, False), (115_200, False), (921_600, True)])
def test_the_line_s_budget_is_reported(
    baud: int, good: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("RUNTIME_DIRECTORY", "STATE_DIRECTORY"):
        monkeypatch.setenv(name, str(tmp_path / name))
    end, config = PtyEnd(), tmp_path / "doctor.toml"
    config.write_text(f'[autopilot]\naddress = "serial:{end.device}:{baud}"\n[avoid]\nsend = true\n')
    with AutopilotLink(SimulatedAutopilot(), end):
        main(["doctor", "-c", str(config), "--json", "--patience", "3"])
    (line,) = [f for f in json.loads(capsys.readouterr().out)["findings"] if f["part"] == "link"]
    assert line["ok"] == good
    assert f"of {baud / 10_000:.1f} each way" in line["text"]
    assert ("set 921600 baud" in line["text"]) != good
