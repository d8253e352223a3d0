"""MAVLink signing from end to end: the service as a process, the autopilot over UDP, and the commands for keys."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.autopilot.status_text import MOST_CHARACTERS
from companion.cli import main
from companion.doctor import doctor
from drivers.mavlink.signing import Signing, Verdict
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey, load_key
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port
from tests.waiting import PATIENCE_S, until

from ..live_service import Live, flown
from .test_service_avoids import CONFIG, AvoidingService

pytestmark = [pytest.mark.process, pytest.mark.realtime]

KEY = bytes(range(1, 33))


@pytest.fixture(scope="module", params=[PX4, ARDUPILOT])
def avoiding(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, renders: Path
) -> Iterator[AvoidingService]:
    """A service and its autopilot with the same key; the autopilot has no clock."""
    folder = tmp_path_factory.mktemp("signed")
    key = folder / "signing.key"
    key.write_bytes(KEY)
    key.chmod(0o600)
    live = Live(folder, CONFIG.replace("[avoid]", f'signing_key = "{key}"\n\n[avoid]'), renders)
    with flown(live, request.param) as line:
        line.change(lambda a: (a.sign(KEY), a.parameters.update(PARAMETERS[request.param])))
        try:
            live.start()
            yield AvoidingService(live, line, request.param)
            assert live.stop() == 0
            assert KEY.hex() not in live.output()
        finally:
            live.close()


def sign(line: AutopilotLink, key: bytes | None) -> None:
    line.change(lambda a: a.sign(key))


def test_obstacles_are_sent_signed_and_an_autopilot_that_stops_signing_is_reported(avoiding: AvoidingService) -> None:
    assert until(avoiding.has_obstacles)
    avoiding.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)
    assert avoiding.line.change(lambda a: a.dropped) == []
    sign(avoiding.line, None)
    avoiding.health.wait(lambda h: any("does not sign, but a key is set" in t for t in h.troubles), PATIENCE_S)
    assert until(lambda: "OA: the autopilot does not sign, but a key is set" in avoiding.texts())
    silent_from = len(avoiding.messages())
    # without an attitude it sees nothing
    health = avoiding.health.wait(lambda h: h.state == pb.Health.STATE_BLIND, PATIENCE_S)
    assert health.autopilot.counts["unsigned"] > 0
    assert len(avoiding.messages()) == silent_from
    sign(avoiding.line, bytes(reversed(KEY)))
    avoiding.health.wait(lambda h: any("signs with another key" in t for t in h.troubles), PATIENCE_S)
    sign(avoiding.line, KEY)
    avoiding.health.wait(lambda h: h.state == pb.Health.STATE_ACTIVE and not h.troubles, PATIENCE_S)
    assert until(lambda: any(t.startswith("OA: cleared: the autopilot") for t in avoiding.texts()))
    assert until(lambda: len(avoiding.messages()) > silent_from)


def test_after_kill_9_the_signature_timestamps_increase(avoiding: AvoidingService) -> None:
    """The autopilot drops a message whose timestamp is older than the newest one."""
    assert until(avoiding.has_obstacles)
    avoiding.live.kill()
    before, dropped = len(avoiding.messages()), avoiding.line.change(lambda a: len(a.dropped))
    assert until(lambda: (avoiding.live.folder / "state" / "signing-clock").exists())
    avoiding.live.start()
    assert until(lambda: len(avoiding.messages()) > before + 30)
    assert avoiding.line.change(lambda a: len(a.dropped)) == dropped


def test_without_the_key_it_is_reported_that_the_autopilot_drops_messages(tmp_path: Path, renders: Path) -> None:
    live = Live(tmp_path, CONFIG, renders)
    with flown(live, PX4) as line:
        sign(line, KEY)
        avoiding = AvoidingService(live, line, PX4)
        try:
            live.start()
            fault = "signs and no key is configured: it drops all messages"
            avoiding.health.wait(lambda h: any(fault in t for t in h.troubles), PATIENCE_S)
            assert avoiding.messages() == []
            assert line.change(lambda a: len(a.of_kind("HEARTBEAT"))) > 0  # which it accepts unsigned
            text = "OA: the autopilot signs and no key is configured"
            assert until(lambda: text in [m.text for m in line.change(lambda a: a.dropped) if m.get_msgId() == 253])
            assert live.stop() == 0
        finally:
            live.close()


def test_a_key_that_others_can_read_stops_the_start(tmp_path: Path, renders: Path) -> None:
    key = tmp_path / "signing.key"
    key.write_bytes(KEY)
    key.chmod(0o644)
    live = Live(tmp_path, CONFIG.replace("[avoid]", f'signing_key = "{key}"\n\n[avoid]'), renders)
    live.start()
    try:
        assert live.process is not None
        assert live.process.wait(PATIENCE_S) == 1
        assert "others can read it (mode 644)" in live.output()
    finally:
        live.close()


@pytest.mark.parametrize(
    ("ours", "theirs", "good", "text"),
    [
        (KEY, KEY, True, "both ends sign"),
        (None, KEY, False, "no key is configured"),
        (KEY, None, False, "does not sign"),
        (KEY, bytes(32 * [7]), False, "another key"),
    ],
)
def test_the_doctor_reports_the_state_of_signing(
    ours: bytes | None,
    theirs: bytes | None,
    good: bool,
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    signing = ""
    if ours is not None:
        key = tmp_path / "signing.key"
        key.write_text(ours.hex())
        key.chmod(0o600)
        signing = f'signing_key = "{key}"'
    for name in ("STATE_DIRECTORY", "RUNTIME_DIRECTORY"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.setattr(doctor, "computer_findings", lambda config: iter(()))
    port, config = free_port(), tmp_path / "doctor.toml"
    config.write_text(
        f'[autopilot]\naddress = "udpin:127.0.0.1:{port}"\n{signing}\n[publish]\nhealth = ""\n[record]\nrecord = "off"\n'
    )
    with AutopilotLink(SimulatedAutopilot(), UdpEnd("127.0.0.1", port)) as line:
        line.change(lambda a: (a.sign(theirs), a.parameters.update(PARAMETERS[PX4])))
        # with different keys the clocks are never synchronised, and the command takes all of its time
        main(["doctor", "-c", str(config), "--json", "--patience", "60" if good else "5"])
    findings = [f for f in json.loads(capsys.readouterr().out)["findings"] if f["part"] == "signing"]
    assert len(findings) == 1
    assert findings[0]["ok"] == good
    assert text in findings[0]["text"]


def test_keys_of_signatures_by_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "signing.key"
    assert main(["keys", "--signing", str(file)]) == 0
    findings = capsys.readouterr().out
    assert f'signing_key = "{file}"' in findings
    assert load_key(file).secret.hex() not in findings
    monkeypatch.setattr("sys.stdin", io.StringIO("open sesame\n"))
    assert main(["keys", "--signing", str(tmp_path / "phrase"), "--passphrase"]) == 0
    assert load_key(tmp_path / "phrase").secret == hashlib.sha256(b"open sesame").digest()
    assert main(["keys", "--signing", str(file)]) == 1
    assert main(["keys"]) == 2


def test_texts_on_signatures_fit_a_statustext_up_to_their_colon() -> None:
    for key in (SigningKey(KEY), None):
        for verdict in Verdict:
            s = Signing(key, SigningClock(None, lambda: 1_800_000_000 * 10**9))
            s._autopilot_ns[verdict] = 10**9
            for answered in (True, False):
                text = s.fault(2 * 10**9, answered=answered)
                assert len("OA: " + text.split(":")[0]) <= MOST_CHARACTERS
