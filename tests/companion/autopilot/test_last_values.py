"""After a restart the artificial wall stands where the autopilot's parameters had it before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from companion.autopilot.autopilot_values import AutopilotValues
from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.last_values import NAME, LastValues, LastValuesFile
from companion.autopilot.line import AutopilotLine
from companion.autopilot.obstacle_output import ObstacleOutput
from companion.autopilot.obstacle_report import CameraUse
from companion.config.avoidance import AvoidParams
from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import LinkStatus, Vehicle

from ..link_status import link_status

NS = 1_000_000_000


def obstacle_output(folder: Path, system_id: int = 1, kind: str = "ArduPilot") -> ObstacleOutput:
    def ignore(message: Any) -> None:
        pass

    vehicle = Vehicle(system_id, kind, 2, True, 5, 0)
    return ObstacleOutput(
        AvoidParams(send=True, avoid_margin_m=2.0),
        CameraUse(cameras=("front",), timeout_s=0.3),
        AutopilotLine(lambda: vehicle, ignore),
        last=LastValuesFile(folder),
    )


def receive_margin(part: ObstacleOutput, value: float) -> None:
    """The autopilot sends AVOID_MARGIN for two seconds."""
    part.tick(NS)
    for k in range(20):
        part.values.parameters.take(
            dialect.MAVLink_param_value_message(b"AVOID_MARGIN", value, 9, 1, 0), NS + k * NS // 10
        )
    part.tick(3 * NS)


def nearest_wall_m(part: ObstacleOutput) -> float:
    """Of the very first decision."""
    decided = part._builder.decide(part._autopilot(), 10 * NS)
    assert decided.values is not None
    return float(decided.values.min()) / 100.0


def test_the_first_wall_after_a_restart_is_not_nearer_than_the_margin(tmp_path: Path) -> None:
    first = obstacle_output(tmp_path)
    receive_margin(first, 3.0)
    before_m = nearest_wall_m(first)
    assert before_m > 3.0
    first.values.close()
    assert nearest_wall_m(obstacle_output(tmp_path)) == before_m
    assert nearest_wall_m(obstacle_output(tmp_path, system_id=2)) < 3.0, "another vehicle has a margin of its own"


def test_what_is_read_now_outranks_what_was_kept(tmp_path: Path) -> None:
    first = obstacle_output(tmp_path)
    receive_margin(first, 5.0)
    first.values.close()
    second = obstacle_output(tmp_path)
    receive_margin(second, 3.0)
    assert 3.0 < nearest_wall_m(second) < 5.0
    second.values.close()
    assert LastValuesFile(tmp_path).of("ArduPilot", 1).parameters == {"AVOID_MARGIN": 3.0}


GOOD = b'{"autopilot": "PX4", "system_id": 1, "version": [1, 16, 0], "parameters": {"CP_DIST": 3}}'


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[" * 900,
        b"3",
        b"\xff\xfe",
        GOOD.replace(b'1, "v', b'1e999, "v'),
        GOOD.replace(b"[1, 16, 0]", b"16"),
        GOOD.replace(b'{"CP_DIST": 3}', b"3"),
    ],
)
def test_a_file_of_another_origin_is_ignored(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NAME).write_bytes(content)
    assert LastValuesFile(tmp_path).of("PX4", 1) == LastValues("PX4", 1)
    (tmp_path / NAME).write_bytes(GOOD)
    kept = LastValuesFile(tmp_path)
    assert kept.of("PX4", 1) == LastValues("PX4", 1, FirmwareVersion(1, 16), {"CP_DIST": 3.0})
    assert kept.of("ArduPilot or PX4", 1).parameters == {"CP_DIST": 3.0}, "one of the two is this vehicle"
    assert kept.of("ArduPilot", 1).parameters == kept.of("PX4", 2).parameters == {}


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    last = LastValuesFile(tmp_path / "gone")
    last.keep(LastValues("ArduPilot", 1, None, {"AVOID_MARGIN": 3.0}))
    last.close()
    assert "autopilot.json cannot be written" in caplog.text
    assert last.of("ArduPilot", 1).parameters == {"AVOID_MARGIN": 3.0}


def test_a_value_that_was_not_read_yet_keeps_the_last_one(tmp_path: Path) -> None:
    first = LastValuesFile(tmp_path)
    first.keep(LastValues("PX4", 1, FirmwareVersion(1, 16), {"CP_DIST": 3.0, "CP_DELAY": 0.4}))
    first.close()
    second = LastValuesFile(tmp_path)
    second.keep(LastValues("PX4", 1))  # nothing was read yet
    assert second.of("PX4", 1).parameters == {"CP_DIST": 3.0}
    second.keep(LastValues("PX4", 1, FirmwareVersion(1, 16, 1)))
    second.close()
    assert LastValuesFile(tmp_path).of("PX4", 1) == LastValues("PX4", 1, FirmwareVersion(1, 16, 1), {"CP_DIST": 3.0})


@pytest.mark.parametrize(
    "content", [GOOD.replace(b"3}", b"NaN}"), GOOD.replace(b"3}", b"-3}"), GOOD.replace(b"CP_DIST", b"OTHER")]
)
def test_a_value_of_the_file_that_cannot_be_is_dropped_and_the_rest_is_used(tmp_path: Path, content: bytes) -> None:
    (tmp_path / NAME).write_bytes(content)
    assert LastValuesFile(tmp_path).of("PX4", 1) == LastValues("PX4", 1, FirmwareVersion(1, 16))


@pytest.mark.parametrize("value", [-1.0, 0.0, 101.0])
def test_a_value_without_use_is_not_kept_and_ends_the_one_before(tmp_path: Path, value: float) -> None:
    first = LastValuesFile(tmp_path)
    first.keep(LastValues("PX4", 1, FirmwareVersion(1, 16), {"CP_DIST": 3.0}))
    first.close()
    first.keep(LastValues("PX4", 1, FirmwareVersion(1, 16), {"CP_DIST": value}))
    first.close()
    assert LastValuesFile(tmp_path).of("PX4", 1) == LastValues("PX4", 1, FirmwareVersion(1, 16))


def test_a_value_without_use_ends_the_one_before_although_nothing_else_is_known(tmp_path: Path) -> None:
    first = LastValuesFile(tmp_path)
    for value in (3.0, -1.0):
        first.keep(LastValues("PX4", 1, None, {"CP_DIST": value}))
        first.close()
    assert LastValuesFile(tmp_path).of("PX4", 1).parameters == {}


def test_a_kept_margin_does_not_identify_the_autopilot(tmp_path: Path) -> None:
    first = obstacle_output(tmp_path)
    receive_margin(first, 2.0)
    first.values.close()
    assert nearest_wall_m(obstacle_output(tmp_path, kind="ArduPilot or PX4")) > 3.0, "outside the configured cp_dist_m"


def test_a_kept_cp_dist_is_used_and_reported_until_it_is_read(tmp_path: Path) -> None:
    (tmp_path / NAME).write_bytes(GOOD)
    part = obstacle_output(tmp_path, kind="PX4")
    part.tick(NS)
    part.sender.report = part._builder.decide(part._autopilot(), NS)
    assert part.sender.report.policy == "brake"
    assert [d.text for d in part.diagnostics(NS) if "CP_DIST" in d.text and "last start" in d.text]
    for k in range(20):
        part.values.parameters.take(dialect.MAVLink_param_value_message(b"CP_DIST", 3.0, 9, 1, 0), NS + k * NS // 10)
    assert not [d.text for d in part.diagnostics(4 * NS) if "last start" in d.text]


@pytest.mark.parametrize("kind", ["ArduPilot or PX4", "ArduPilot", "PX4"])
def test_what_was_read_of_one_of_several_vehicles_brings_no_wall_near(kind: str, tmp_path: Path) -> None:
    """The own one may have other parameters. PX4 v1.16 flies backwards from a wall nearer than its CP_DIST, ArduPilot from one nearer
    than AVOID_MARGIN: the wall stood at 0.6 m, by the first vehicle's AVOID_MARGIN."""
    part = obstacle_output(tmp_path, kind=kind.split(" ")[0])
    for k in range(20):
        for name, value in ((b"AVOID_MARGIN", 0.6), (b"CP_DIST", 0.6)):
            part.values.parameters.take(dialect.MAVLink_param_value_message(name, value, 9, 1, 0), NS + k * NS // 10)
        part.tick(NS)
    assert nearest_wall_m(part) < 0.7
    other = Vehicle(1, kind, 2, True, 5, 0)
    part._line = AutopilotLine(lambda: other, lambda message: None)
    part.tick(4 * NS, several_vehicles(other))
    assert nearest_wall_m(part) >= (2.0 if kind == "ArduPilot" else 3.0)


def several_vehicles(first: Vehicle) -> LinkStatus:
    conflicts = {"several vehicles": "several vehicles, set system_id: systems 1, 7"}
    return link_status(first, vehicle_uncertain=True, conflicts=conflicts)


def test_the_ground_station_is_sent_the_cause_while_the_vehicle_received_first_is_silent(tmp_path: Path) -> None:
    """After a change of its system id the autopilot is another vehicle, and the first one stays silent: all cameras are blind."""
    part, sent = obstacle_output(tmp_path), list[Any]()
    first = Vehicle(7, "ArduPilot", 2, False, 5, 0)
    part._line = AutopilotLine(lambda: None, sent.append, lambda: first)
    for k in range(50):
        part.tick(NS + k * NS // 10, several_vehicles(first))
    assert [m.text for m in sent] == ["OA: several vehicles, set system_id"]


def test_of_several_vehicles_none_is_on_the_ground(tmp_path: Path) -> None:
    """On the ground distances below 0.75 m are not sent. The vehicle received first stood there, and the own one flew."""
    values = AutopilotValues(LastValuesFile(tmp_path))
    first = Vehicle(7, "ArduPilot", 2, False, 5, 0)
    assert values.state(first, NS, is_uncertain=False).on_ground
    assert not values.state(first, NS, is_uncertain=True).on_ground
