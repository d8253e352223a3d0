"""Lives of a sender: it starts again, is silent, its position jumps, its origin is corrected, it is aligned, its packets are late, lost
and sent again by others, and the own position jumps. What is accepted stays until it expires, and nothing is published elsewhere than
where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from core.sharing.neighbour import FrameReports, Neighbour
from core.sharing.neighbour_map import NeighbourMap, OwnState
from core.sharing.packet_codec import decoded, state_packet
from core.sharing.params import SharingParams
from core.sharing.placement import Placement
from core.sharing.records import Header, LocalFrame, SharedPlanes, VehicleState
from core.sharing.send_budget import Budget
from core.sharing.send_queue import Offer, SendQueue

Floats = NDArray[np.float64]
NS, MS = 1_000_000_000, 1_000_000
STEP_NS = NS // 10
PARAMS = SharingParams(expire_s=30.0)
BUDGET = Budget(bytes_per_s=1000.0, overhead_bytes=30, packet_bytes=128, refresh_s=8.0)
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.0, 8.0, 400.0
WALLS, SLOTS, SENDER = 40, 12, 2
SILENCE_NS = 11 * NS


def walls(rng: np.random.Generator) -> Floats:
    """(WALLS, 6) planes in north, east, down at the reference: too high for a vehicle."""
    begin, angle = rng.uniform(-40.0, 40.0, (WALLS, 2)), rng.uniform(0.0, math.tau, WALLS)
    length_m = rng.uniform(3.0, 6.0, WALLS)
    end = begin + length_m[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([begin, end, np.full(WALLS, -6.0), np.zeros(WALLS)])


@dataclass(frozen=True, slots=True)
class Place:
    """A local frame: its origin relative to the reference, in m, and the direction of its x axis."""

    north_m: float
    east_m: float
    up_m: float
    yaw_rad: float

    @classmethod
    def some(cls, rng: np.random.Generator) -> Place:
        north_m, east_m, up_m = rng.uniform(-60.0, 60.0, 3).tolist()
        return cls(north_m, east_m, up_m, float(rng.uniform(-3.0, 3.0)))

    def boxes(self, true: Floats) -> Floats:
        """True planes (N, 6) in this frame."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        out = true.copy()
        for k in (0, 2):
            x, y = true[:, k] - self.north_m, true[:, k + 1] - self.east_m
            out[:, k], out[:, k + 1] = c * x + s * y, c * y - s * x
        out[:, 4:] += self.up_m
        return out

    def stated(self) -> LocalFrame:
        """As the vehicle states it."""
        e2, lat = 0.00669437999014, math.radians(LATITUDE_DEG)
        w = math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
        meridian_m = 6_378_137.0 * (1.0 - e2) / w**3 + ALTITUDE_M
        normal_m = 6_378_137.0 / w + ALTITUDE_M
        return LocalFrame(
            latitude_deg=LATITUDE_DEG + math.degrees(self.north_m / meridian_m),
            longitude_deg=LONGITUDE_DEG + math.degrees(self.east_m / (normal_m * math.cos(lat))),
            altitude_m=ALTITUDE_M + self.up_m,
            yaw_rad=self.yaw_rad,
            sigma_m=0.3,
            sigma_z_m=0.3,
            sigma_yaw_rad=0.02,
        )

    def state(self) -> VehicleState:
        """A vehicle at the reference, 3 m above it."""
        x, y, _, _, z, _ = self.boxes(np.array([[0.0, 0.0, 0.0, 0.0, -3.0, 0.0]]))[0].tolist()
        return VehicleState(frame=self.stated(), position_m=(x, y, z), velocity_m_s=(0.0, 0.0, 0.0), radius_m=0.4)


class Sender:
    """A vehicle that observes walls. slots: the wall of each number."""

    def __init__(self, rng: np.random.Generator, true: Floats) -> None:
        self.rng, self.true = rng, true
        self.place, self.section, self.stream = Place.some(rng), 0, 1_700_000_000
        self.silent_until_ns = 0
        self.slots = rng.permutation(WALLS)[:SLOTS]
        self.queue = SendQueue(SENDER, self.stream, 0, BUDGET)
        self.wall_of: dict[tuple[int, int, int], int] = {}  # by stream, time sent and number

    def event(self, now_ns: int) -> None:
        """Something happens to it."""
        kind = self.rng.integers(0, 5)
        if kind == 0:  # a restart, sometimes with a clock that was set back
            later = self.rng.random() < 0.7
            self.stream += 100 if later else -7
            self.silent_until_ns = now_ns + (NS if later else SILENCE_NS)
            self.queue = SendQueue(SENDER, self.stream, now_ns, BUDGET)
        elif kind == 1:
            self.silent_until_ns = now_ns + int(self.rng.integers(1, 20)) * NS
        if kind in (0, 2):  # the position jumps, and the world begins anew
            self.section += 1
            self.slots = self.rng.permutation(WALLS)[:SLOTS]
        if kind in (0, 2, 3):  # 3: only the origin is corrected
            self.place = Place.some(self.rng)
        if kind == 4:  # a number is used again
            self.slots[self.rng.integers(0, SLOTS)] = self.rng.integers(0, WALLS)

    def packets(self, now_ns: int) -> list[bytes]:
        ages = self.rng.uniform(0.0, 0.1, SLOTS)
        planes = SharedPlanes(
            ids=np.arange(SLOTS, dtype=np.uint16),
            box=self.place.boxes(self.true[self.slots]),
            margin_m=np.full(SLOTS, 0.1),
            flags=np.zeros(SLOTS, np.uint8),
            age_s=ages,
        )
        offer = Offer(planes=planes, movers=(), state=self.place.state(), section=self.section)
        sent = self.queue.packets(offer, now_ns) if now_ns >= self.silent_until_ns else []
        for data in sent:
            packet = decoded(data)
            if isinstance(packet.content, SharedPlanes):
                for number in packet.content.ids.tolist():
                    self.wall_of[packet.header.stream, packet.header.sent_ms, number] = int(self.slots[number])
        return sent


@dataclass(slots=True)
class Expected:
    """Walls that must be published: by the frame of the report as the map holds it, and number, (wall, accepted at)."""

    walls: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    frames: list[FrameReports] = field(default_factory=list)  # all, so that no identity is used again

    def note(self, sender: Sender, neighbour: Neighbour, data: bytes, now_ns: int) -> None:
        """After a packet that was accepted."""
        packet = decoded(data)
        if not any(frame is neighbour.present for frame in self.frames):
            self.frames.append(neighbour.present)
        if isinstance(packet.content, SharedPlanes):
            for number in packet.content.ids.tolist():
                wall = sender.wall_of[packet.header.stream, packet.header.sent_ms, number]
                self.walls[id(neighbour.present), number] = wall, now_ns

    def now(self, now_ns: int) -> set[int]:
        """Those in frames whose state was received."""
        placed = {id(frame) for frame in self.frames if frame.state is not None}
        fresh_ns = now_ns - round(PARAMS.expire_s * NS)
        return {wall for (frame, _), (wall, at_ns) in self.walls.items() if frame in placed and at_ns > fresh_ns}


def aligned(sender: Sender, own: Place, rng: np.random.Generator) -> Placement:
    """The place of the sender's frame as a fit finds it, with its error."""
    x, y, z = (float(v) for v in own.boxes(np.array([[0.0, 0.0, 0.0, 0.0, -3.0, 0.0]]))[0, [0, 1, 4]])
    return Placement(
        yaw_rad=math.remainder(sender.place.yaw_rad - own.yaw_rad, math.tau),
        pivot_m=sender.place.state().position_m,
        at_m=(x + float(rng.uniform(-0.1, 0.1)), y, z),
        sigma_m=0.2,
        sigma_z_m=0.15,
        sigma_yaw_rad=0.01,
        refined=True,
    )


def check(found: NeighbourMap, own: Place, state: OwnState, true: Floats, must: set[int], now_ns: int) -> int:
    """Each published plane is a wall at its place, and those that must be are published. Returns their number."""
    got = found.obstacles(state, now_ns)
    here = own.boxes(true)
    there: set[int] = set()
    for plane, margin_m in zip(got.planes.astype(float), got.margin_m.astype(float), strict=True):
        apart_m = np.maximum(*(np.hypot(here[:, k] - plane[k], here[:, k + 1] - plane[k + 1]) for k in (0, 2)))
        at = (apart_m <= margin_m + 0.01) & (plane[4] <= here[:, 4] + 0.01) & (plane[5] >= here[:, 5] - 0.01)
        assert at.any(), f"{plane} at {now_ns / NS:.1f} s is no wall, or not at its place"
        there |= set(np.flatnonzero(at).tolist())
    assert must <= there, f"{must - there} at {now_ns / NS:.1f} s"
    return len(must)


@pytest.mark.parametrize("replays", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_what_is_accepted_stays_at_its_place_until_it_expires(seed: int, replays: bool) -> None:
    rng = np.random.default_rng([seed, replays])
    true = walls(rng)
    sender, own, found, expected = Sender(rng, true), Place.some(rng), NeighbourMap(1, PARAMS), Expected()
    waiting: list[tuple[int, int, bytes]] = []
    heard: list[bytes] = []
    estimate = seen = 0
    for step in range(2400):
        now_ns = NS + step * STEP_NS
        if rng.random() < 0.01:
            sender.event(now_ns)
        for data in sender.packets(now_ns):
            waiting.append((now_ns + int(rng.integers(0, 400)) * MS, len(heard), data))
            heard.append(data)
        if replays and heard:  # recordings, most of them in the order in which they were heard
            begin = int(rng.integers(0, len(heard)))
            waiting += [(now_ns, -1, data) for data in heard[begin : begin + int(rng.choice([0, 1, 8]))]]
        if rng.random() < 0.003:  # the own position jumps
            own, estimate = Place.some(rng), estimate + 1
        state = OwnState(state=own.state(), section=1, estimate=(estimate,))
        found.obstacles(state, now_ns)  # follows the jump before anything is placed
        arrived = sorted(entry for entry in waiting if entry[0] <= now_ns)
        waiting = [entry for entry in waiting if entry[0] > now_ns]
        for at_ns, _, data in arrived:
            if (rng.random() < 0.1 and not replays) or found.receive(data, at_ns, SENDER):
                continue
            expected.note(sender, found._neighbours[SENDER], data, at_ns)
        neighbour = found._neighbours.get(SENDER)
        if neighbour is None or step % 5:
            continue
        frame = neighbour.present.state
        if frame is not None and frame.frame == decoded_frame(sender) and rng.random() < 0.05:
            neighbour.present.aligned, neighbour.present.aligned_ns = aligned(sender, own, rng), now_ns
        seen += check(found, own, state, true, expected.now(now_ns), now_ns)
    assert seen > 2000
    end_ns = NS + 2400 * STEP_NS + round(PARAMS.expire_s * NS)
    assert len(found.obstacles(state, end_ns + NS).sender) == 0


def decoded_frame(sender: Sender) -> LocalFrame:
    """The frame of the sender as receivers have it."""
    packet = decoded(state_packet(Header(vehicle=SENDER, stream=1, sent_ms=0, section=0), sender.place.state()))
    assert isinstance(packet.content, VehicleState)
    return packet.content.frame
