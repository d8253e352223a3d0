"""`companion setup` and `companion configs`: from connected devices to a configuration."""

from __future__ import annotations

import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import pytest

import companion.setup.setup as setup
from companion.cli import main
from companion.config.camera_kinds import CAMERA_KINDS
from companion.config.loader import load_config
from companion.doctor.finding import Finding
from companion.setup import listen
from companion.setup.configuration import Answers, configuration_text
from companion.setup.devices import FoundCamera, find_cameras, find_serial_ports
from companion.setup.listen import FoundAutopilot, candidates
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port

from ..usb_tree import CALIBRATION, D435, usb, video

ROOT = Path(__file__).resolve().parents[3]
EYE = "fx=350\nfy=350\ncx=336\ncy=188\nk1=0\nk2=0\np1=0\np2=0\nk3=0\n"
ZED_CALIBRATION = (
    f"[LEFT_CAM_VGA]\n{EYE}\n[RIGHT_CAM_VGA]\n{EYE}\n[STEREO]\nBaseline=120\nTY=0\nTZ=0\nCV_VGA=0\nRX_VGA=0\nRZ_VGA=0\n"
)
D405 = "usb-Intel_R__RealSense_TM__Depth_Camera_405_88-video-index0"


def test_cameras_are_found_by_their_makers(tmp_path: Path) -> None:
    devices = usb(
        tmp_path,
        ("03e7", "Movidius MyriadX", "1944"),
        ("2b03", "ZED 2i", "OV0001"),
        ("2b03", "ZED-2i HID INTERFACE", "37612345"),
        ("8086", "Intel(R) RealSense(TM) Depth Camera 405", "88"),
        ("8086", "a hub", "1"),
        ("1d6b", "xHCI", "0"),
        functions={1: 1, 3: 1},
    )
    zed = "usb-Technologies__Inc._ZED_2i_OV0001-video-index0"
    by_id, by_path = video(tmp_path, video0=f"{zed} /zed", video1="zed1", video2=f"{D405} /d405", video3="d405_1")
    assert [(c.kind, c.device) for c in find_cameras(devices, (by_id, by_path))] == [
        ("oak", ""),
        ("zed", str(by_id / zed)),
        ("v4l2", str(by_id / D405)),
    ]


def test_a_realsense_with_a_colour_stream_has_the_path_of_its_port(tmp_path: Path) -> None:
    """Both streams have the same name by id, which is that of one or the other after each connection."""
    devices = usb(tmp_path, ("8086", "Intel(R) RealSense(TM) Depth Camera 435", "88"), functions={0: 2})
    folders = video(tmp_path, video0="/port:1.0-video-index0", video2=f"{D435} /port:1.3-video-index0")
    assert [c.device for c in find_cameras(devices, folders)] == [str(folders[1] / "port:1.0-video-index0")]


def test_cameras_with_the_same_name_have_the_paths_of_their_ports(tmp_path: Path) -> None:
    """All ZED 2i have the same serial number on USB, and one of two the name by id."""
    devices = usb(tmp_path, ("2b03", "ZED 2i", "OV0001"), ("2b03", "ZED 2i", "OV0001"), functions={0: 1, 1: 1})
    name = "usb-Technologies__Inc._ZED_2i_OV0001-video-index0"
    folders = video(tmp_path, video0=f"{name} /a", video2="/b")
    assert [c.device for c in find_cameras(devices, folders)] == [str(folders[1] / "a"), str(folders[1] / "b")]


def test_without_names_the_node_itself_is_the_device(tmp_path: Path) -> None:
    devices = usb(tmp_path, ("2b03", "ZED", ""), functions={0: 1})
    assert [c.device for c in find_cameras(devices, (tmp_path / "none", tmp_path / "none"))] == ["/dev/video0"]


def test_several_oaks_have_their_ids(tmp_path: Path) -> None:
    devices = usb(tmp_path, ("03e7", "Movidius", "A"), ("03e7", "Movidius", "B"))
    assert [c.device for c in find_cameras(devices, (tmp_path, tmp_path))] == ["A", "B"]


def test_several_realsense_have_their_own_devices(tmp_path: Path) -> None:
    """The second one had the path of the first, with the intrinsics of its own serial number."""
    model = "Intel(R) RealSense(TM) Depth Camera 435"
    devices = usb(tmp_path, ("8086", model, "814"), ("8086", model, "813"), functions={0: 2, 1: 2})
    folders = video(tmp_path, video0="/p814", video2="/p814_colour", video4="/p813", video6="/p813_colour")
    assert [(c.serial, c.device) for c in find_cameras(devices, folders)] == [
        ("814", str(folders[1] / "p814")),
        ("813", str(folders[1] / "p813")),
    ]


def test_no_devices_at_all(tmp_path: Path) -> None:
    assert find_cameras(tmp_path / "none", (tmp_path / "none", tmp_path / "none")) == []
    assert find_serial_ports(tmp_path / "none", tmp_path) == []


def test_serial_ports_by_id_come_first(tmp_path: Path) -> None:
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "usb-FTDI_1").write_text("")
    (tmp_path / "ttyAMA0").write_text("")
    assert find_serial_ports(by_id, tmp_path) == [str(by_id / "usb-FTDI_1"), str(tmp_path / "ttyAMA0")]


def test_an_adapter_is_tried_at_several_speeds_and_an_autopilot_at_one() -> None:
    tried = list(candidates(["/dev/serial/by-id/usb-FTDI_1", "/dev/serial/by-id/usb-Holybro_2"]))
    assert len([a for a in tried if "FTDI" in a]) == 3
    assert len([a for a in tried if "Holybro" in a]) == 1
    assert tried[-1].startswith("udpin:")


@pytest.mark.parametrize("kind", list(CAMERA_KINDS))
def test_the_written_configuration_is_usable(kind: str, tmp_path: Path) -> None:
    answers = Answers(
        kind=kind,
        device="/dev/v4l/by-id/x" if "device" in CAMERA_KINDS[kind].needs else "",
        serial="843112071234" if kind == "v4l2" else "",
        pitch_deg=-12.5,
        position_m=(0.1, 0.0, -0.05),
        width_m=0.6,
        height_m=0.3,
        autopilot="serial:/dev/ttyAMA0:921600",
        send=True,
        calibration=CALIBRATION,
        calibration_file="/etc/osape-companion/SN1.conf",
    )
    (tmp_path / "a.toml").write_text(configuration_text(answers))
    config = load_config(tmp_path / "a.toml")
    (camera,) = config.cameras
    assert (camera.kind, camera.pitch_deg, camera.x_m, camera.z_m) == (kind, -12.5, 0.1, -0.05)
    assert (config.avoid.radius_m, config.avoid.send) == (0.3, True)
    assert (config.extractor.passable_width_m, config.extractor.passable_height_m) == (1.2, 0.6)
    if kind == "v4l2":
        assert (camera.fx_px, camera.cy_px) == (391.2, 238.7)
    assert camera.serial == ("843112071234" if kind == "v4l2" else "")
    assert main(["check-config", str(tmp_path / "a.toml")]) == 0


def test_without_intrinsics_the_file_names_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    out = tmp_path / "c.toml"
    assert (
        main(["setup", "--yes", "--camera", f"v4l2:/dev/v4l/by-id/{D435}", "--autopilot", "none", "-o", str(out)]) == 1
    )
    output = capsys.readouterr()
    assert "pip install 'pyrealsense2>=2.54'" in output.err
    assert "not complete yet" in output.out
    assert "fx_px" in out.read_text()


def test_flags_alone_are_enough(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "c.toml"
    arguments = [
        "setup",
        "--yes",
        "--camera",
        "oak",
        "--autopilot",
        "udpin:0.0.0.0:14540",
        "--pitch",
        "-20",
        "--no-doctor",
    ]
    assert main([*arguments, "--width", "0.8", "--height", "0.4", "--position", "0.1", "0", "0", "-o", str(out)]) == 0
    assert load_config(out).autopilot.address == "udpin:0.0.0.0:14540"
    assert main([*arguments, "-o", str(out)]) == 1
    assert "--replace" in capsys.readouterr().err


def test_the_calibration_is_named_by_its_absolute_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The service runs in another folder."""
    monkeypatch.chdir(tmp_path)
    Path("SN1.conf").write_text(ZED_CALIBRATION)
    arguments = ["--camera", "zed:/dev/video0", "--autopilot", "none", "--calibration", "SN1.conf", "--no-doctor"]
    assert main(["setup", "--yes", *arguments, "-o", "c.toml"]) == 0
    assert load_config(Path("c.toml")).cameras[0].calibration == str(tmp_path / "SN1.conf")


@pytest.mark.parametrize(
    ("arguments", "status", "cause"),
    [
        (["--camera", "kinect"], 2, "expected one of oak"),
        (["--camera", "oak", "--autopilot", "com3"], 2, "is not an address"),
        (["--camera", "oak", "--autopilot", "none", "--width", "0"], 2, "expected 0.05..10"),
        (
            ["--camera", "zed:/dev/video0", "--autopilot", "none", "--calibration", "SN1.conf"],
            1,
            "SN1.conf: no such file",
        ),
        (
            ["--camera", "zed:/dev/video0", "--autopilot", "none", "--calibration", str(ROOT / "README.md")],
            1,
            "README.md: not a ZED calibration (",
        ),
        (["--camera", "oak", "--autopilot", "none", "--calibration", "SN1.conf"], 2, "--calibration is for a zed"),
    ],
)
def test_wrong_flags_write_nothing(
    arguments: list[str], status: int, cause: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["setup", "--yes", "--no-doctor", "-o", str(tmp_path / "c.toml"), *arguments]) == status
    assert cause in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_questions_are_asked_where_flags_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = iter(["2", "down", "5 deg", "-15,5", "-15", "", "0.2", "0", "0", "0.9", "0.4"])
    monkeypatch.setattr(setup, "find_cameras", lambda: [FoundCamera("oak", "A", "OAK"), FoundCamera("oak", "B", "OAK")])
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: next(lines) + "\n"))
    out = tmp_path / "c.toml"
    assert main(["setup", "--autopilot", "none", "--no-doctor", "-o", str(out)]) == 0
    config = load_config(out)
    assert (config.cameras[0].device, config.cameras[0].pitch_deg, config.cameras[0].x_m) == ("B", -15.0, 0.2)
    assert config.avoid.radius_m == 0.45
    err = capsys.readouterr().err
    assert "'down': expected -90..90\n" in err
    assert "'5 deg': expected -90..90; write one number without a unit\n" in err
    assert "'-15,5': expected -90..90; write a decimal point\n" in err


def typed(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    """A terminal on which these lines are typed; the input ends after them."""
    rest = iter([f"{line}\n" for line in lines])
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: next(rest, "")))


def test_the_number_of_a_camera_is_a_whole_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """1.7 was the first camera."""
    typed(monkeypatch, "1.7", "2")
    monkeypatch.setattr(setup, "find_cameras", lambda: [FoundCamera("oak", "A", "OAK"), FoundCamera("oak", "B", "OAK")])
    options = ["--pitch", "0", "--yaw", "0", "--position", "0", "0", "0", "--width", "1", "--height", "1"]
    out = tmp_path / "c.toml"
    assert main(["setup", "--autopilot", "none", "--no-doctor", *options, "-o", str(out)]) == 0
    assert load_config(out).cameras[0].device == "B"
    assert "'1.7': expected 1..2; write a whole number\n" in capsys.readouterr().err


def test_the_end_of_the_input_is_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-D, or a connection that broke, accepted the defaults of all questions that were left."""
    typed(monkeypatch, "-15")
    assert main(["setup", "--camera", "oak", "--no-doctor", "-o", str(tmp_path / "c.toml")]) == 1
    assert "the input ended before all questions were answered; nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_is_reported_before_the_first_question(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was found after nine answers, which were lost."""
    typed(monkeypatch)
    assert main(["setup", "--camera", "oak", "-o", str(tmp_path / "none" / "c.toml")]) == 1
    output = capsys.readouterr()
    assert f"{tmp_path / 'none'} is not a folder; create it" in output.err
    assert output.out == ""


def test_an_address_that_cannot_be_used_is_asked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before, setup ended, and the eight answers before it were lost."""
    lines = iter(["-15", "", "", "", "", "0.9", "0.4", "foo", "/dev/ttyACM0", "serial:/dev/ttyACM0"])
    monkeypatch.setattr(setup, "find_autopilot", lambda addresses, print_line: None)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True, readline=lambda: next(lines) + "\n"))
    out = tmp_path / "c.toml"
    assert main(["setup", "--camera", "oak", "--no-doctor", "-o", str(out)]) == 0
    assert load_config(out).autopilot.address == "serial:/dev/ttyACM0"
    assert "did you mean serial:/dev/ttyACM0?" in capsys.readouterr().err


def test_answers_from_a_pipe_are_not_silently_ignored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: False))
    assert main(["setup", "--camera", "oak", "--autopilot", "none", "--no-doctor", "-o", str(tmp_path / "c.toml")]) == 0
    assert "the input is not a terminal" in capsys.readouterr().err


def test_the_next_step_without_an_autopilot_is_its_address(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`companion simulate-autopilot`, which was named, refuses a configuration without an address."""
    path = tmp_path / "my.toml"
    options = ["--yes", "--camera", "simulated", "--autopilot", "none", "--no-doctor"]
    assert main(["setup", "-o", str(path), *options]) == 0
    output = capsys.readouterr().out
    assert 'next: set [autopilot] address = "udpin:127.0.0.1:14540"' in output
    assert "companion run" not in output


@pytest.mark.parametrize(("healthy", "step"), [(True, "companion run -c {}, or"), (False, "correct each line with !")])
def test_the_next_step_after_a_fault_is_not_to_start_the_service(
    healthy: bool, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a camera that does not open it was `companion run`, or to install the service."""
    monkeypatch.setattr(setup, "examine", lambda config, patience_s: [])
    monkeypatch.setattr(setup, "print_findings", lambda findings: healthy)
    path = tmp_path / "my.toml"
    options = ["--yes", "--camera", "oak", "--autopilot", "udpin:127.0.0.1:14540"]
    assert main(["setup", "-o", str(path), *options]) == (0 if healthy else 1)
    assert f"next: {step.format(path)}" in capsys.readouterr().out


def test_a_simulated_camera_gets_the_simulated_autopilot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without an address the service was blind for ever."""
    out = tmp_path / "c.toml"
    assert main(["setup", "--yes", "--camera", "simulated", "--no-doctor", "-o", str(out)]) == 0
    assert load_config(out).autopilot.address == "udpin:127.0.0.1:14540"
    shipped = load_config(Path("configs/simulated.toml"))  # on a busy computer the flight is not rendered within 30 s
    assert load_config(out).supervision.open_s == shipped.supervision.open_s
    assert f"companion simulate-autopilot -c {out}" in capsys.readouterr().out


@pytest.mark.parametrize("received", [False, True])
def test_no_second_autopilot_is_proposed_where_one_is_received(
    received: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Beside a PX4 in simulation it was `companion simulate-autopilot`."""
    found = Finding("autopilot", received, "PX4, system 1, disarmed" if received else "no heartbeat")
    monkeypatch.setattr(setup, "examine", lambda config, patience_s: [found])
    main(["setup", "--yes", "--camera", "simulated", "-o", str(tmp_path / "c.toml")])
    step = capsys.readouterr().out.partition("next: ")[2]
    assert ("simulate-autopilot" in step) is not received
    assert ("fly-in-simulation" in step) is received


def test_configs_are_listed_and_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["configs"]) == 0
    listed = capsys.readouterr().out
    for name in ("oak", "zed", "v4l2", "simulated", "indoor"):
        assert f"\n{name} " in f"\n{listed}"
    assert main(["configs", "simulated"]) == 0
    assert load_config(tmp_path / "simulated.toml").cameras[0].kind == "simulated"
    assert main(["configs", "simulated"]) == 1
    assert main(["configs", "moon"]) == 2
    assert "no configuration 'moon'; there are default" in capsys.readouterr().err


def test_a_port_that_cannot_be_opened_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As without the permission to use it: only cable, power and baud rate were named as the cause."""
    monkeypatch.setattr(listen, "HEARTBEAT_S", 0.2)
    port, said = tmp_path / "ttyACM0", list[str]()
    assert listen.find_autopilot([f"serial:{port}:57600"], said.append) is None
    _, cause = said
    assert cause.startswith(f"serial:{port}:57600 is not open: ")
    assert cause.count(str(port)) == 1


def heard(*systems: tuple[int, str]) -> FoundAutopilot:
    """What is received on one line to which autopilots with these system ids and of these kinds send. The second one begins after the
    first heartbeat of the first, which is sent within a second."""
    port = free_port()
    with ExitStack() as stack:

        def begin(system: int, kind: str) -> None:
            profile = FirmwareProfile(kind=kind, system_id=system)
            stack.enter_context(AutopilotLink(SimulatedAutopilot(profile), UdpEnd("127.0.0.1", port)))

        begin(*systems[0])
        others = [threading.Timer(1.5, begin, system) for system in systems[1:]]
        for other in others:
            other.start()
        found = listen.autopilot_at(f"udpin:127.0.0.1:{port}", 2.5, print)
        for other in others:
            other.join()
    assert found is not None
    return found


@pytest.mark.process
def test_all_autopilots_on_a_line_are_found() -> None:
    """The first was taken, whichever that was."""
    assert dict(heard((3, PX4)).kinds) == {3: PX4}
    found = heard((3, PX4), (7, ARDUPILOT))
    assert dict(found.kinds) == {3: PX4, 7: ARDUPILOT}
    assert found.text == "PX4, system 3, ArduPilot, system 7"


@pytest.mark.parametrize(
    ("kinds", "typed_lines", "system_id", "is_warned"),
    [
        ({3: PX4}, (), 3, False),
        ({3: PX4, 7: ARDUPILOT}, ("7",), 7, False),
        ({3: PX4, 7: ARDUPILOT}, ("",), 0, True),
        ({3: PX4, 7: ARDUPILOT}, None, 0, True),
    ],
)
def test_the_system_id_is_written_where_it_is_known(
    kinds: dict[int, str],
    typed_lines: tuple[str, ...] | None,
    system_id: int,
    is_warned: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Without it the autopilot of another vehicle is taken for the own one where that is not received. typed_lines: None for --yes."""
    found = FoundAutopilot("udpin:0.0.0.0:14540", kinds)
    monkeypatch.setattr(setup, "find_autopilot", lambda addresses, print_line: found)
    typed(monkeypatch, *(typed_lines or ()))
    options = [
        "--pitch",
        "0",
        "--yaw",
        "0",
        "--position",
        "0",
        "0",
        "0",
        "--width",
        "1",
        "--height",
        "1",
        "--no-doctor",
    ]
    out = tmp_path / "c.toml"
    assert (
        main(["setup", "--camera", "oak", *options, *(["--yes"] if typed_lines is None else []), "-o", str(out)]) == 0
    )
    config = load_config(out).autopilot
    assert (config.address, config.system_id) == (found.address, system_id)
    output = capsys.readouterr()
    assert "PX4, system 3" in output.out
    assert ("system_id = 3: if this is another vehicle's autopilot" in output.out) is (len(kinds) == 1)
    assert ("set [autopilot] system_id to that of this vehicle" in output.err) is is_warned
