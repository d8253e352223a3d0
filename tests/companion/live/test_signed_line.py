"""MAVLink signing from end to end: the service as a process, the autopilot over UDP."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.simulation.autopilot import ARDUPILOT, PX4
from drivers.simulation.autopilot_link import AutopilotLink
from drivers.simulation.firmware_parameters import PARAMETERS
from osape_client.proto import osape_v1_pb2 as pb
from tests.waiting import PATIENCE_S, until

from ..live_service import Live, flown
from .test_service_avoids import CONFIG, AvoidingService

pytestmark = [pytest.mark.process, pytest.mark.realtime]

KEY = bytes(range(1, 33))


@pytest.fixture(scope="module")
def avoiding(tmp_path_factory: pytest.TempPathFactory, renders: Path) -> Iterator[AvoidingService]:
    """A service and its autopilot with the same key; the autopilot has no clock. Nothing of signing depends on its kind."""
    folder = tmp_path_factory.mktemp("signed")
    key = folder / "signing.key"
    key.write_bytes(KEY)
    key.chmod(0o600)
    live = Live(folder, CONFIG.replace("[avoid]", f'signing_key = "{key}"\n\n[avoid]'), renders, quick=True)
    with flown(live, ARDUPILOT) as line:
        line.change(lambda a: (a.sign(KEY), a.parameters.update(PARAMETERS[ARDUPILOT])))
        try:
            live.start()
            yield AvoidingService(live, line, ARDUPILOT)
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
    live = Live(tmp_path, CONFIG, renders, quick=True)
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
