"""Random packets of a faithful neighbour and of senders of anything: what they say adds obstacles that expire, within bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from companion.share.messages import obstacles_message
from core.sharing.bodies import BODY_SIZE_M, MOST_HALF_HEIGHT_M, MOST_SLACK_M
from core.sharing.neighbour import MOST_FORMER, MOST_MOVERS
from core.sharing.neighbour_map import VEHICLE_ID, NeighbourMap, OwnState
from core.sharing.obstacles import SharedObstacles
from core.sharing.packet_codec import OVERHEAD_BYTES, decoded, movers_packet, planes_packet, state_packet
from core.sharing.params import SharingParams
from core.sharing.plane_codec import LONG, SHORT, PlaneForm
from core.sharing.records import Header, LocalFrame, PacketError, SharedMover, SharedPlanes, VehicleState
from osape_client import NeighbourObstacles, Occupancy

NS = 1_000_000_000
MS = 1_000_000
TRUE = 2
"""Number of the faithful neighbour."""
PARAMS = SharingParams(expire_s=6.0, most_planes=256, most_neighbours=4)
FRAME = LocalFrame(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0, sigma_m=0.5, sigma_z_m=0.5)
OWN = OwnState(
    state=VehicleState(frame=FRAME, position_m=(0.0, 0.0, -3.0), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4), section=1
)
STREAM = 1_700_000_000
ANCHOR = (0.0, 0.0, 0.0)


def some_planes(rng: np.random.Generator, count: int) -> SharedPlanes:
    begin = rng.uniform(-40.0, 40.0, (count, 2))
    top = rng.uniform(-8.0, -1.0, count)
    height = rng.choice([0.4, 1.0, 5.0], count)
    box = np.column_stack([begin, begin + rng.uniform(0.2, 6.0, (count, 2)), top, top + height])
    flags = rng.choice([0, 0, 8], count).astype(np.uint8)
    ids = rng.integers(0, 100, count).astype(np.uint16)
    return SharedPlanes(ids=ids, box=box, margin_m=np.full(count, 0.1), flags=flags, age_s=rng.uniform(0, 3, count))


def some_state(rng: np.random.Generator, far: bool) -> VehicleState:
    frame = FRAME
    if far:
        frame = LocalFrame(
            latitude_deg=float(rng.choice([0.0, 47.0001, 90.0, -90.0])),
            longitude_deg=float(rng.choice([8.0, 180.0, -180.0])),
            altitude_m=float(rng.choice([-2e6, 400.0, 2e6])),
            yaw_rad=rng.uniform(-3.0, 3.0),
            sigma_m=float(rng.choice([0.0, 0.5, 600.0])),
            sigma_z_m=float(rng.choice([0.0, 600.0])),
            sigma_yaw_rad=float(rng.choice([0.0, 0.05, 6.0])),
        )
    reach_m = float(rng.choice([20.0, 2e7]) if far else 20.0)
    x, y = rng.uniform(-reach_m, reach_m, 2)
    return VehicleState(
        frame=frame,
        position_m=(float(x), float(y), float(rng.uniform(-20.0, 0.0))),
        velocity_m_s=(float(rng.uniform(-300, 300)) if far else 1.0, 0.0, 0.0),
        radius_m=float(rng.choice([0.0, 0.4, 25.0])),
    )


def some_mover(rng: np.random.Generator) -> SharedMover:
    return SharedMover(
        id=int(rng.integers(0, 300)),
        centre_m=(float(rng.uniform(-40, 40)), float(rng.uniform(-40, 40)), -2.0),
        half_size_m=(0.3, 0.3, float(rng.choice([0.3, 0.9]))),
        velocity_m_s=(float(rng.uniform(-5, 5)), 0.0),
        sigma_m=0.2,
        sigma_m_s=0.5,
        age_s=float(rng.uniform(0.0, 1.0)),
    )


@dataclass(slots=True)
class Attacker:
    """Sends packets in any name but that of the faithful neighbour, and repeats and damages what it has heard."""

    rng: np.random.Generator
    heard: list[bytes] = field(default_factory=list)

    def packet(self, now_ms: int) -> bytes:
        rng = self.rng
        kind = rng.integers(0, 7)
        head = Header(
            vehicle=int(rng.choice([1, 3, 4, 5, 6, 255])),
            stream=STREAM + int(rng.random() < 0.02),
            sent_ms=int(
                rng.choice([now_ms, max(0, now_ms - 3000), now_ms + 60_000, 2**32 - 1], p=[0.94, 0.02, 0.02, 0.02])
            ),
            section=int(rng.integers(0, 20)) if rng.random() < 0.2 else 0,
        )
        if kind == 0:
            return bytes(rng.integers(0, 256, int(rng.integers(0, 200))).astype(np.uint8))
        if kind == 1:
            return state_packet(head, some_state(rng, far=rng.random() < 0.5))
        if kind == 2:
            return planes_packet(head, some_planes(rng, 6), ANCHOR, LONG, some_state(rng, far=False))
        if kind == 3:
            return movers_packet(head, tuple(some_mover(rng) for _ in range(5)), ANCHOR)
        if not self.heard:
            return b""
        data = bytearray(self.heard[int(rng.integers(0, len(self.heard)))])
        if kind == 4:
            return bytes(data[: int(rng.integers(0, len(data)))])
        if kind == 5:
            for _ in range(int(rng.integers(1, 6))):
                data[int(rng.integers(0, len(data)))] ^= 1 << int(rng.integers(0, 8))
            data[1] = int(rng.choice([1, 3, 4, 7]))  # the sender is not the faithful one
        return bytes(data)


def faithful_packet(rng: np.random.Generator, now_ms: int, states: list[VehicleState]) -> bytes:
    head = Header(vehicle=TRUE, stream=STREAM, sent_ms=now_ms, section=0)
    if now_ms % 1000 < 100 or not states:
        states.append(some_state(rng, far=False))
        return state_packet(head, states[-1])
    if rng.random() < 0.2:
        return movers_packet(head, (some_mover(rng),), ANCHOR)
    return planes_packet(head, some_planes(rng, int(rng.integers(1, 5))), ANCHOR, LONG)


def check_bounds(found: NeighbourMap) -> None:
    assert found.vehicles <= PARAMS.most_neighbours
    for neighbour in found._neighbours.values():
        frames = [neighbour.present, *neighbour.former]
        assert len(neighbour.former) <= MOST_FORMER
        assert sum(len(frame.planes) for frame in frames) <= PARAMS.most_planes
        assert all(len(frame.movers) <= MOST_MOVERS for frame in frames)


def check_client(got: SharedObstacles, rng: np.random.Generator) -> None:
    """A planner uses the message, and nothing in it makes anything free."""
    neighbours = NeighbourObstacles(obstacles_message(got, 1))
    a, b = rng.uniform(-40.0, 40.0, (2, 50, 3))
    own = rng.choice([int(o) for o in Occupancy], 50).astype(np.uint8)
    for some in (neighbours, neighbours.later(0.7)):
        answers = some.added_to_segments(own, a, b, 0.5)
        assert ((answers == own) | (answers == Occupancy.OCCUPIED)).all()


def of_true(got: SharedObstacles) -> dict[int, np.ndarray]:
    return {int(i): p for i, p, s in zip(got.ids, got.planes, got.sender, strict=True) if s == TRUE}


def may_be_a_vehicle(plane: np.ndarray, got: SharedObstacles) -> bool:
    """True if it may lie at the place that a vehicle states, low and within the limits of `bodies`."""
    place_m = 2.0 * math.hypot(FRAME.sigma_z_m, FRAME.sigma_z_m)  # at the top and at the bottom
    if plane[5] - plane[4] > 2.0 * (MOST_HALF_HEIGHT_M + place_m) + 0.01:
        return False
    middle = 0.5 * (plane[0:2] + plane[2:4])
    vehicles = [m.centre_m for m in got.movers if m.id == VEHICLE_ID]
    return any(math.dist(middle, at[:2]) <= BODY_SIZE_M + MOST_SLACK_M for at in [(0.0, 0.0), *vehicles])


@pytest.mark.parametrize("seed", range(6))
def test_whatever_is_received_adds_obstacles_that_expire(seed: int) -> None:
    rng = np.random.default_rng(seed)
    attacker, states = Attacker(np.random.default_rng([seed, 1])), list[VehicleState]()
    found, alone = NeighbourMap(1, PARAMS), NeighbourMap(1, PARAMS)
    arrived_ns: dict[tuple[int, int], int] = {}
    for step in range(400):
        now_ms = 60 * step
        now_ns = NS + now_ms * MS
        data = faithful_packet(rng, now_ms, states)
        # it attacks in the first part, and is silent after it
        attack = [attacker.packet(now_ms) for _ in range(4)] if step < 250 else []
        for packet in [*attack[:2], data, *attack[2:]]:
            code = found.receive(packet, now_ns + int(rng.integers(-5, 5)) * MS * (packet is not data))
            if packet is data:
                assert code == ""
                assert alone.receive(data, now_ns) == ""
            if code == "":
                note(arrived_ns, packet, now_ns)
        attacker.heard.append(data)
        if step % 10:
            continue
        check_bounds(found)
        got, expected = found.obstacles(OWN, now_ns), of_true(alone.obstacles(OWN, now_ns))
        for sender, number in zip(got.sender.tolist(), got.ids.tolist(), strict=True):
            assert now_ns - arrived_ns[sender, number] <= (PARAMS.expire_s + 0.1) * NS
        there = of_true(got)
        for number, plane in expected.items():
            assert number in there or may_be_a_vehicle(plane, got), (seed, step, plane)
            assert number not in there or np.array_equal(there[number], plane)
        check_client(got, rng)
    last = found.obstacles(OWN, NS + 60 * 399 * MS)
    assert set(last.sender.tolist()) == {TRUE}, "the others are silent for longer than expire_s"
    assert {m.sender for m in last.movers} <= {TRUE}
    assert len(of_true(last)) >= 10


def note(arrived_ns: dict[tuple[int, int], int], packet: bytes, now_ns: int) -> None:
    content = decoded(packet)
    if isinstance(content.content, SharedPlanes):
        for number in content.content.ids.tolist():
            arrived_ns[content.header.vehicle, number] = now_ns


@pytest.mark.parametrize("form", [SHORT, LONG])
def test_each_cut_and_each_bit_of_a_packet_is_refused_or_adds_only(form: PlaneForm) -> None:
    rng = np.random.default_rng(3)
    good = planes_packet(Header(vehicle=3, stream=STREAM, sent_ms=5, section=0), some_planes(rng, 3), ANCHOR, form)
    damaged = [good[:n] for n in range(len(good))]
    for bit in range(8 * len(good)):
        data = bytearray(good)
        data[bit // 8] ^= 1 << bit % 8
        damaged.append(bytes(data))
    for data in damaged:
        try:
            packet = decoded(data)
        except PacketError:
            continue
        if isinstance(packet.content, SharedPlanes):
            assert np.isfinite(packet.content.box).all()
            assert (packet.content.box[:, 4] < packet.content.box[:, 5]).all()
            assert (packet.content.margin_m >= 0.0).all()
            assert len(data) >= OVERHEAD_BYTES
