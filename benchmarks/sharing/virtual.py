"""All vehicles and the radio in one process and in simulated time: the same flights, codecs, queues and maps as in `vehicle.py`,
with figures that do not depend on the load of the machine. The same seed gives the same figures."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.sharing.flights import HZ, Part, Seen
from benchmarks.sharing.radio import Channel, Traffic
from benchmarks.sharing.vehicle import COMPONENT, KEY, REST_S, Outcome, samples_at
from companion.config.share import ShareConfig
from companion.share.own_motion import Motion
from companion.share.own_planes import own_planes
from companion.share.sharing_thread import OWN_PLANES_NS, SEND_NS, STEP_S, is_due
from companion.share.team import Team
from core.sharing.send_budget import Budget
from core.world.world import Observation, World
from drivers.mavlink.signing import Signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.sharing.tunnel import PAYLOAD_BYTES, TunnelCodec

NS = 1_000_000_000
STEP_NS = round(STEP_S * NS)
UNIX_NS = 1_790_000_000 * NS


@dataclass(slots=True)
class Radio:
    """The channel in simulated time."""

    channel: Channel
    rng: np.random.Generator
    traffic: Traffic
    free_ns: int = 0
    waiting: list[tuple[int, int, int, bytes]] = field(default_factory=list)
    number: int = 0

    def send(self, sender: int, data: bytes, now_ns: int) -> None:
        """A datagram of a vehicle."""
        self.traffic.sent[sender].append((now_ns, len(data)))
        if self.free_ns - now_ns > self.channel.queue_s * NS:
            self.traffic.dropped += 1
            return
        self.free_ns = max(self.free_ns, now_ns) + round(len(data) / self.channel.bytes_per_s * NS)
        heapq.heappush(self.waiting, (self.free_ns + round(self.channel.delay_s * NS), self.number, sender, data))
        self.number += 1

    def arrived(self, receivers: int, now_ns: int) -> list[tuple[int, bytes, int]]:
        """(receiver, datagram, time) of what has arrived by now."""
        found = []
        while self.waiting and self.waiting[0][0] <= now_ns:
            at_ns, _, sender, data = heapq.heappop(self.waiting)
            for receiver in range(receivers):
                if receiver == sender:
                    continue
                if self.rng.random() < self.channel.loss:
                    self.traffic.lost += 1
                else:
                    found.append((receiver, data, at_ns))
        return found


class VirtualVehicle:
    """One vehicle."""

    def __init__(self, number: int, part: Part, bytes_per_s: float, begin_ns: int, clock_ns: list[int]) -> None:
        lat, lon, alt = part.error.origin()
        config = ShareConfig(
            enabled=True, vehicle=number, origin=f"{lat:.9f}, {lon:.9f}, {alt}", tunnel_bytes_per_s=bytes_per_s
        )
        self._config, self._frames, self._begin_ns = config, part.seen, begin_ns
        signing = Signing(SigningKey(KEY), SigningClock(wall_ns=lambda: UNIX_NS + clock_ns[0]))
        self.codec = TunnelCodec(COMPONENT, signing)
        budget = Budget(
            bytes_per_s=bytes_per_s,
            overhead_bytes=self.codec.overhead_bytes,
            packet_bytes=PAYLOAD_BYTES,
            refresh_s=config.refresh_s,
        )
        self.team = Team(config, number, 1_700_000_000, begin_ns, 0.4, {"tunnel": budget})
        self.world, self.outcome = World(), Outcome(number)
        self._taken = 0
        self._published_ns, self._has_new = 0, False

    def step(self, now_ns: int) -> list[bytes]:
        """What it sends at this instant."""
        self._fly(now_ns)
        team = self.team
        if now_ns % OWN_PLANES_NS == 0:
            c = self._config
            team.own.planes = own_planes(self.world, now_ns, c.least_hits, c.range_m, c.send_planes)
        packets = team.packets(now_ns).get("tunnel", []) if now_ns % SEND_NS == 0 else []
        team.align(now_ns)
        if is_due(self._published_ns, now_ns, has_new=self._has_new):
            self._published_ns, self._has_new = now_ns, False
            self.outcome.shared = team.obstacles(now_ns)
            self.outcome.received.published_ns.append(now_ns)
        return [self.codec.encoded(packet, team.vehicle) for packet in packets]

    def receive(self, data: bytes, arrival_ns: int) -> None:
        """A datagram."""
        for packet in self.codec.decoded(data, arrival_ns):
            if not self.team.receive(packet.data, arrival_ns, packet.sender):
                self.outcome.note(packet.data, arrival_ns)
                self._has_new = True

    def end(self, now_ns: int) -> Outcome:
        """What it has measured."""
        picture = self.world.picture(now_ns)
        self.outcome.own, self.outcome.own_ids = picture.planes.astype(np.float64), picture.slots
        self.outcome.own_margin_m = picture.margin_m.astype(np.float64)
        self.outcome.counts = dict(self.team.map.counts)
        return self.outcome

    def _fly(self, now_ns: int) -> None:
        due, end = int((now_ns - self._begin_ns) / NS * HZ) + 1, len(self._frames) - 1
        while self._taken < due:
            self._frame(self._frames[min(self._taken, end)], now_ns)  # it hovers in the end
            self._taken += 1
        at = min(self._taken - 1, end)
        before, last = self._frames[max(0, at - 1)].place_m, self._frames[at].place_m
        flying = 0 < at < end
        velocity = [HZ * (b - a) if flying else 0.0 for a, b in zip(before, last, strict=True)]
        self.team.own.motion = Motion(*samples_at(now_ns, last, (velocity[0], velocity[1], velocity[2])))

    def _frame(self, seen: Seen, now_ns: int) -> None:
        self.world.add(Observation(model=seen.model, place_m=seen.place_m, t_ns=now_ns))
        self.outcome.confirmed.note(self.world, self._config.least_hits, now_ns)


def play(parts: Sequence[Part], bytes_per_s: float, channel: Channel, seed: int) -> tuple[list[Outcome], Traffic, int]:
    """(what each vehicle measured, what was sent, begin of the flight)."""
    begin_ns, clock_ns = NS, [NS]
    traffic = Traffic(sent=[[] for _ in parts])
    radio = Radio(channel, np.random.Generator(np.random.PCG64([seed, 24])), traffic)
    vehicles = [VirtualVehicle(k + 1, part, bytes_per_s, begin_ns, clock_ns) for k, part in enumerate(parts)]
    seconds = max(len(part.seen) for part in parts) / HZ + REST_S
    for step in range(round(seconds * NS / STEP_NS)):
        clock_ns[0] = now_ns = begin_ns + step * STEP_NS
        for receiver, data, at_ns in radio.arrived(len(parts), now_ns):
            vehicles[receiver].receive(data, at_ns)
        for k, vehicle in enumerate(vehicles):
            for data in vehicle.step(now_ns):
                radio.send(k, data, now_ns)
    return [vehicle.end(clock_ns[0]) for vehicle in vehicles], traffic, begin_ns
