"""Faults recognised by their pattern: when they are reported, when not, and their texts."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from companion.cameras.status import CameraCondition, CameraStatus
from companion.config.camera import CameraConfig
from companion.config.loader import Config, config_of, load_config
from companion.config.service import AutopilotConfig
from companion.config.template_intrinsics import TEMPLATE_V4L2_PX, TEMPLATE_ZED_CALIBRATION
from companion.diagnostic import DiagnosticCode
from companion.doctor.autopilot_check import link_findings
from companion.doctor.doctor import config_findings
from companion.live.diagnostics import (
    GROUND_FRAMES,
    MIN_ATTITUDE_HZ,
    AttitudeRateCheck,
    CameraRateCheck,
    GroundCheck,
    diagnostics_of,
    template_intrinsics,
)
from companion.live.health import AutopilotView, CameraView, autopilot_message
from companion.live.service import Service
from companion.paths import Folders
from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.link import LinkState
from drivers.mavlink.session_types import Vehicle
from osape_client.proto import osape_v1_pb2 as pb

from ..link_status import link_status

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
S = 1_000_000_000


def test_the_template_values_are_those_of_the_shipped_files() -> None:
    (v4l2,) = tomllib.loads((CONFIGS / "v4l2.toml").read_text())["camera"]
    (zed,) = tomllib.loads((CONFIGS / "zed.toml").read_text())["camera"]
    assert tuple(v4l2[k] for k in ("fx_px", "fy_px", "cx_px", "cy_px")) == TEMPLATE_V4L2_PX
    assert Path(zed["calibration"]).name == TEMPLATE_ZED_CALIBRATION


@pytest.mark.parametrize("name", ["v4l2", "zed"])
def test_unchanged_template_intrinsics_are_named(name: str) -> None:
    config = load_config(CONFIGS / f"{name}.toml")
    (found,) = template_intrinsics(config.cameras)
    assert (found.code, found.camera) == ("template_intrinsics", "front")
    assert f"configs/{name}.toml" in found.text
    own = replace(config.cameras[0], fx_px=384.1, calibration="/etc/osape-companion/SN00001234.conf")
    assert template_intrinsics([own]) == []
    findings = {f.part: f for f in config_findings(config)}
    assert not findings["camera front"].ok
    assert "template_intrinsics" in findings["camera front"].text


@pytest.mark.parametrize("name", ["oak", "simulated", "two-cameras", "indoor", "default"])
def test_other_shipped_files_have_no_template_intrinsics(name: str) -> None:
    assert template_intrinsics(load_config(CONFIGS / f"{name}.toml").cameras) == []


def test_a_low_rate_of_the_attitude_is_named_after_three_seconds() -> None:
    check = AttitudeRateCheck(100.0)
    assert check.check(2.0, 0) == []
    assert check.check(2.0, 3 * S - 1) == []
    (found,) = check.check(2.0, 3 * S)
    assert found.code == "attitude_rate_low"
    for part in ("2.0 Hz", "10 Hz", "100 Hz", "SRx_EXTRA1", "MAV_x_RATE"):
        assert part in found.text


def test_a_rate_that_rises_or_ends_is_not_low() -> None:
    check = AttitudeRateCheck(100.0)
    check.check(2.0, 0)
    assert check.check(MIN_ATTITUDE_HZ, 2 * S) == []
    assert check.check(2.0, 4 * S) == []
    assert check.check(0.0, 6 * S) == []  # silence is reported by its age
    assert check.check(2.0, 8 * S) == []


def at_rate(hz: float, condition: CameraCondition = CameraCondition.RUNNING) -> list[CameraView]:
    status = CameraStatus(camera="front", condition=condition, cause="", since_ns=0)
    return [CameraView(status=status, required=True, blind="", age_ns=0, hz=hz)]


def test_a_camera_that_is_slower_than_configured_is_named_after_three_seconds() -> None:
    """A camera that falls back to USB 2 in flight shows an obstacle later, and the service reported OK."""
    check = CameraRateCheck([CameraConfig(name="front", kind="oak", fps=30.0)])
    assert check.check(at_rate(23.9), 0) == []
    assert check.check(at_rate(4.0), 3 * S - 1) == []
    (found,) = check.check(at_rate(4.0), 3 * S)
    assert (found.code, found.camera) == ("camera_rate_low", "front")
    for part in ("camera front", "4.0 Hz", "fps = 30", "USB 3"):
        assert part in found.text
    assert check.check(at_rate(24.0), 4 * S) == []
    assert check.check(at_rate(4.0), 5 * S) == []


def test_a_camera_that_does_not_run_has_no_low_rate() -> None:
    """It is reported with its cause. The simulated camera renders as fast as the computer can."""
    check = CameraRateCheck([CameraConfig(name="front", kind="oak")])
    for second in range(9):
        assert check.check(at_rate(0.0, CameraCondition.LOST), second * S) == []
    assert check.check(at_rate(9.0), 9 * S) == []
    simulated = CameraRateCheck([CameraConfig(name="front", kind="simulated")])
    for second in range(9):
        assert simulated.check(at_rate(2.0), second * S) == []


def found_by_doctor(
    clock: ClockEstimate, attitude_hz: float = 100.0, repeated: bool = False, address: str = ""
) -> dict[str, Any]:
    """Findings by their part."""
    vehicle = SimpleNamespace(autopilot="PX4", system_id=1, armed=False)
    status = SimpleNamespace(
        vehicle=vehicle,
        attitude_hz=attitude_hz,
        position_hz=1.0,
        received=9,
        clock=clock,
        attitude_repeated=repeated,
    )
    link = SimpleNamespace(state=SimpleNamespace(error="", open=True))
    config = Config(autopilot=AutopilotConfig(address=address))
    return {f.part: f for f in link_findings(config, cast(Any, link), cast(Any, status))}


def test_doctor_names_a_low_rate_of_the_attitude() -> None:
    finding = found_by_doctor(ClockEstimate(ClockSource.TIMESYNC), 2.0)["attitude"]
    assert not finding.ok
    assert finding.text.startswith("attitude_rate_low: attitude arrives at 2.0 Hz")


@pytest.mark.parametrize(
    ("address", "remedy"), [("serial:/dev/ttyAMA0:57600", "921600 baud"), ("udpin:0.0.0.0:14540", "end other programs")]
)
def test_doctor_names_a_remedy_that_the_link_has(address: str, remedy: str) -> None:
    """A faster serial line was proposed for UDP, also on a busy computer beside the simulated autopilot."""
    finding = found_by_doctor(ClockEstimate(ClockSource.TIMESYNC), 74.0, address=address)["attitude"]
    assert (finding.ok, finding.code) == (False, DiagnosticCode.ATTITUDE_RATE_LOW)
    assert finding.text.startswith("74 Hz of 100 Hz requested, position 1 Hz: raise the stream rate")
    assert finding.text.endswith((f"({remedy})", f"{remedy} on this computer"))


def test_doctor_names_an_attitude_that_repeats_itself() -> None:
    finding = found_by_doctor(ClockEstimate(ClockSource.TIMESYNC), repeated=True)["attitude"]
    assert (finding.ok, finding.code) == (False, DiagnosticCode.ATTITUDE_REPEATED)


def test_doctor_names_an_uncertain_clock() -> None:
    finding = found_by_doctor(ClockEstimate(ClockSource.TIMESYNC, bound_ns=54_500_000))["clock"]
    assert (finding.ok, finding.code) == (False, DiagnosticCode.CLOCK_UNCERTAIN)
    assert "921600 baud" in finding.text


@pytest.mark.parametrize(
    ("kind", "address", "received", "noise", "remedy"),
    [
        ("simulated", "udpin:0.0.0.0:14540", 0, 0, "companion simulate-autopilot"),
        ("oak", "udpin:0.0.0.0:14540", 0, 0, "that the autopilot is on"),
        ("oak", "serial:/dev/ttyAMA0:57600", 0, 900, "set the baud rate"),
        ("oak", "serial:/dev/ttyAMA0:57600", 0, 3, "TX and RX are crossed"),
        ("oak", "serial:/dev/ttyAMA0:57600", 5, 900, "none of an autopilot"),
        ("oak", "udpin:0.0.0.0:14540", 0, 900, "check the address"),
    ],
)
def test_no_heartbeat_has_the_remedy_of_what_arrives(
    kind: str, address: str, received: int, noise: int, remedy: str
) -> None:
    """A wrong baud rate and crossed lines were both reported as an autopilot that is off or sends elsewhere."""
    config = Config(cameras=(CameraConfig(name="front", kind=kind),), autopilot=AutopilotConfig(address=address))
    status = SimpleNamespace(vehicle=None, received=received, counts={"noise_bytes": noise})
    link = SimpleNamespace(state=LinkState(alive_ns=0))
    (finding,) = link_findings(config, cast(Any, link), cast(Any, status))
    assert remedy in finding.text


def test_a_camera_in_sitl_needs_no_simulated_autopilot() -> None:
    """The remedy was `companion simulate-autopilot` also where the camera follows the autopilot of a simulation."""
    camera = CameraConfig(name="front", kind="simulated", follow="udpin:127.0.0.1:14551")
    config = Config(cameras=(camera,), autopilot=AutopilotConfig(address="udpin:127.0.0.1:14540"))
    status = SimpleNamespace(vehicle=None, received=0, counts={})
    link = SimpleNamespace(state=LinkState(alive_ns=0))
    (finding,) = link_findings(config, cast(Any, link), cast(Any, status))
    assert "that the autopilot is on" in finding.text


def autopilot(
    clock: ClockEstimate,
    answered: bool = True,
    attitude_age_ns: int | None = 0,
    repeated: bool = False,
    stamps_used: bool = True,
) -> AutopilotView:
    link = link_status(
        Vehicle(1, "PX4", 2, True, 0, S),
        clock=clock,
        timesync_answered=answered,
        attitude_repeated=repeated,
        stamps_used=stamps_used,
    )
    line = LinkState(open=True, error="", warning="", losses=0, alive_ns=S)
    return AutopilotView(address="udpin:0.0.0.0:14540", link_state=line, status=link, attitude_age_ns=attitude_age_ns)


@pytest.mark.parametrize(
    ("age_ns", "text"),
    [(None, "was never received"), (0, ""), (S // 2, ""), (S // 2 + 1, "is 0.5 s old"), (9 * S, "is 9.0 s")],
)
def test_an_attitude_that_is_old_or_never_came_is_named(age_ns: int | None, text: str) -> None:
    view = autopilot(ClockEstimate(ClockSource.TIMESYNC, bound_ns=800_000), attitude_age_ns=age_ns)
    found = [d.text for d in diagnostics_of([], view, None, "") if d.code is DiagnosticCode.ATTITUDE_STALE]
    assert len(found) == bool(text)
    assert all(text in words for words in found)
    message = autopilot_message(view)
    assert message.HasField("attitude_age_ns") is (age_ns is not None)
    assert message.attitude_age_ns == (age_ns or 0)


@pytest.mark.parametrize("age_ns", [None, 9 * S])
def test_attitudes_that_wait_for_the_clock_are_not_called_missing(age_ns: int | None) -> None:
    """For 10 s after a start without answers to TIMESYNC the report said that the autopilot sends none."""
    view = autopilot(ClockEstimate(ClockSource.ENVELOPE), attitude_age_ns=age_ns, stamps_used=False)
    found = [d.text for d in diagnostics_of([], view, None, "") if d.code is DiagnosticCode.ATTITUDE_STALE]
    assert len(found) == 1
    assert "arrive and are not used" in found[0]


@pytest.mark.parametrize(("repeated", "code"), [(True, "attitude_repeated"), (False, "attitude_stale")])
def test_an_attitude_that_repeats_itself_is_not_called_one_that_is_missing(repeated: bool, code: str) -> None:
    clock = ClockEstimate(ClockSource.TIMESYNC, bound_ns=800_000)
    view = autopilot(clock, attitude_age_ns=9 * S, repeated=repeated)
    assert [d.code.value for d in diagnostics_of([], view, None, "") if "attitude" in d.code.value] == [code]


@pytest.mark.parametrize(
    ("clock", "answered", "text"),
    [
        (ClockEstimate(ClockSource.TIMESYNC, bound_ns=800_000), True, ""),
        (ClockEstimate(ClockSource.TIMESYNC, bound_ns=2_300_000), False, "the error bound of its timestamps is 2.3 ms"),
        (ClockEstimate(ClockSource.TIMESYNC, bound_ns=54_500_000), True, "may be wrong by 5"),
        (
            ClockEstimate(ClockSource.ENVELOPE),
            False,
            "include the delay of the link, which is assumed to be at most 30 ms",
        ),
        (ClockEstimate(ClockSource.NONE), False, ""),
    ],
)
def test_timesync_that_is_not_answered_is_named(clock: ClockEstimate, answered: bool, text: str) -> None:
    found = diagnostics_of([], autopilot(clock, answered), None, "")
    said = [d.text for d in found if d.code in (DiagnosticCode.NO_TIMESYNC, DiagnosticCode.CLOCK_UNCERTAIN)]
    assert len(said) == bool(text)
    assert all(text in words for words in said)


def frame(measured: float, seen: bool, valid: bool = True, camera: str = "front") -> Any:
    model = SimpleNamespace(
        valid=valid, ground=SimpleNamespace(seen=seen), stats=SimpleNamespace(measured_share=measured)
    )
    return SimpleNamespace(camera=camera, model=model)


def feed(check: GroundCheck, count: int, result: Any) -> None:
    for _ in range(count):
        check.result(cast(Any, result))


def test_ground_never_seen_is_named() -> None:
    check = GroundCheck()
    feed(check, GROUND_FRAMES - 1, frame(0.95, seen=False))
    assert check.check() == []
    feed(check, 1, frame(0.9, seen=False))
    (found,) = check.check()
    assert (found.code, found.camera) == ("ground_never_seen", "front")
    for part in ("pitch_deg", "roll_deg", "90 or 180 degrees", "attitude"):
        assert part in found.text
    feed(check, 1, frame(0.3, seen=True))
    assert check.check() == []


def test_frames_that_prove_nothing_do_not_count() -> None:
    check = GroundCheck()
    feed(check, 2 * GROUND_FRAMES, frame(0.89, seen=False))
    feed(check, 2 * GROUND_FRAMES, frame(0.95, seen=False, valid=False))
    feed(check, 2 * GROUND_FRAMES, SimpleNamespace(camera="front", model=None))
    assert check.check() == []


def test_ground_once_seen_ends_the_check_until_the_camera_starts_again() -> None:
    check = GroundCheck()
    feed(check, 1, frame(0.5, seen=True))
    feed(check, 2 * GROUND_FRAMES, frame(0.95, seen=False))
    assert check.check() == []
    check.started("front")
    feed(check, GROUND_FRAMES, frame(0.95, seen=False))
    assert [d.code for d in check.check()] == ["ground_never_seen"]


def test_the_health_report_holds_code_and_text(tmp_path: Path) -> None:
    camera = {"name": "front", "kind": "v4l2", "device": "/dev/null"}
    camera |= dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), TEMPLATE_V4L2_PX, strict=True))
    config: Config = config_of({"camera": [camera], "record": {"record": "off"}, "avoid": {"clear_share": 0.5}}, "x")
    service = Service(config, Folders(tmp_path, tmp_path), lambda: None)
    service.parts.pipeline_thread.started.set()
    published: list[pb.Health] = []
    service._output.publishers["health"] = cast(
        Any, SimpleNamespace(published=0, publish=published.append, close=lambda: None)
    )
    try:
        service.tick()
        service.health._ground.started("front")
        feed(service.health._ground, GROUND_FRAMES, frame(0.95, seen=False))
        service.health._next_ns = 0
        service.tick()
    finally:
        service.close()
    others = ["camera_unavailable", "no_autopilot_configured"]
    assert [d.code for d in published[0].diagnostics] == [*others, "template_intrinsics"]
    assert [d.code for d in published[1].diagnostics] == [*others, "template_intrinsics", "ground_never_seen"]
    assert [d.text for d in published[1].diagnostics] == list(published[1].troubles)
    assert [d.camera for d in published[1].diagnostics[-2:]] == ["front", "front"]
    assert list(published[1].changed_safety_keys) == ["[avoid] clear_share = 0.5 (default 0.8)"]


@pytest.mark.parametrize("arrives", [True, False])
def test_an_attitude_that_may_be_of_another_vehicle_is_called_missing_only_if_none_arrives(arrives: bool) -> None:
    view = autopilot(ClockEstimate(ClockSource.TIMESYNC, bound_ns=800_000), attitude_age_ns=9 * S)
    conflicts = {"several vehicles": "autopilots of several system ids: 1, 7; no attitude is used"}
    status = replace(
        view.status, vehicle_uncertain=True, conflicts=conflicts, attitude_hz=view.status.attitude_hz * arrives
    )
    codes = [d.code.value for d in diagnostics_of([], replace(view, status=status), None, "")]
    found = [code for code in codes if code != "no_camera_configured"]
    assert found == ["several_vehicles"] + ["attitude_stale"] * (not arrives)
