"""`companion doctor --apply` writes parameters only to a disarmed autopilot, after the list was confirmed with `yes`."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import companion
import companion.autopilot.parameter_writer as parameter_writer
import companion.autopilot.parameters as parameters
import drivers
from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.parameter_advice import advice
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameter_writer import Change, changes
from companion.cli import main
from companion.config.loader import Config, load_config
from companion.doctor import apply, autopilot_check, doctor
from drivers.mavlink.own_vehicle import SILENT_NS
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_parameters import DEFAULTS, PARAMETERS
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port
from tests.waiting import until

pytestmark = pytest.mark.process

BAD = {
    PX4: {"CP_DIST": -1.0, "CP_DELAY": 0.0, "CP_GO_NO_DATA": 1, "MPC_POS_MODE": 1},
    ARDUPILOT: {
        "PRX1_TYPE": 0,
        "AVOID_ENABLE": 1,
        "AVOID_MARGIN": 15.0,
        "AVOID_BEHAVE": 0,
        "AVOID_BACKUP_SPD": 0.75,
        "OA_TYPE": 1,
    },
}
GOOD = {
    PX4: {"CP_DIST": 3.0, "CP_DELAY": 0.4, "CP_GO_NO_DATA": 0, "MPC_POS_MODE": 4},
    ARDUPILOT: {
        "PRX1_TYPE": 2,
        "AVOID_ENABLE": 3,
        "AVOID_MARGIN": 2.0,
        "AVOID_BEHAVE": 1,
        "AVOID_BACKUP_SPD": 0.0,
        "OA_TYPE": 1,
    },
}
"""OA_TYPE is not changed: the kind of path planning is the user's choice."""


@contextmanager
def flying(kind: str, folder: Path, values: dict[str, float], **profile: Any) -> Iterator[tuple[AutopilotLink, Path]]:
    """A simulated autopilot and a configuration for it."""
    port, config = free_port(), folder / "doctor.toml"
    config.write_text(
        f'[autopilot]\naddress = "udpin:127.0.0.1:{port}"\n[avoid]\nsend = true\n[publish]\nhealth = ""\n[record]\nrecord = "off"\n'
    )
    autopilot = SimulatedAutopilot(FirmwareProfile(kind=kind, **profile))
    autopilot.parameters = DEFAULTS[kind] | values
    with AutopilotLink(autopilot, UdpEnd("127.0.0.1", port)) as line:
        yield line, config


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.setattr(doctor, "computer_findings", lambda config: iter(()))
    monkeypatch.setattr(autopilot_check, "RATE_WINDOW_NS", 0)  # neither rates nor forged values are a subject here
    monkeypatch.setattr(parameters, "SURE_NS", 100_000_000)
    monkeypatch.setattr(parameters, "ASK_TO_BE_SURE_NS", 40_000_000)


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Changes are proposed as soon as the parameters are known: for autopilots that are not armed and not contradicted."""
    monkeypatch.setattr(parameter_writer, "STILL_S", 0.0)


def type_in(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))


def facts(kind: str, values: dict[str, float]) -> AutopilotFacts:
    return AutopilotFacts(kind=kind, values=values, version=FirmwareVersion(1, 16) if kind == PX4 else None)


def sets(line: AutopilotLink) -> list[Any]:
    return list(line.change(lambda a: a.of_kind("PARAM_SET")))


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_with_a_typed_yes_all_is_written_and_read_back(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    type_in("yes\n", monkeypatch)
    with flying(kind, tmp_path, BAD[kind]) as (line, config):
        main(["doctor", "-c", str(config), "--apply", "--patience", "60"])
        output = capsys.readouterr().out
        assert line.change(lambda a: dict(a.parameters)) == pytest.approx(DEFAULTS[kind] | GOOD[kind])
        assert {type(v) for v in line.change(lambda a: list(a.parameters.values()))} <= {int, float}
    assert output.index("type yes to write them") < output.index("written and read back")
    assert output.count("written and read back") == len(changes(facts(kind, BAD[kind]), load_config(config)))
    assert ("PRX1_TYPE: 0 -> 2 (it reads obstacles from MAVLink; restart the autopilot afterwards)" in output) == (
        kind == ARDUPILOT
    )
    assert ("CP_GO_NO_DATA: 1 -> 0" in output) == (kind == PX4)
    assert "will not brake" not in output  # what is found then is found of the new values


@pytest.mark.parametrize(("answer", "confirmed"), [("yes\n", True), ("no\n", False), ("", False), ("y\n", False)])
def test_only_a_typed_yes_confirms(answer: str, confirmed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    type_in(answer, monkeypatch)
    assert apply.confirmed([]) is confirmed


@pytest.mark.usefixtures("soon")
def test_without_confirmation_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    type_in("y\n", monkeypatch)
    with flying(ARDUPILOT, tmp_path, BAD[ARDUPILOT]) as (line, config):
        assert main(["doctor", "-c", str(config), "--apply", "--patience", "60"]) == 1
        assert sets(line) == []
    assert "nothing is written: without a yes" in capsys.readouterr().out


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_without_apply_nothing_is_written(
    options: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    type_in("yes\n", monkeypatch)
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):
        assert main(["doctor", "-c", str(config), "--patience", "60", *options]) == 1
        assert sets(line) == []
    assert "will not brake" in capsys.readouterr().out


def test_only_one_file_can_write_a_parameter() -> None:
    places = [Path(package.__file__ or "").parent for package in (companion, drivers)]
    writers = {f.name for place in places for f in place.rglob("*.py") if "param_set" in f.read_text()}
    assert writers == {"parameter_writer.py"}


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_nothing_is_written_to_an_armed_vehicle(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with flying(kind, tmp_path, BAD[kind], armed=True) as (line, config):
        assert main(["doctor", "-c", str(config), "--apply", "--yes", "--json", "--patience", "60"]) == 1
        assert sets(line) == []
    (finding,) = [f for f in json.loads(capsys.readouterr().out)["findings"] if f["part"] == "apply"]
    assert "ARMED" in finding["text"]


def steps(config: Path, agreed: Callable[[list[Change]], bool], patience_s: float = 60.0) -> list[tuple[bool, str]]:
    return [(f.ok, f.text) for f in apply.apply(load_config(config), patience_s, agreed)]


def test_nothing_is_written_when_the_vehicle_is_armed_before_the_confirmation(tmp_path: Path) -> None:
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):

        def armed_meanwhile(wanted: list[Change]) -> bool:
            line.change(lambda a: setattr(a.profile, "armed", True))
            seen = len(line.change(lambda a: a.of_kind("HEARTBEAT")))
            # the companion and the autopilot each send a heartbeat once a second
            assert until(lambda: len(line.change(lambda a: a.of_kind("HEARTBEAT"))) > seen + 1)
            return True

        results = steps(config, armed_meanwhile)
        assert sets(line) == []
        assert results
        assert all(not good and "ARMED" in text for good, text in results)


def test_nothing_is_proposed_for_a_vehicle_that_is_armed_while_its_parameters_are_read(tmp_path: Path) -> None:
    """Its next heartbeat may come after the parameters are known."""
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):

        def arm() -> None:
            assert until(lambda: line.change(lambda a: a.of_kind("PARAM_REQUEST_READ")))
            line.change(lambda a: setattr(a.profile, "armed", True))

        with ThreadPoolExecutor(1) as pilot:
            armed = pilot.submit(arm)
            proposed: list[Change] = []
            ((good, text),) = steps(config, lambda wanted: proposed.extend(wanted) is None)
            armed.result()
        assert (good, "ARMED" in text, proposed) == (False, True, [])


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("unplugged", [True, False])
def test_nothing_is_written_to_an_autopilot_that_was_exchanged_before_the_confirmation(
    unplugged: bool, tmp_path: Path
) -> None:
    """The list is of the one before. The other one has the same ids; after a long silence no clock shows that it is another."""
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):

        def exchanged_meanwhile(wanted: list[Change]) -> bool:
            if unplugged:
                line.change(lambda a: setattr(a, "silent", True))
                time.sleep(SILENT_NS / 1e9 + 0.5)
                line.change(lambda a: (a.received.clear(), setattr(a, "silent", False)))
            else:
                line.change(lambda a: (a.received.clear(), a.reboot(time.monotonic_ns())))
            # three answers that contradict the clock of before show it
            assert until(lambda: len(line.change(lambda a: a.of_kind("TIMESYNC"))) >= 6)
            # each sends a heartbeat once a second: without one of the autopilot the reason would be another
            assert until(lambda: len(line.change(lambda a: a.of_kind("HEARTBEAT"))) >= 2)
            return True

        results = steps(config, exchanged_meanwhile)
        assert sets(line) == []
        assert results
        assert all(
            not good and "silent, replaced or restarted since the list was made" in text for good, text in results
        )


@pytest.mark.usefixtures("soon")
def test_a_rejected_parameter_is_reported_and_the_others_are_written(tmp_path: Path) -> None:
    with flying(ARDUPILOT, tmp_path, BAD[ARDUPILOT]) as (line, config):
        line.change(lambda a: a.stubborn.add("PRX1_TYPE"))
        results = steps(config, lambda wanted: True)
        assert line.change(lambda a: a.parameters["AVOID_ENABLE"]) == 3
    assert [text for good, text in results if not good] == [
        "PRX1_TYPE: it still reports 0: written 3 times and not accepted; set it from the ground station"
    ]


def test_nothing_is_written_on_a_link_with_two_autopilots(tmp_path: Path) -> None:
    with flying(ARDUPILOT, tmp_path, BAD[ARDUPILOT]) as (line, config):
        port = load_config(config).autopilot.address.rsplit(":", 1)[1]
        forger = SimulatedAutopilot(FirmwareProfile(kind=PX4, system_id=1))
        with AutopilotLink(forger, UdpEnd("127.0.0.1", int(port))):
            results = steps(config, lambda wanted: True, 5.0)
        assert sets(line) == []
        assert forger.of_kind("PARAM_SET") == []
    assert len(results) == 1
    assert "contradictory heartbeats" in results[0][1]


def test_a_margin_without_room_is_changed_as_it_is_reported() -> None:
    """ArduPilot's fence is nearer than the wall: a margin of 11.5 m needs a wall beyond the 12 m of max_distance_m."""
    narrow = facts(ARDUPILOT, GOOD[ARDUPILOT] | {"AVOID_MARGIN": 11.5})
    assert any("AVOID_MARGIN = 11.5 m leaves no room" in line for line in advice(narrow, Config().avoid))
    assert [(c.name, c.to) for c in changes(narrow, Config())] == [("AVOID_MARGIN", 2.0)]


def test_a_proximity_sensor_of_the_vehicle_is_not_replaced() -> None:
    """PRX1_TYPE = 5 is a lidar: written over, the vehicle would lose it."""
    for sensors in ({"PRX1_TYPE": 5.0}, {"PRX1_TYPE": 5.0, "PRX2_TYPE": 2.0}, {"PRX1_TYPE": 0.0, "PRX2_TYPE": 2.0}):
        assert changes(facts(ARDUPILOT, GOOD[ARDUPILOT] | sensors), Config()) == []


@pytest.mark.usefixtures("soon")
def test_good_parameters_are_not_changed(tmp_path: Path) -> None:
    for kind, good in (*PARAMETERS.items(), *GOOD.items()):
        assert changes(facts(kind, good), Config()) == []
        assert changes(facts(kind, {}), Config()) == []  # an unknown value is not reported as wrong
    with flying(PX4, tmp_path, GOOD[PX4]) as (line, config):
        assert steps(config, lambda wanted: True) == [(True, "nothing to change")]
        assert sets(line) == []


@pytest.mark.usefixtures("soon")
def test_a_pending_restart_is_reported_until_the_autopilot_was_restarted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the run that wrote PRX1_TYPE and by each later one."""
    bad = GOOD[ARDUPILOT] | {"PRX1_TYPE": 0}
    with flying(ARDUPILOT, tmp_path, bad, proximity_started=False) as (line, config):
        assert main(["doctor", "-c", str(config), "--apply", "--yes", "--json", "--patience", "60"]) == 1
        found = json.loads(capsys.readouterr().out)["findings"]
        assert [f["part"] for f in found if "restart the autopilot:" in f["text"]] == ["apply", "parameters"]
        assert main(["doctor", "-c", str(config), "--patience", "60"]) == 1
        output = capsys.readouterr().out
        assert "restart the autopilot" in output
        assert "as it should be" not in output
        line.change(lambda a: setattr(a.profile, "proximity_started", True))
        main(["doctor", "-c", str(config), "--patience", "60"])
        assert "restart the autopilot" not in capsys.readouterr().out


def test_without_an_autopilot_or_beside_the_service_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):
        line.change(lambda a: setattr(a, "silent", True))
        assert "heartbeat" in steps(config, lambda wanted: True, 1.0)[0][1]
        for module in (apply, doctor):
            monkeypatch.setattr(module, "running_service", lambda config, patience_s: [])
        main(["doctor", "-c", str(config), "--apply", "--yes", "--json"])
        assert sets(line) == []
    assert "stop it first" in capsys.readouterr().out


def test_options_that_exclude_each_other_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "-c", str(tmp_path / "x.toml"), "--yes"]) == 2
    assert main(["doctor", "-c", str(tmp_path / "x.toml"), "--apply", "--json"]) == 2
    assert "add --yes" in capsys.readouterr().err


@pytest.mark.usefixtures("soon")
def test_px4_receives_integers_as_the_bytes_of_a_float(tmp_path: Path) -> None:
    with flying(PX4, tmp_path, BAD[PX4]) as (line, config):
        assert all(good for good, _ in steps(config, lambda wanted: True))
        kinds = {m.param_id: (m.param_type, m.param_value) for m in sets(line)}
    assert kinds["CP_DIST"] == (9, 3.0)
    assert kinds["MPC_POS_MODE"][0] == 6
    assert kinds["MPC_POS_MODE"][1] == pytest.approx(4 * 2.0**-149)  # the bytes of 4 as a float
