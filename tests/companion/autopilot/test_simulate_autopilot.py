"""`companion simulate-autopilot` as a process, on UDP and on a pty, received by a real link."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.autopilot.firmware_version import FirmwareVersion
from companion.autopilot.parameter_advice import parameter_faults
from companion.autopilot.parameter_fault import AutopilotFacts
from companion.autopilot.parameters import WANTED, value_of
from companion.autopilot.simulate_autopilot import flight_of, other_end
from companion.cli import main
from companion.config.avoidance import AvoidParams
from companion.config.camera import CameraConfig
from companion.config.loader import Config, load_config
from core.frames import rotation_from_quaternion
from core.types import AttitudeSample, PoseSample
from drivers.mavlink.address import parse_address
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import ARDUPILOT, PX4
from drivers.simulation.autopilot_link import UdpEnd
from tests.ports import free_port

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[3]


def config_file(folder: Path, address: str = "") -> Path:
    file = folder / "simulated.toml"
    line = f'[autopilot]\naddress = "{address}"\n' if address else ""
    file.write_text(f'[[camera]]\nname = "front"\nkind = "simulated"\nflight = "tilted"\n{line}')
    return file


@contextmanager
def flying(*words: str) -> Iterator[dict[str, str]]:
    """The command as a process; returns its JSON output."""
    command = [sys.executable, "-m", "companion", "simulate-autopilot", "--json", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            text = ""
            while not text.rstrip().endswith("}"):
                line = process.stdout.readline()
                assert line, "the command ended"
                text += line
            yield {"pid": str(process.pid), **json.loads(text)}
            assert process.poll() is None
            process.send_signal(signal.SIGTERM)
            assert process.wait(60.0) == 0
        finally:
            process.kill()


class Receiver:
    """A link to the autopilot, until enough was heard and its clock is known."""

    def __init__(self, address: str, samples: int = 150) -> None:
        self.samples: list[AttitudeSample | PoseSample] = []
        session = MavlinkSession()
        link = MavlinkLink(parse_address(address), session, self.samples.extend)
        link.open()
        end_s = time.monotonic() + 60.0
        while time.monotonic() < end_s and not self._enough(session, samples):
            time.sleep(0.02)
        self.status = link.status()
        link.close()

    def _enough(self, session: MavlinkSession, samples: int) -> bool:
        return session.clock.estimate.source is ClockSource.TIMESYNC and len(self.samples) > samples

    def attitudes(self) -> list[AttitudeSample]:
        return [s for s in self.samples if isinstance(s, AttitudeSample)]


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_its_attitude_is_that_of_the_flight_on_the_clock_that_cameras_have(tmp_path: Path, kind: str) -> None:
    """Within 0.3 degrees: the stamps are whole milliseconds, and the flight turns at up to 80 degrees a second."""
    address = f"udpin:127.0.0.1:{free_port()}"
    config = config_file(tmp_path, address)
    flight = flight_of(load_config(config))
    with flying("-c", str(config), f"--{kind}", "--armed") as output:
        receiver = Receiver(address)
    assert output["flight"] == "tilted"
    assert receiver.status.vehicle is not None
    assert receiver.status.vehicle.armed
    assert receiver.status.vehicle.autopilot.lower() == kind
    errors_deg = []
    for a in receiver.attitudes()[-100:]:
        turn = rotation_from_quaternion(a.q_ned_frd_wxyz).T @ flight.state(a.t_ns).R_ned_frd
        errors_deg.append(np.degrees(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))
    assert len(errors_deg) == 100
    assert max(errors_deg) < 0.3


@pytest.mark.parametrize(("option", "kind"), [("--px4", PX4), ("--ardupilot", ARDUPILOT)])
def test_it_answers_for_each_parameter_and_brakes_with_them(tmp_path: Path, option: str, kind: str) -> None:
    """`companion doctor` printed for each of them that the autopilot did not answer."""
    values: dict[str, float] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as service:
        service.bind(("127.0.0.1", 0))
        service.settimeout(60.0)
        line = f"udpout:127.0.0.1:{service.getsockname()[1]}"
        with flying("-c", str(config_file(tmp_path)), "--address", line, option):
            mavlink = dialect.MAVLink(None, srcSystem=1, srcComponent=196)
            place = service.recvfrom(300)[1]
            for name in WANTED[kind]:
                request = dialect.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
                service.sendto(request.pack(mavlink), place)
            end_s = time.monotonic() + 60.0
            while values.keys() < set(WANTED[kind]) and time.monotonic() < end_s:
                for message in mavlink.parse_buffer(service.recv(300)) or ():
                    if message.get_type() == "PARAM_VALUE":
                        values[message.param_id] = value_of(message, kind)
    assert values.keys() == set(WANTED[kind])
    facts = AutopilotFacts(kind=kind, values=values, version=FirmwareVersion(1, 16, 0))
    assert parameter_faults(facts, AvoidParams(send=True)) == []
    assert len(parameter_faults(replace(facts, values=dict.fromkeys(values, 99.0)), AvoidParams(send=True))) > 2


def test_on_a_pty_with_a_name_of_its_own(tmp_path: Path) -> None:
    link = tmp_path / "autopilot"
    with flying("-c", str(config_file(tmp_path)), "--address", f"pty:{link}") as output:
        assert output["line"] == str(link)
        receiver = Receiver(f"serial:{link}", samples=30)
        assert receiver.status.vehicle is not None
        assert receiver.status.vehicle.autopilot == "PX4"
        assert len(receiver.attitudes()) > 5
    assert not os.path.lexists(link)


def test_it_is_refused_beside_the_service(tmp_path: Path) -> None:
    with flying("-c", str(config_file(tmp_path)), "--address", "pty") as output:
        threads = [int(name) for name in os.listdir(f"/proc/{output['pid']}/task")]
        assert len(threads) > 1  # the line's own
        assert {os.sched_getscheduler(thread) for thread in threads} == {os.SCHED_BATCH}


def test_the_other_end_of_a_line_on_ipv6() -> None:
    with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as service:
        service.bind(("::1", 0))
        service.settimeout(60.0)
        end = other_end(f"udpin:[::]:{service.getsockname()[1]}")
        end.write(b"heartbeat")
        assert service.recv(100) == b"heartbeat"
        end.close()


def test_a_host_that_is_not_known_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its thread ended with a traceback, and the command went on without sending anything."""
    words = ["simulate-autopilot", "-c", str(tmp_path / "c.toml"), "--address", "udpout:256.1.1.1:14540"]
    assert main(words) == 2
    assert "256.1.1.1: not known" in capsys.readouterr().err


def test_a_name_of_the_pty_that_is_taken_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The message named /dev/pts/N, which exists."""
    config, taken = tmp_path / "c.toml", tmp_path / "taken"
    config.write_text('[[camera]]\nname = "front"\nkind = "simulated"\n')
    taken.write_text("mine")
    assert main(["simulate-autopilot", "-c", str(config), "--address", f"pty:{taken}"]) == 1
    assert f"{taken}: File exists" in capsys.readouterr().err
    assert taken.read_text() == "mine"


def test_a_network_that_is_not_there_does_not_end_it() -> None:
    """The messages are lost, as on a real link; the thread ended at the first of them."""
    end = UdpEnd("203.0.113.1", 14540)
    try:
        end.write(bytes(70_000))  # no network takes a message of this size
    finally:
        end.close()


def test_without_a_flight_or_a_line_it_names_the_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match=r"no camera of kind = .simulated"):
        flight_of(Config(cameras=(CameraConfig(name="front", kind="oak"),)))
    with pytest.raises(ValueError, match="let the service listen"):
        other_end("serial:/dev/ttyACM0:57600")
    with pytest.raises(ValueError, match="expected serial:"):
        other_end("nonsense")
    assert main(["simulate-autopilot", "-c", str(config_file(tmp_path))]) == 1
    assert "[autopilot] address; give --address udpout:HOST:PORT" in capsys.readouterr().err
