"""MAVLink signing in commands: the finding of the doctor, and the keys."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path

import pytest

from companion.autopilot.status_text import MOST_CHARACTERS
from companion.cli import main
from companion.doctor import doctor
from drivers.mavlink.signing import Signing, Verdict
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey, load_key
from drivers.simulation.autopilot import PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_parameters import PARAMETERS
from tests.ports import free_port

KEY = bytes(range(1, 33))


@pytest.mark.process
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
