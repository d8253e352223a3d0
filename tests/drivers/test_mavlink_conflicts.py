"""Other senders on the link: a second companion, forged ids of the autopilot or the companion, random datagrams."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from drivers.mavlink.address import Address, parse_address
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.conflicts import RECENT_NS, ConflictDetector
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import MavlinkParams
from drivers.mavlink.udp_line import UdpLine
from drivers.sharing.tunnel import tunnel_message
from drivers.simulation.autopilot import ARDUPILOT, PX4, SimulatedAutopilot
from drivers.simulation.autopilot_link import AutopilotLink, UdpEnd
from drivers.simulation.firmware_profile import FirmwareProfile
from tests.ports import free_port
from tests.waiting import until

from .conversation import NS, Conversation, talk
from .linked import linked

pytestmark = pytest.mark.process


def frame(m: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(m.pack(dialect.MAVLink(None, system, component)))


def heartbeat(autopilot: int) -> Any:
    return dialect.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3)


def obstacles(cm: int = 1201) -> Any:
    return dialect.MAVLink_obstacle_distance_message(0, 4, [cm] * 72, 5, 20, 1200, 5.0, 0.0, 12)


def conflicts(c: Conversation) -> dict[str, str]:
    return c.session.status(c.now_ns).conflicts


def hear(c: Conversation, data: bytes) -> None:
    c.session.receive([(data, c.now_ns)])


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_second_companion_that_reports_obstacles_is_named(kind: str) -> None:
    c = talk(kind)
    c.run(2.0)
    assert conflicts(c) == {}
    hear(c, frame(obstacles(), component=197))
    assert "component 197 sends obstacles too" in conflicts(c)["two companions"]
    c.run(9.0)  # the text does not come and go with rare messages
    assert list(conflicts(c)) == ["two companions"]
    c.run(RECENT_NS / NS - 8.9)
    assert conflicts(c) == {}


def test_the_autopilots_own_map_and_other_components_are_none() -> None:
    c = talk(PX4)
    c.run(2.0)
    hear(c, frame(obstacles(), component=1))
    hear(c, frame(heartbeat(8), component=197))  # a gimbal, a camera: anybody may be there
    hear(c, frame(heartbeat(8), system=9, component=196))  # the companion of another vehicle
    assert conflicts(c) == {}


def test_a_packet_to_other_vehicles_that_a_router_brings_back_is_no_second_service() -> None:
    """Sent on the line of [share] tunnel, with the ids of this service. The guard sent no commands."""
    c = talk(PX4)
    c.run(2.0)
    hear(c, frame(tunnel_message(b"packet"), component=196))
    assert conflicts(c) == {}
    hear(c, frame(heartbeat(8), component=196))
    assert "two services" in conflicts(c)


@pytest.mark.parametrize(
    ("kind", "orientation", "named"),
    [
        *((kind, orientation, True) for kind in (PX4, ARDUPILOT) for orientation in (0, 7)),
        *((kind, orientation, False) for kind in (PX4, ARDUPILOT) for orientation in (24, 25)),
        *((PX4, orientation, True) for orientation in (8, 39, 100)),  # 100: direction by a quaternion
        *((ARDUPILOT, orientation, False) for orientation in (8, 39, 100)),
    ],
)
@pytest.mark.parametrize("mavlink_1", [False, True])
def test_a_range_finder_that_looks_around_is_named(kind: str, orientation: int, named: bool, mavlink_1: bool) -> None:
    """Its distances replace those of the service; one that looks down has nothing to do with them.

    PX4 uses all that look neither up nor down (CollisionPrevention::_updateObstacleMap), ArduPilot those around the
    vehicle (AP_Proximity_MAV::handle_distance_sensor_msg)."""
    c = talk(kind)
    c.run(2.0)
    m = dialect.MAVLink_distance_sensor_message(0, 20, 1200, 500, 0, 1, orientation, 0)
    encoder = dialect.MAVLink(None, 1, 197)
    hear(c, bytes(m.pack(encoder, force_mavlink1=mavlink_1)))
    assert ("two companions" in conflicts(c)) is named


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize(("system", "component"), [(255, 0), (9, 196), (9, 197), (9, 1)])
def test_obstacles_of_another_system_are_named_because_autopilots_take_them(
    kind: str, system: int, component: int
) -> None:
    """255 is the default of many scripts. They were taken for those of another vehicle."""
    c = talk(kind, MavlinkParams(system_id=1))
    c.run(2.0)
    hear(c, frame(obstacles(), system=system, component=component))
    assert list(conflicts(c)) == ["two companions"]
    assert f"system {system} sends obstacles too" in conflicts(c)["two companions"]
    c.run(RECENT_NS / NS + 0.1)
    assert conflicts(c) == {}


def test_a_sender_with_our_ids_is_reported_and_our_own_messages_echoed_are_not() -> None:
    c = talk(ARDUPILOT)
    c.run(2.0)
    for data in c.sent[-50:]:
        hear(c, data)
    assert conflicts(c) == {}
    twin = MavlinkSession()
    twin.receive([(frame(heartbeat(3)), c.now_ns)])
    for data in twin.due(c.now_ns):
        hear(c, data)
    assert "another sender uses component 196" in conflicts(c)["two services"]


@pytest.mark.parametrize(("true", "forged"), [(PX4, 3), (ARDUPILOT, 12)])
def test_heartbeats_that_contradict_each_other_make_an_autopilot_of_no_known_kind(true: str, forged: int) -> None:
    """The messages are safe for both kinds: the policy depends on the kind."""
    c = talk(true)
    c.run(2.0)
    for _ in range(5):
        hear(c, frame(heartbeat(forged)))
        assert c.session.vehicle is not None
        assert c.session.vehicle.autopilot == "ArduPilot or PX4"
        c.run(1.0)
        assert c.session.vehicle.autopilot == "ArduPilot or PX4"
    assert conflicts(c)["two autopilots"].startswith("contradictory heartbeats: ")
    assert c.session.status(c.now_ns).clock_restarts == 0
    c.run(RECENT_NS / NS + 2.0)
    assert c.session.vehicle.autopilot == true
    assert conflicts(c) == {}


@pytest.mark.parametrize("started_s", [-200, 20])
def test_a_second_vehicle_with_the_same_ids_moves_no_clock_and_is_named(started_s: int) -> None:
    """started_s: of its autopilot, after ours. It does not answer; two that answer: test_two_vehicles.py."""
    c = talk(PX4, boot_at_ns=50 * NS)
    other = FirmwareProfile(kind=PX4, boot_at_ns=(50 + started_s) * NS, answers_timesync=False)
    c.autopilots.append(SimulatedAutopilot(other))
    c.run(8.0)
    status = c.session.status(c.now_ns)
    assert status.clock.source is ClockSource.TIMESYNC
    assert status.clock.local_ns(58 * NS) == pytest.approx(108 * NS, abs=5_000_000)
    assert "contradictory autopilot timestamps" in status.conflicts["two clocks"]


def test_an_autopilot_that_the_configuration_leaves_out_is_named() -> None:
    c = talk(PX4, MavlinkParams(system_id=3))
    c.run(2.0)
    assert c.session.vehicle is None
    assert "[autopilot] system_id = 3 leaves it out" in conflicts(c)["system id"]


def test_answers_to_timesync_that_mirror_nothing_we_asked_leave_the_clock() -> None:
    c = talk(PX4, boot_at_ns=0)
    c.run(3.0)
    before = c.session.status(c.now_ns).clock
    for k in range(2000):
        hear(c, frame(dialect.MAVLink_timesync_message(10**15 + k, c.now_ns - k * 1000)))
    c.run(1.0)
    status = c.session.status(c.now_ns)
    assert abs(status.clock.offset_ns - before.offset_ns) < 1_000_000
    assert status.clock_restarts == 0
    assert status.counts["timesync_unpaired"] > 1900


def test_invented_ids_do_not_fill_the_memory() -> None:
    s = ConflictDetector(196)
    for component in range(2, 256):
        (m,) = MessageSplitter().frames(frame(obstacles(), component=component))
        s.received(m, 1, NS)
        s.left_out(component, NS)
    assert len(s._rivals) == len(s._left_out) == 16


def test_messages_go_to_the_autopilot_and_not_to_the_newest_sender() -> None:
    line = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as true,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        for end in (true, other):
            end.bind(("127.0.0.1", 0))
            end.settimeout(60.0)
        true.sendto(b"true", ("127.0.0.1", line.port))
        chunks = line.read(5.0)
        line.answer([data for data, _ in chunks].index(b"true"))
        other.sendto(b"other", ("127.0.0.1", line.port))
        assert [data for data, _ in line.read(5.0)] == [b"other"]
        line.write(b"obstacles")
        assert true.recv(100) == b"obstacles"
    line.close()


def test_a_heartbeat_behind_a_flood_is_read_from_the_line() -> None:
    line = UdpLine(Address("udpin", "127.0.0.1", free_port()))
    attitude = frame(dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0), system=2)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        own.sendto(frame(heartbeat(12)), ("127.0.0.1", line.port))
        assert line.read(5.0)
        line.answer(0)
        for data in (*[attitude] * 200, frame(heartbeat(12), system=2)):
            other.sendto(data, ("127.0.0.1", line.port))
        read = [data for data, _ in line.read(5.0)]
        assert len(read) < 200
        assert read[-1] == frame(heartbeat(12), system=2)
    line.close()


def test_half_a_message_of_one_holds_back_none_of_another() -> None:
    session = MavlinkSession()
    there, anybody = ("10.0.0.1", 1), ("10.0.0.2", 2)
    chunks = [(b"\xfd\xff\x00\x00", NS), (frame(heartbeat(3)), NS + 1), (b"\xfd", NS + 2)]
    session.receive(chunks, [anybody, there, anybody])
    assert session.vehicle is not None
    assert session.last_chunk == 1
    session.receive([(b"\xfd", NS)] * 100, [("10.0.0.3", port) for port in range(100)])
    assert len(session._splitters) == 16
    cut = frame(heartbeat(3))
    session.receive([(cut[:9], NS + 3), (cut[9:], NS + 4)], [there, there])
    assert session.last_chunk == 1


def test_datagrams_of_other_senders_do_not_redirect_messages_to_the_autopilot() -> None:
    port = free_port()
    with (
        AutopilotLink(SimulatedAutopilot(FirmwareProfile(kind=ARDUPILOT)), UdpEnd("127.0.0.1", port)) as autopilot,
        linked(parse_address(f"udpin:127.0.0.1:{port}")) as (link, _),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as anybody,
    ):
        assert until(lambda: link.status().vehicle is not None)
        noise = [b"\xfd\xff\x00hello", frame(heartbeat(3), system=7), frame(obstacles(), component=197)]
        for k in range(60):
            for data in noise:
                anybody.sendto(data, ("127.0.0.1", port))
            link.post(dialect.MAVLink_statustext_message(6, f"{k}".encode()))
            assert until(
                lambda k=k: autopilot.change(lambda a: [m.text for m in a.of_kind("STATUSTEXT")][-1:]) == [f"{k}"]
            )
        assert "two companions" in link.status().conflicts
