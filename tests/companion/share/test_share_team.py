"""Two vehicles of a team that exchange packets: their worlds, their frames, and the rule that reports only add."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zmq
from google.protobuf.message import Message

from companion.autopilot.session_factory import params_of
from companion.config.loader import ConfigError, config_of
from companion.config.share import ShareConfig
from companion.live.status import status_lines
from companion.share.output import SharingOutput
from companion.share.own_motion import Motion
from companion.share.own_planes import OwnPlanes
from companion.share.packet_rate import PacketRate
from companion.share.sharing_thread import OwnVehicle, Sharing
from companion.share.team import ALIGN_PLANES, NS, Team
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher, Stream
from core.sharing.neighbour import Neighbour
from core.sharing.neighbour_map import NeighbourMap
from core.sharing.obstacles import MoverKind, PlacementState
from core.sharing.packet_codec import decoded
from core.sharing.records import LocalFrame, SharedPlanes, VehicleState
from core.sharing.send_budget import Budget
from core.types import AttitudeSample, PoseSample
from drivers.sharing.link import ReceivedPacket
from osape_client.proto import osape_v1_pb2 as pb
from tests.core.neighbours import mover

THIN = Budget(bytes_per_s=1000.0, overhead_bytes=30, packet_bytes=128)
STEP_NS = NS // 10
CAR = replace(mover(15.0, 2.0, 2.0), centre_m=(15.0, 2.0, -1.0), half_size_m=(1.0, 0.5, 0.8))


def street() -> SharedPlanes:
    """Facades with gaps on both sides."""
    rng = np.random.Generator(np.random.PCG64(4))
    rows = []
    for side in (-1.0, 1.0):
        x = -10.0
        while x < 50.0:
            length, y = rng.uniform(5.0, 11.0), side * rng.uniform(6.0, 8.0)
            ends = ((x, y), (x + length, y)) if side > 0 else ((x + length, y), (x, y))
            rows.append((*ends[0], *ends[1], -8.0, 0.0))
            rows.append((x, y + side * 5.0, x, y, -8.0, 0.0) if side > 0 else (x, y, x, y + side * 5.0, -8.0, 0.0))
            x += length + rng.uniform(1.5, 3.0)
    n = len(rows)
    return SharedPlanes(
        ids=np.arange(n, dtype=np.uint16),
        box=np.array(rows),
        margin_m=np.full(n, 0.1),
        flags=np.zeros(n, np.uint8),
        age_s=np.full(n, 0.1),
    )


ATTITUDE = AttitudeSample(0, 0, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def motion(x_m: float, t_ns: int, jump_ns: int = 0, estimate: tuple[int, int] = (1, 0)) -> Motion:
    """Position and attitude."""
    pose = PoseSample(
        t_ns=t_ns, t_arrival_ns=t_ns, position_ned_m=(x_m, 0.0, -3.0), velocity_ned_m_s=(1.0, 0.0, 0.0), reset_counter=0
    )
    return Motion(pose, replace(ATTITUDE, t_ns=t_ns, t_arrival_ns=t_ns), jump_ns, estimate)


def team(vehicle: int, origin: str) -> Team:
    return Team(ShareConfig(origin=origin), vehicle, 1_700_000_000, 0, 0.4, {"tunnel": THIN})


def flown(teams: list[Team], seconds: float, x_m: list[float], begin_s: float = 0.0) -> None:
    """All receive all packets. x_m: where each is in its own frame."""
    for k in range(round(seconds * 10)):
        now_ns = round(begin_s * NS) + k * STEP_NS
        for one, x in zip(teams, x_m, strict=True):
            one.own.motion = motion(x, now_ns)
            one.own.planes = OwnPlanes(one.own.planes.planes, 1, now_ns)
        for one in teams:
            for data in one.packets(now_ns).get("tunnel", []):
                for other in teams:
                    if other is not one:
                        other.receive(data, now_ns, one.vehicle)
        for one in teams:
            one.align(now_ns)


def pair(shift_m: float = 0.0) -> list[Team]:
    """Two vehicles in a street; the second one's origin is wrong by shift_m to the east."""
    east_deg = math.degrees(shift_m / (6_378_137.0 * math.cos(math.radians(47.0))))
    teams = [team(1, "47.0, 8.0, 400"), team(2, f"47.0, {8.0 + east_deg:.9f}, 400")]
    for one in teams:
        one.own.planes = OwnPlanes(street(), 1)
    return teams


@pytest.fixture(scope="module")
def after_20_s() -> list[Team]:
    """Two vehicles that have aligned their frames; the second one's origin is wrong by 3 m. Tests change copies."""
    teams = pair(3.0)
    flown(teams, 20.0, [0.0, 30.0])
    return teams


@pytest.fixture
def aligned(after_20_s: list[Team]) -> list[Team]:
    return copy.deepcopy(after_20_s)


def test_a_wrong_origin_is_aligned_by_the_planes_of_both(aligned: list[Team]) -> None:
    got = aligned[0].obstacles(20 * NS)
    assert got.neighbours[0].placement is PlacementState.ALIGNED
    true = street().box[got.ids]
    assert np.abs(got.planes[:, :4] - true[:, :4]).max() < 0.3
    assert (got.margin_m < 2.0).all()
    assert [m.centre_m[0] for m in got.movers] == [pytest.approx(31.0, abs=1.5)]


def test_packets_have_the_number_of_the_section_in_which_the_planes_stand() -> None:
    """Receivers keep the planes of the section before where they are."""
    one = team(1, "47.0, 8.0, 400")
    for number in (3, 4):
        now_ns = number * NS
        one.own.motion, one.own.planes = motion(0.0, now_ns), OwnPlanes(street(), number, now_ns)
        assert {decoded(data).header.section for data in one.packets(now_ns)["tunnel"]} == {number}


def test_vehicles_that_are_no_members_are_refused_where_the_link_does_not_know_the_sender() -> None:
    one = Team(ShareConfig(origin="47.0, 8.0, 400", members="2, 4"), 1, 1_700_000_000, 0, 0.4, {"tunnel": THIN})
    for vehicle, code in ((2, ""), (3, "unknown_sender")):
        other = team(vehicle, "47.0, 8.0, 400")
        other.own.motion, other.own.planes = motion(0.0, NS), OwnPlanes(street(), 1, NS)
        assert {one.receive(data, NS, None) for data in other.packets(NS)["tunnel"]} == {code}


def test_a_world_that_is_not_updated_is_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[int] = []
    monkeypatch.setattr(NeighbourMap, "align", lambda self, box, own, now_ns: compared.append(len(box)))
    one = team(1, "47.0, 8.0, 400")
    one.own.motion, one.own.planes = motion(0.0, 5 * NS), OwnPlanes(street(), 1, 4 * NS)
    assert one.align(5 * NS)
    one.own.motion = motion(0.0, 8 * NS)
    assert one.align(8 * NS)
    assert compared == [len(street().ids), 0]


def test_the_nearest_planes_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time of a fit grows with their number."""
    compared: list[int] = []
    monkeypatch.setattr(NeighbourMap, "align", lambda self, box, own, now_ns: compared.append(len(box)))
    one, many = team(1, "47.0, 8.0, 400"), street()
    rows = np.tile(np.arange(len(many.ids)), 20)[: ALIGN_PLANES + 50]
    one.own.planes = OwnPlanes(
        SharedPlanes(
            ids=np.arange(len(rows), dtype=np.uint16),
            box=many.box[rows],
            margin_m=many.margin_m[rows],
            flags=many.flags[rows],
            age_s=many.age_s[rows],
        ),
        1,
    )
    one.own.motion = motion(0.0, NS)
    assert one.align(NS)
    assert compared == [ALIGN_PLANES]


def test_neighbours_are_aligned_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit takes a fraction of a second, in which nothing is sent: each neighbour has its own instants."""
    tried: list[tuple[int, float]] = []
    monkeypatch.setattr(Neighbour, "align", _noting(tried))
    others = (ShareConfig(origin="47.0, 8.0, 400", align=False) for _ in range(2))
    teams = [team(1, "47.0, 8.0, 400")]
    teams += [Team(config, k + 2, 1_700_000_000, 0, 0.4, {"tunnel": THIN}) for k, config in enumerate(others)]
    for one in teams:
        one.own.planes = OwnPlanes(street(), 1)
    flown(teams, 10.0, [0.0, 30.0, 10.0])
    times = [[t for vehicle, t in tried if vehicle == number] for number in (2, 3)]
    assert all(float(np.abs(np.diff(some[1:]) - 2.0).max()) < 0.01 for some in times), times
    assert not set(times[0]) & set(times[1])
    assert all(len(some) >= 4 for some in times)


def _noting(tried: list[tuple[int, float]]) -> Callable[[Neighbour, np.ndarray, LocalFrame, int], None]:
    def align(neighbour: Neighbour, own_box: np.ndarray, own: LocalFrame, now_ns: int) -> None:
        neighbour.fitted_ns = now_ns
        tried.append((neighbour.vehicle, now_ns / NS))

    return align


def test_nothing_is_sent_or_placed_without_a_position() -> None:
    teams = pair()
    flown(teams, 5.0, [0.0, 30.0])
    assert len(teams[0].obstacles(5 * NS).sender) > 0
    assert len(teams[0].obstacles(8 * NS).sender) == 0  # the position is 3 s old
    assert teams[0].packets(8 * NS) == {}
    unknown = team(3, "")
    unknown.own.motion, unknown.own.planes = motion(0.0, 0), OwnPlanes(street(), 1)
    assert unknown.packets(0) == {}


def test_a_jump_of_the_own_heading_ends_an_alignment_at_once_without_new_frames(aligned: list[Team]) -> None:
    """The own planes stood at wrong places: what was aligned by them may be metres wrong."""
    one, now_ns = aligned[0], 20 * NS
    assert one.obstacles(now_ns).neighbours[0].placement is PlacementState.ALIGNED
    one.own.motion = motion(0.0, now_ns, now_ns, (1, 1))
    got = one.obstacles(now_ns)
    assert (len(got.planes), got.neighbours[0].placement) == (0, PlacementState.UNKNOWN)


@pytest.mark.parametrize("estimate", [(1, 1), (2, 0)])
def test_a_gap_or_a_drift_of_the_own_estimate_ends_an_alignment_at_once(
    estimate: tuple[int, int], aligned: list[Team]
) -> None:
    """It does not begin a new section of the own world, so that nothing else would."""
    one, now_ns = aligned[0], 20 * NS
    assert one.obstacles(now_ns).aligned.all()
    one.own.motion = motion(0.0, now_ns, estimate=estimate)
    got = one.obstacles(now_ns)
    assert len(got.planes) > 0
    assert not got.aligned.any()
    assert (got.margin_m > 3.0).all()


def test_movers_are_shared_with_their_age_and_end() -> None:
    teams = pair()
    teams[1].own.movers, teams[1].own.movers_ns = (CAR,), 0
    flown(teams, 1.0, [0.0, 30.0])
    (got,) = (m for m in teams[0].obstacles(NS).movers if m.id == 4)
    assert got.centre_m[0] == pytest.approx(17.0, abs=0.2)
    flown(teams, 5.0, [0.0, 30.0], 1.0)
    assert not [m for m in teams[0].obstacles(6 * NS).movers if m.id == 4]


@pytest.mark.parametrize("half_size_m", [0.1, 0.5])
def test_a_neighbour_stays_where_it_reports_itself_whatever_the_own_sensors_observe_there(half_size_m: float) -> None:
    """What they track with its velocity within 3 m may be something else, and smaller than the neighbour."""
    teams = pair()
    teams[0].own.movers = (replace(mover(30.4, 1.5), half_size_m=(half_size_m, half_size_m, half_size_m)),)
    flown(teams, 1.0, [0.0, 30.0])
    assert [m.sender for m in teams[0].obstacles(9 * NS // 10).movers if m.kind is MoverKind.VEHICLE] == [2]


def test_a_small_obstacle_at_the_own_place_is_sent() -> None:
    """At the place of another vehicle it would be taken for that vehicle."""
    one = team(1, "47.0, 8.0, 400")
    box = np.array([[0.3, -0.3, 0.3, 0.3, -3.3, -2.8]])
    small = replace(street().part(np.array([0])), box=box)
    one.own.motion, one.own.planes = motion(0.0, NS), OwnPlanes(small, 1, NS)
    contents = [decoded(data).content for data in one.packets(NS)["tunnel"]]
    assert [len(c) for c in contents if isinstance(c, SharedPlanes)] == [1]


@pytest.mark.parametrize("hedge_top_m", [-3.1, -1.0])
def test_the_visible_part_of_a_person_beside_a_neighbour_is_sent(hedge_top_m: float) -> None:
    """A plane of the size of vehicle 2 at its place, at x = 30 m, not sent unless a hedge before it may hide a part."""
    teams = pair()
    hedge, part = (27.0, -3.0, 27.0, 3.0, hedge_top_m, 0.0), (30.2, -0.3, 30.2, 0.3, -3.3, -2.8)
    planes = replace(street().part(np.array([0, 1])), box=np.array([hedge, part]))
    teams[0].own.planes = OwnPlanes(planes, 1)
    flown(teams, 4.0, [0.0, 30.0])
    got = teams[1].obstacles(4 * NS)
    assert (1 in got.ids) is (hedge_top_m == -3.1)


def test_a_world_that_is_not_updated_is_not_sent() -> None:
    teams = pair()
    teams[0].own.motion, teams[0].own.planes = motion(0.0, 5 * NS), OwnPlanes(street(), 1, 3 * NS)
    (first, *rest) = teams[0].packets(5 * NS)["tunnel"]
    assert isinstance(decoded(first).content, VehicleState)
    assert rest == []


def test_a_mover_that_cannot_be_sent_does_not_stop_the_others() -> None:
    teams = pair()
    odd = [replace(CAR, id=5, velocity_m_s=(40.0, 0.0)), replace(CAR, id=6, sigma_m=math.nan)]
    many = [replace(CAR, id=10 + k, centre_m=(15.0 + 3 * k, 2.0, -1.0)) for k in range(9)]
    teams[1].own.movers, teams[1].own.movers_ns = (*odd, CAR, *many), 0
    flown(teams, 1.5, [0.0, 60.0])
    found = {m.id for m in teams[0].obstacles(NS).movers}
    assert {4, *range(10, 19)} <= found
    assert not {5, 6} & found


def test_a_flood_of_one_sender_leaves_room_for_others() -> None:
    rate = PacketRate(frozenset())
    flood = sum(rate.allows(ReceivedPacket("tunnel", b"", NS + k * 1000, 3)) for k in range(100_000))
    assert flood < 100
    assert rate.allows(ReceivedPacket("tunnel", b"", NS + 10**8, 4))
    assert rate.dropped["flood"] > 99_000


def test_a_flood_of_vehicles_that_are_not_members_leaves_room_for_members() -> None:
    rate = PacketRate(frozenset({2, 3}))
    for k in range(20_000):
        assert not rate.allows(ReceivedPacket("tunnel", b"", NS + k, 4 + k % 250))
    assert rate.allows(ReceivedPacket("tunnel", b"", NS + 10**8, 2))
    assert rate.dropped["unknown_sender"] == 20_000


def test_the_counters_of_a_rate_are_there_from_the_beginning() -> None:
    """Another thread reads them: a key that is added meanwhile would end it."""
    rate = PacketRate(frozenset({2}))
    before = set(rate.dropped)
    for k in range(1000):
        rate.allows(ReceivedPacket("tunnel", b"", NS + k, 2 + k % 2))
    assert rate.dropped.keys() == before


def test_an_old_position_is_moved_to_the_present() -> None:
    """Positions may arrive a few times a second only: a vehicle at 10 m/s is metres further then."""
    one = team(1, "47.0, 8.0, 400")
    pose = PoseSample(
        t_ns=NS, t_arrival_ns=NS + NS // 10, position_ned_m=(5.0, 1.0, -3.0), velocity_ned_m_s=(10.0, -2.0, 0.5)
    )
    one.own.motion = Motion(pose, replace(ATTITUDE, t_ns=NS, t_arrival_ns=NS))
    state = one.state(NS + NS // 2).state
    assert state is not None
    assert state.position_m == pytest.approx((10.0, 0.0, -2.75))


@pytest.mark.parametrize(("measured_s", "moved_s"), [(1.2, 0.0), (0.5, 0.5), (-2.0, 1.0)])
def test_a_position_is_moved_by_a_second_at_most_and_never_back(measured_s: float, moved_s: float) -> None:
    """The clock of the autopilot may be wrong by more than the age of a position that has just arrived."""
    one = team(1, "47.0, 8.0, 400")
    one.own.motion = motion(5.0, NS)
    assert one.own.motion.pose is not None
    one.own.motion = replace(one.own.motion, pose=replace(one.own.motion.pose, t_ns=round(measured_s * NS)))
    state = one.state(NS).state
    assert state is not None
    assert state.position_m == pytest.approx((5.0 + moved_s, 0.0, -3.0))


# ---- configuration and status --------------------------------------------------------------------------------------------------

WORLD = {"world": "ipc://{run}/world", "world_requests": "ipc://{run}/snapshot"}
AUTOPILOT = {"address": "udpin:0.0.0.0:14540"}


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"share": {"enabled": True, "tunnel": "autopilot"}}, "world is empty"),
        ({"share": {"enabled": True}, "publish": WORLD}, "without a link"),
        ({"share": {"enabled": True, "tunnel": "autopilot"}, "publish": WORLD}, "no position"),
        (
            {"share": {"enabled": True, "tunnel": "autopilot", "vehicle": 3}, "publish": WORLD, "autopilot": AUTOPILOT},
            "set vehicle = 0",
        ),
        ({"share": {"members": "2, x"}}, "members"),
        ({"share": {"origin": "47, 8"}}, "origin"),
        ({"share": {"origin": "147, 8, 0"}}, "not a place on Earth; expected latitude -90..90"),
        ({"share": {"tunnel": "udp:1"}}, "is not an address"),
        ({"share": {"refresh_s": 90.0}}, "refresh_s"),
        ({"share": {"zenoh_team": "a/b"}}, "zenoh_team"),
    ],
)
def test_a_configuration_that_cannot_work(content: dict[str, dict[str, object]], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        config_of(content, "test")


@pytest.mark.parametrize(
    ("share", "out_bytes_per_s", "neighbours"),
    [
        ({"enabled": True, "tunnel": "autopilot", "members": "2,5"}, 300.0, 2),
        ({"enabled": True, "tunnel": "autopilot"}, 300.0, 1),
        ({"enabled": True, "tunnel": "udpin:127.0.0.1:15555"}, 0.0, 0),
        ({"enabled": False, "tunnel": "autopilot"}, 0.0, 0),
    ],
)
def test_the_line_to_the_autopilot_is_judged_with_the_messages_of_the_team(
    share: dict[str, object], out_bytes_per_s: float, neighbours: int
) -> None:
    content = {
        "publish": {"world": "ipc:///tmp/w", "world_requests": "ipc:///tmp/r"},
        "autopilot": {"address": "serial:/dev/ttyAMA0:57600"},
        "share": share,
    }
    params = params_of(config_of(content, "test"))
    assert (params.tunnel_bytes_per_s, params.neighbours) == (out_bytes_per_s, neighbours)


def test_the_recorded_obstacles_are_those_that_were_published(tmp_path: Path) -> None:
    """The recorder serialises a message later, in its own thread: it must not be changed once it was handed over."""
    recorded: list[tuple[pb.NeighbourObstacles, bytes]] = []

    def record(key: str, message: Message, t_ns: int) -> None:
        if isinstance(message, pb.NeighbourObstacles):
            recorded.append((message, message.SerializeToString()))

    with zmq.Context() as context:
        publisher = Publisher(Stream("neighbours", f"ipc://{tmp_path}/neighbours"), context)
        try:
            config = ShareConfig(origin="47.4, 8.5, 400", vehicle=3)
            output = SharingOutput(publisher, PublicationStamps("boot"), record)
            sharing = Sharing(config, OwnVehicle(lambda: 3, 1, 0.4), lambda deliver: (), output)
            sharing.step(10 * NS)
        finally:
            publisher.close()
    ((message, at_handover),) = recorded
    assert message.publication.boot_id == "boot"
    assert message.SerializeToString() == at_handover


def test_sharing_is_off_by_default() -> None:
    assert not config_of({}, "test").share.enabled


def test_the_status_lists_the_team() -> None:
    health = pb.Health()
    health.team.vehicle, health.team.frame_known = 1, True
    health.team.links.append(pb.TeamLinkHealth(name="tunnel", sent_bytes_per_s=212.0, unencodable=4))
    health.team.received["accepted"], health.team.received["replayed"] = 90, 2
    health.team.neighbours.append(
        pb.NeighbourHealth(vehicle=2, silent_s=0.3, placement="by_position", fit="too_little", sigma_m=2.1, planes=14)
    )
    text = "\n".join(status_lines(health))
    assert (
        "team: vehicle 1; tunnel 212 B/s sent, 4 x out of the packets' range and not sent; refused: 2 replayed" in text
    )
    assert "vehicle 2: 14 planes, 0 moving, 0 withheld, newest packet 0.3 s ago, frame by_position within 2.1 m" in text
