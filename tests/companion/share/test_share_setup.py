"""The links of the configuration, and what the sharing exchanges with the autopilot."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq

from companion.config.loader import config_of
from companion.diagnostic import DiagnosticCode
from companion.doctor.share_check import share_findings
from companion.paths import Folders
from companion.share.autopilot_tunnel import AutopilotTunnel
from companion.share.share_service import REQUEST_AGAIN_NS, REQUEST_NS, ShareService
from companion.streams.publication import PublicationStamps
from core.types import PoseSample
from drivers.base import DriverError
from drivers.mavlink.address import parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import Vehicle
from drivers.sharing.tunnel import PAYLOAD_TYPE, TUNNEL_ID, tunnel_message
from drivers.sharing.tunnel_line import TunnelLine
from drivers.sharing.zenoh_link import ZenohLink
from osape_client.proto import osape_v1_pb2 as pb
from tests.ports import free_port
from tests.waiting import until

from .test_share_tunnel import frame_of

pytestmark = pytest.mark.process

NS = 1_000_000_000


class Posts(MavlinkLink):
    """A link that is not opened; what is posted is kept."""

    def __init__(self, session: MavlinkSession) -> None:
        super().__init__(parse_address("udpin:127.0.0.1:14599"), session, lambda samples: None)
        self.posted: list[Any] = []

    def post(self, message: Any) -> None:
        self.posted.append(message)


class Made:
    """A `ShareService` with the autopilot of vehicle 7, opened without links that reach anybody."""

    def __init__(self, folder: Path, share: dict[str, object], key: str = "") -> None:
        content: dict[str, dict[str, object]] = {
            "autopilot": {"address": "udpin:127.0.0.1:14599", "signing_key": key},
            "publish": {"world": "ipc://{run}/world", "world_requests": "ipc://{run}/snapshot", "neighbours": ""},
            "share": {"enabled": True, **share},
        }
        self.session = MavlinkSession()
        self.session.own.vehicle = Vehicle(7, "PX4", 2, True, 0, NS)
        self.link = Posts(self.session)
        self.recorded: list[str] = []
        self.service = ShareService(
            config_of(content, "test"),
            Folders(folder, folder),
            PublicationStamps("boot"),
            lambda key, message, t_ns: self.recorded.append(key),
        )
        self.service.connect(self.session, self.link)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()

    def __enter__(self) -> Made:
        self.service.open(self._context, None)
        return self

    def __exit__(self, *_: object) -> None:
        self.service.close()
        self.service.close()  # twice is allowed
        self._context.destroy(linger=0)

    def requests(self, *times_ns: int) -> list[int]:
        """The instants at which GPS_GLOBAL_ORIGIN is requested."""
        found = []
        for now_ns in times_ns:
            before = len(self.link.posted)
            self.service.tick(now_ns)
            found += [now_ns] * (len(self.link.posted) - before)
        return found


@pytest.fixture
def made(tmp_path: Path) -> Iterator[Made]:
    with Made(tmp_path, {"tunnel": "autopilot"}) as made:
        yield made


ORIGIN = dialect.MAVLink_gps_global_origin_message(470000000, 80000000, 400000)


def test_the_origin_is_requested_until_it_is_known_and_rarely_after_that(made: Made) -> None:
    assert made.requests(0, REQUEST_NS - 1, REQUEST_NS) == [0, REQUEST_NS]
    (request, _) = made.link.posted
    assert (request.target_system, request.command, request.param1) == (7, 512, 49)
    made.service.message(ORIGIN)
    assert made.requests(2 * REQUEST_NS, 3 * REQUEST_NS, 2 * REQUEST_NS + REQUEST_AGAIN_NS) == [
        2 * REQUEST_NS,
        2 * REQUEST_NS + REQUEST_AGAIN_NS,
    ]


def test_the_origin_is_not_requested_where_it_is_configured_or_there_is_no_autopilot(tmp_path: Path) -> None:
    with Made(tmp_path, {"tunnel": "autopilot", "origin": "47.0, 8.0, 400"}) as made:
        assert made.requests(0, 10 * NS) == []
    with Made(tmp_path, {"tunnel": "autopilot"}) as made:
        made.session.own.vehicle = None
        assert made.requests(0, 10 * NS) == []
        made.service.connect(None, None)
        assert made.requests(20 * NS) == []


def test_messages_of_the_autopilot_give_the_frame_on_earth(made: Made) -> None:
    sharing = made.service.sharing
    assert sharing is not None
    made.service.message(dialect.MAVLink_statustext_message(6, b"another message"))
    now_ns = time.monotonic_ns()
    made.service.samples([PoseSample(now_ns, now_ns, (1.0, 2.0, -3.0), (0.0, 0.0, 0.0))])
    report = pb.Health()
    end_s = time.monotonic() + 30.0
    made.service.message(ORIGIN)
    while not report.team.frame_known and time.monotonic() < end_s:
        time.sleep(0.02)
        made.service.fill(report)
    assert report.team.frame_known
    assert report.team.vehicle == 7


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_the_health_report_has_no_state_of_the_team_that_may_be_old(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A neighbour received 0.1 s before the thread ended would be reported so for ever."""

    def known(t_ns: int) -> bool:
        report = pb.Health(t_ns=t_ns)
        made.service.fill(report)
        return len(report.team.links) == 1

    assert made.service.sharing is not None
    assert until(lambda: known(time.monotonic_ns()))
    assert not known(time.monotonic_ns() + 60 * NS), "it does not respond"
    monkeypatch.setattr(made.service.sharing, "step", lambda now_ns: 1 // 0)
    assert until(lambda: not known(time.monotonic_ns()))


def test_packets_of_other_vehicles_over_the_link_of_the_autopilot_are_delivered(made: Made) -> None:
    sharing = made.service.sharing
    assert sharing is not None
    (tunnel,) = sharing.links
    assert isinstance(tunnel, AutopilotTunnel)
    assert tunnel.packet_bytes == 128
    made.service.foreign(frame_of(tunnel_message(b"not a packet"), 9), time.monotonic_ns())
    other = dialect.MAVLink_tunnel_message(0, 0, PAYLOAD_TYPE + 1, 3, bytes(128))
    made.service.foreign(frame_of(other, 9), time.monotonic_ns())
    assert tunnel.refused == {"other_payload": 1}
    report, end_s = pb.Health(), time.monotonic() + 30.0
    while "other_version" not in report.team.received and time.monotonic() < end_s:
        time.sleep(0.02)
        made.service.fill(report)
    assert dict(report.team.received) == {"other_payload": 1, "other_version": 1}, "the decoder got the first one"
    assert {TUNNEL_ID} == ShareService.foreign_reads
    assert {49} == ShareService.reads


def test_each_configured_link_is_made(tmp_path: Path) -> None:
    pytest.importorskip("zenoh")
    zenoh = tmp_path / "zenoh.json5"
    zenoh.write_text("{mode: 'peer', scouting: {multicast: {enabled: false}}}")
    with Made(tmp_path, {"tunnel": "udpin:127.0.0.1:14598", "zenoh": str(zenoh)}) as made:
        assert made.service.sharing is not None
        assert [type(link) for link in made.service.sharing.links] == [TunnelLine, ZenohLink]
        made.service.foreign(frame_of(tunnel_message(b"x"), 9), 0)  # there is no tunnel over the autopilot's link


def test_a_line_of_its_own_is_signed_with_the_key_of_the_autopilot(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("5a" * 32)
    key.chmod(0o600)
    sizes = []
    for name in ("", str(key)):
        with Made(tmp_path, {"tunnel": "udpin:127.0.0.1:14597"}, name) as made:
            assert made.service.sharing is not None
            (link,) = made.service.sharing.links
            sizes.append(link.overhead_bytes)
    assert sizes[1] - sizes[0] == 13, "a signature"
    with pytest.raises(DriverError):
        Made(tmp_path, {"tunnel": "udpin:127.0.0.1:14597"}, str(tmp_path / "missing"))


def test_before_it_is_opened_nothing_is_done(tmp_path: Path) -> None:
    made = Made(tmp_path, {"tunnel": "autopilot"})
    made.service.message(ORIGIN)
    made.service.samples([])
    made.service.foreign(frame_of(tunnel_message(b"x"), 9), 0)
    report = pb.Health()
    made.service.fill(report)
    assert not report.HasField("team")
    assert made.service.diagnostics(NS) == []
    made.service.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("how", ["ended", "cannot write"])
def test_timestamps_of_signatures_that_are_not_saved_are_reported(tmp_path: Path, how: str) -> None:
    """Only those of the link to the autopilot were: the thread of a line of its own ended without a word."""
    key = tmp_path / "key"
    key.write_bytes(bytes(range(1, 33)))
    key.chmod(0o600)
    with Made(tmp_path, {"tunnel": f"udpin:127.0.0.1:{free_port()}"}, key=str(key)) as made:

        def texts() -> list[str]:
            found = made.service.diagnostics(time.monotonic_ns())
            return [d.text for d in found if d.code is DiagnosticCode.SIGNATURE_CLOCK_FAULT]

        clock = made.service._signing._clock
        assert texts() == []

        def broken(_: Path) -> None:
            if how == "ended":
                raise RuntimeError("injected")
            clock.fault = "the timestamps of signatures cannot be kept"

        clock._reserve = broken  # type: ignore[method-assign]
        clock._wanted.set()
        assert until(lambda: bool(texts()), 60.0)
        expected = "are not saved (RuntimeError: injected)" if how == "ended" else "cannot be kept"
        assert texts()[0].startswith("line to other vehicles: ")
        assert expected in texts()[0]


@pytest.mark.parametrize(
    ("tunnel", "system_id", "found"),
    [("autopilot", 0, True), ("autopilot", 7, False), ("serial:/dev/radio:57600", 0, False)],
)
def test_the_doctor_asks_for_the_system_id_where_other_vehicles_are_received(
    tunnel: str, system_id: int, found: bool
) -> None:
    content = {
        "autopilot": {"address": "udpin:127.0.0.1:14599", "system_id": system_id},
        "publish": {"world": "ipc://{run}/world", "world_requests": "ipc://{run}/snapshot"},
        "share": {"enabled": True, "tunnel": tunnel},
    }
    codes = [finding.code for finding in share_findings(config_of(content, "test"))]
    assert (DiagnosticCode.SEVERAL_VEHICLES in codes) == found
