"""The thread that shares obstacles, called step by step: what it records, confirms and refuses."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import companion.share.sharing_thread as thread_module
from companion.config.share import ShareConfig
from companion.pipeline.tracking import TracksResult
from companion.share.output import MOST_LOGGED_PER_S, SharingOutput
from companion.share.own_motion import OwnMotion
from companion.share.own_planes import OwnPlanes
from companion.share.sharing_thread import SAME_NUMBER_NS, OwnVehicle, Sharing
from companion.streams.publication import PublicationStamps
from core.frames import quaternion_from_euler
from core.sharing.neighbour_map import NeighbourMap, OwnState
from core.sharing.obstacles import MoverKind
from core.sharing.packet_codec import state_packet
from core.sharing.records import Header, LocalFrame, SharedPlanes, VehicleState
from core.tracking.snapshot import MovingObject, TrackSnapshot
from core.types import AttitudeSample, PoseSample
from core.world.world import World
from drivers.sharing.link import ReceivedPacket

NS = 1_000_000_000
STATE = VehicleState(
    frame=LocalFrame(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0),
    position_m=(0.0, 0.0, -3.0),
    velocity_m_s=(0.0, 0.0, 0.0),
    radius_m=0.4,
)


class MemoryLink:
    """A link that delivers what a test gives it."""

    name, overhead_bytes, packet_bytes, fault = "tunnel", 30, 128, ""

    def __init__(self, deliver: Callable[[ReceivedPacket], None]) -> None:
        self.deliver = deliver
        self.confirmed: list[ReceivedPacket] = []
        self.sent: list[bytes] = []
        self.refused: dict[str, int] = {}

    def open(self) -> None:
        """Nothing to open."""

    def send(self, packets: Sequence[bytes], vehicle: int) -> None:
        self.sent += packets

    def confirm(self, packet: ReceivedPacket) -> None:
        self.confirmed.append(packet)

    def close(self) -> None:
        """Nothing to close."""


class Made:
    """A `Sharing` of vehicle 1, not started, with its link and what it recorded: (key, message, time)."""

    def __init__(self) -> None:
        self.recorded: list[tuple[str, Any, int]] = []
        links: list[MemoryLink] = []

        def make(deliver: Callable[[ReceivedPacket], None]) -> list[MemoryLink]:
            links.append(MemoryLink(deliver))
            return links

        self.sharing = Sharing(
            ShareConfig(vehicle=1, origin="47.0, 8.0, 400"),
            OwnVehicle(lambda: 1, 1_700_000_000, 0.4),
            make,
            SharingOutput(None, PublicationStamps("boot"), lambda *record: self.recorded.append(record)),
        )
        (self.link,) = links

    def deliver(self, sent_ms: int, arrival_ns: int, vehicle: int = 2, stream: int = 1_700_000_000) -> bytes:
        """A packet of a neighbour arrives."""
        header = Header(vehicle=vehicle, stream=stream, sent_ms=sent_ms, section=0)
        data = state_packet(header, STATE)
        self.link.deliver(ReceivedPacket("tunnel", data, arrival_ns, vehicle))
        return data

    def faults(self, now_ns: int) -> list[str]:
        """Texts of the present faults, for a thread that must respond within 2 s."""
        return [d.text for d in self.sharing.diagnostics(now_ns, 2.0)]

    def packets(self) -> list[tuple[bytes, int]]:
        """Recorded received packets: (data, time)."""
        return [(m.data, t_ns) for key, m, t_ns in self.recorded if key == "team" and not m.sent]


def test_an_accepted_packet_is_recorded_with_its_arrival_and_its_source_confirmed() -> None:
    made = Made()
    data = made.deliver(1000, 5 * NS)
    made.sharing.step(5 * NS + NS // 20)
    assert made.packets() == [(data, 5 * NS)]
    assert [p.data for p in made.link.confirmed] == [data]


def test_a_refused_packet_is_counted_and_neither_recorded_nor_confirmed() -> None:
    made = Made()
    made.deliver(1000, 5 * NS)
    made.deliver(1000, 5 * NS + 1)  # the same again
    made.sharing.step(5 * NS + NS // 20)
    assert len(made.packets()) == len(made.link.confirmed) == 1
    assert made.sharing.health.received["replayed"] == 1


def test_a_log_takes_a_limited_number_of_packets_in_a_second() -> None:
    made = Made()
    for k in range(60):
        for vehicle in (2, 3, 4):
            made.deliver(1000 + k, 5 * NS + k, vehicle)
    for k in range(4):
        made.sharing.step(5 * NS + k * NS // 20)
    assert len(made.recorded) == MOST_LOGGED_PER_S
    assert len(made.link.confirmed) == 180  # all count
    made.sharing.step(6 * NS)
    assert made.sharing.health.received["unrecorded"] >= 80


def test_messages_that_a_link_refuses_are_reported() -> None:
    made = Made()
    made.link.refused = {"signature": 3}
    made.deliver(1000, 5 * NS)
    made.sharing.step(5 * NS)
    assert dict(made.sharing.health.received) == {"accepted": 1, "signature": 3}


def test_another_vehicle_of_the_same_number_is_a_fault_and_own_packets_are_none() -> None:
    """Also if both started in the same second."""
    made, now_ns = Made(), time.monotonic_ns()
    made.sharing.samples([*attitudes(now_ns), pose(now_ns)])
    made.sharing.step(now_ns)
    assert made.link.sent
    for data in made.link.sent:
        made.link.deliver(ReceivedPacket("tunnel", data, now_ns, 1))
    made.sharing.step(now_ns)
    assert not any("uses number" in text for text in made.faults(now_ns))
    made.deliver(2000, now_ns, vehicle=1)
    made.sharing.step(now_ns)
    text = "another vehicle uses number 1, so both refuse the reports of the other; give each its own"
    assert text in made.faults(now_ns)
    assert text in made.faults(now_ns + SAME_NUMBER_NS)
    assert text not in made.faults(now_ns + SAME_NUMBER_NS + 1), (
        "it has its own by now, or was an echo of a start before"
    )


def test_own_planes_that_cannot_be_shared_are_a_fault_until_they_can(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made()

    def broken(*_: object) -> OwnPlanes:
        raise ValueError("odd")

    monkeypatch.setattr(thread_module, "own_planes", broken)
    made.sharing.world(World(), 5 * NS)
    assert any("cannot be shared (ValueError: odd)" in text for text in made.faults(5 * NS))
    monkeypatch.undo()
    made.sharing.world(World(), 6 * NS)
    assert not any("cannot be shared" in text for text in made.faults(6 * NS))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_has_ended_or_does_not_respond_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Made()
    begun_ns = made.sharing.alive_ns
    assert not any("respond" in text for text in made.faults(begun_ns + 2 * NS))
    assert any("the thread does not respond" in text for text in made.faults(begun_ns + 2 * NS + 1))

    def broken(now_ns: int) -> None:
        raise OSError("no memory")

    monkeypatch.setattr(made.sharing, "step", broken)
    made.sharing.open()
    end_s = time.monotonic() + 30.0
    while not any("not shared any more" in text for text in made.faults(begun_ns)) and time.monotonic() < end_s:
        time.sleep(0.01)
    (only,) = made.faults(begun_ns)
    made.sharing.close()
    assert only.startswith("obstacles are not shared any more (")
    assert "no memory" in only


def test_a_closed_link_is_a_fault_and_in_the_health_report() -> None:
    made, now_ns = Made(), time.monotonic_ns()
    assert not any("not open" in text for text in made.faults(now_ns))
    made.link.fault = "no such device"
    made.sharing.step(now_ns)
    assert "the link tunnel to other vehicles is not open: no such device" in made.faults(now_ns)
    (link,) = made.sharing.health.links
    assert (link.name, link.fault) == ("tunnel", "no such device")


def test_the_health_report_has_the_rate_of_the_last_ten_seconds() -> None:
    made = Made()
    made.sharing.origin(47.0, 8.0, 400.0)
    for k in range(15 * 20):
        now_ns = (5 + k) * NS // 20
        made.sharing.samples([*attitudes(now_ns, begin_ns=now_ns - NS), pose(now_ns)])
        made.sharing.step(now_ns)
    sent = [len(packet) + made.link.overhead_bytes for packet in made.link.sent]
    (link,) = made.sharing.health.links
    assert made.sharing.health.frame_known
    assert len(sent) - 1 <= link.sent_packets <= len(sent), "it is at most 0.2 s old"
    assert link.sent_bytes == sum(sent[: link.sent_packets])
    last_ten_s = sum(sent[-10:])  # one packet each second
    assert link.sent_bytes_per_s == pytest.approx(last_ten_s / 10.0, rel=0.25)


def pose(t_ns: int, north_m: float = 0.0, resets: int = 0) -> PoseSample:
    return PoseSample(
        t_ns=t_ns,
        t_arrival_ns=t_ns,
        position_ned_m=(north_m, 0.0, -3.0),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        reset_counter=resets,
    )


def attitudes(t_ns: int, yaw_rad: float = 0.0, begin_ns: int = NS) -> list[AttitudeSample]:
    """A vehicle that does not turn: attitudes of the last begin_ns, all of this heading."""
    q = quaternion_from_euler(0.0, 0.0, yaw_rad)
    return [AttitudeSample(t, t, q, (0.0, 0.0, 0.0)) for t in range(t_ns - begin_ns + NS // 10, t_ns + 1, NS // 10)]


class Flown:
    """A `Made` whose own world has a newest frame at `frame_ns`, and that receives a packet before each step."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made, self.frame_ns = Made(), 0
        monkeypatch.setattr(thread_module, "own_planes", lambda *_: OwnPlanes(SharedPlanes.empty(), 1, self.frame_ns))

    def step(self, t_ns: int, samples: list[AttitudeSample | PoseSample], frame_ns: int) -> tuple[int, int]:
        """(sent packets, published moving obstacles) at an instant."""
        made, self.frame_ns = self.made, frame_ns
        made.sharing.samples(samples)
        made.sharing.world(World(), t_ns)
        made.deliver(t_ns // 1_000_000, t_ns)
        made.link.sent.clear()
        made.sharing.step(t_ns)
        return len(made.link.sent), len(made.sharing.obstacles.movers)


@pytest.mark.parametrize("kind", ["counted", "stepped", "turned"])
def test_after_a_jump_of_the_own_estimate_nothing_is_exchanged_until_the_own_world_follows(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """The world begins a new section with the next frame. Without one, obstacles would stand in the old section."""
    flown = Flown(monkeypatch)
    before = {"counted": (50.0, 0, 0.0), "stepped": (0.0, 0, 0.0), "turned": (50.0, 0, 0.0)}[kind]
    after = {"counted": (50.1, 1, 0.0), "stepped": (50.0, 0, 0.0), "turned": (50.0, 0, 0.5)}[kind]

    def step(second: int, estimate: tuple[float, int, float], frame_second: int) -> tuple[int, int]:
        north_m, resets, yaw_rad = estimate
        t_ns = second * NS
        samples = [*attitudes(t_ns, yaw_rad), pose(t_ns, north_m, resets)]
        return flown.step(t_ns, samples, frame_second * NS)

    assert step(5, before, 5) == (1, 1)
    assert step(6, after, 5) == (0, 0)
    assert step(7, after, 5) == (0, 0)
    assert step(8, after, 7) == (1, 1)


def test_gaps_and_sums_of_small_steps_are_counted() -> None:
    """0.7 s without an attitude, and 0.4 m in 0.1 s that no velocity explains."""
    own, found = OwnMotion(), []
    own.take([*attitudes(5 * NS), pose(5 * NS)])
    found.append(own.newest.estimate)
    own.take([*attitudes(5 * NS + 7 * NS // 10, begin_ns=NS // 10), pose(5 * NS + NS // 2)])
    found.append(own.newest.estimate)
    own.take([pose(5 * NS + NS // 2 + k * NS // 10, 0.4 * k) for k in range(1, 6)])
    found.append(own.newest.estimate)
    assert found == [(1, 0), (1, 1), (2, 1)]
    assert own.newest.jump_ns == 5 * NS + 7 * NS // 10, "the first attitude after the gap: the world begins a section"


def test_without_an_attitude_nothing_is_exchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The heading may have jumped unnoticed."""
    flown = Flown(monkeypatch)
    assert flown.step(4 * NS, [pose(4 * NS)], 4 * NS) == (0, 0)
    assert flown.step(5 * NS, [*attitudes(5 * NS), pose(5 * NS)], 5 * NS) == (1, 1)
    assert flown.step(6 * NS + NS // 10, [pose(6 * NS)], 6 * NS) == (0, 0)


def test_without_a_position_nothing_is_exchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = Flown(monkeypatch)
    assert flown.step(4 * NS, [*attitudes(4 * NS)], 4 * NS) == (0, 0)
    assert flown.step(5 * NS, [*attitudes(5 * NS), pose(5 * NS)], 5 * NS) == (1, 1)
    assert flown.step(6 * NS + NS // 10, [*attitudes(6 * NS + NS // 10)], 6 * NS) == (0, 0)


def test_obstacles_are_published_sooner_after_an_accepted_packet() -> None:
    made, t_ns = Made(), [5 * NS]

    def step(after_ms: int) -> bool:
        """Whether it published."""
        t_ns[0] += after_ms * NS // 1000
        made.sharing.step(t_ns[0])
        return made.sharing.obstacles.now_ns == t_ns[0]

    made.deliver(1000, t_ns[0])
    assert step(0)
    assert [step(50), step(50), step(50), step(50)] == [False, False, False, True]
    made.deliver(1200, t_ns[0])
    assert [step(50), step(50)] == [False, True]
    made.deliver(1200, t_ns[0])  # refused: nothing is new
    assert [step(50), step(50), step(50), step(50)] == [False, False, False, True]


def tracked(camera: str, exposure_ns: int, *objects: MovingObject) -> TracksResult:
    """The tracks of a frame, as far as they are shared."""
    tracks = tracks_of(*objects)
    return cast(TracksResult, SimpleNamespace(camera=camera, frame="ned", t_exposure_ns=exposure_ns, tracks=tracks))


def tracks_of(*objects: MovingObject, flags: Mapping[int, int] = MappingProxyType({})) -> TrackSnapshot:
    """The moving obstacles of a tracker. flags: of one plane of each of these objects; 0: a static one."""
    owner, values = np.array(list(flags), np.int64), np.array(list(flags.values()), np.uint8)
    return cast(TrackSnapshot, SimpleNamespace(objects=objects, object_id=owner, flags=values))


def moving(north_m: float, unseen_ns: int = 0) -> MovingObject:
    return MovingObject(
        id=4,
        centre_m=(north_m, 0.0, -1.0),
        half_size_m=(0.4, 0.4, 0.9),
        velocity_m_s=(8.0, 0.0),
        position_sigma_m=0.1,
        velocity_sigma_m_s=0.1,
        cov_m2_s=0.0,
        hits=9,
        age_ns=3 * NS,
        unseen_ns=unseen_ns,
    )


def received_movers(made: Made, now_ns: int) -> list[float]:
    """Places north, in m, of moving obstacles as another vehicle publishes them."""
    made.sharing.samples([*attitudes(now_ns), pose(now_ns)])
    made.sharing.step(now_ns)
    receiver = NeighbourMap(2)
    for data in made.link.sent:
        assert receiver.receive(data, now_ns) == ""
    found = receiver.obstacles(OwnState(state=STATE, section=0), now_ns)
    return sorted(m.centre_m[0] for m in found.movers if m.kind is MoverKind.OBSTACLE)


def test_an_obstacle_out_of_the_range_of_the_packets_is_reported() -> None:
    """It is not sent: the other vehicles do not know it."""
    made = Made()
    made.sharing.tracks(tracked("front", 5 * NS, moving(50_000.0)))
    assert received_movers(made, 5 * NS) == []
    (link,) = made.sharing.health.links
    assert link.unencodable == 1


def test_a_mover_that_is_not_observed_now_is_where_the_tracker_predicts_it() -> None:
    """The tracker has moved it to the exposure of the frame, the receiver moves it by its age since the observation."""
    made = Made()
    made.sharing.tracks(tracked("front", 5 * NS, moving(20.0, unseen_ns=NS)))
    assert received_movers(made, 5 * NS + NS // 10) == [pytest.approx(20.8, abs=0.3)]


def test_movers_of_several_cameras_are_all_sent() -> None:
    """Each camera has a tracker, which counts its obstacles from the same number."""
    made = Made()
    made.sharing.tracks(tracked("front", 5 * NS, moving(20.0)))
    made.sharing.tracks(tracked("rear", 5 * NS + NS // 20, moving(-20.0)))
    places = received_movers(made, 5 * NS + NS // 10)
    assert places == [pytest.approx(-19.6, abs=0.3), pytest.approx(20.8, abs=0.3)]
