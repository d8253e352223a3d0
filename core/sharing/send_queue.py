"""Chooses what is sent next within a data rate: new planes, planes near the paths of other vehicles, and complete
planes first.

The planes of the own world are given with an `Offer`; `packets` returns what to send now. A new plane is sent REPEATS
times, because packets are lost, and later once per `refresh_s`, so that it does not expire."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import PlaneFlags
from .bodies import BODY_SIZE_M, Body, is_body
from .packet_codec import (
    MOVERS_PER_TUNNEL,
    OVERHEAD_BYTES,
    anchor_of,
    mover_fits,
    movers_packet,
    plane_fits,
    planes_packet,
    state_packet,
)
from .plane_codec import PLANE_BYTES, Anchor
from .records import Header, PacketError, SharedMover, SharedPlanes, VehicleState

NS = 1_000_000_000
REPEATS = 2
"""Number of times a new plane is sent at once."""
REPEAT_NS = 3 * NS // 20
"""Least time between two of these."""
CHANGED_NS = NS
"""Least time between two packets with a plane that changes all the time."""
STATE_NS, MOVERS_NS = NS, NS // 4
MOVED_M, GROWN_M = 0.3, 0.5
"""A plane counts as new if an end has moved by MOVED_M, or its top or bottom outward by GROWN_M."""
NEAR_M = 40.0
"""A plane within this distance of the path of another vehicle is preferred."""
AHEAD_S = 8.0
"""Length of that path."""
BURST_S = 0.4
"""The budget of this time may be sent at once."""
WINDOW_S = 10.0
RESERVE_BYTES = 75.0
"""Part of the budget that is kept for new planes while others are repeated."""
MOST_IDS = 1 << 16
LAST_MS = (1 << 32) - 1
NEVER_NS = -(1 << 62)
MOST_WAITING = 8
"""Greatest number of packets per call."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """Budget of a link.

    Attributes:
        bytes_per_s: of all packets, with the overhead of the transport, over ten seconds.
        overhead_bytes: overhead per packet.
        packet_bytes: greatest size of a packet.
        refresh_s: interval in which a plane is repeated."""

    bytes_per_s: float
    overhead_bytes: int
    packet_bytes: int
    refresh_s: float = 20.0

    @property
    def planes_per_packet(self) -> int:
        """Greatest number of planes of one packet."""
        return max(1, (self.packet_bytes - OVERHEAD_BYTES) // PLANE_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What may be sent at one instant.

    Attributes:
        planes: planes of the own world; their ids are their slots.
        movers: moving obstacles of the own sensors.
        state: the own vehicle; None: not known.
        section: number of the own frame.
        others: the other vehicles in the own frame."""

    planes: SharedPlanes
    movers: tuple[SharedMover, ...]
    state: VehicleState | None
    section: int
    others: tuple[Body, ...] = ()


class SendQueue:
    """Chooses packets. vehicle: own number; stream: number of this start, greater than that of each earlier start."""

    def __init__(self, vehicle: int, stream: int, begun_ns: int, budget: Budget) -> None:
        self._vehicle, self._stream, self._begun_ns, self._budget = vehicle, stream, begun_ns, budget
        self._boxes = np.zeros((MOST_IDS, 6))
        self._times = np.zeros(MOST_IDS, np.int32)
        self._sent_ns = np.full(MOST_IDS, NEVER_NS, np.int64)
        self._sent_ms, self._section, self._next_mover = -1, -1, 0
        self._most_tokens = max(
            BURST_S * budget.bytes_per_s, budget.packet_bytes + budget.overhead_bytes + RESERVE_BYTES
        )
        # reduced so that the budget holds in each WINDOW_S, including what may be sent at once
        self._fill_bytes_per_s = max(0.5 * budget.bytes_per_s, budget.bytes_per_s - self._most_tokens / WINDOW_S)
        self._tokens, self._tokens_ns = self._most_tokens, begun_ns
        self._state_ns = self._movers_ns = NEVER_NS
        self.unencodable = self.sent_bytes = self.sent_packets = 0

    def packets(self, offer: Offer, now_ns: int) -> list[bytes]:
        """Returns the packets to send now; call it about ten times per second."""
        self._refill(now_ns)
        if offer.section != self._section:
            self._section, self._state_ns = offer.section, NEVER_NS
            self._times[:], self._sent_ns[:] = 0, NEVER_NS
        out: list[bytes] = []
        if offer.state is not None and now_ns - self._state_ns >= STATE_NS:
            self._state_ns = now_ns
            state = offer.state
            self._add(out, now_ns, lambda header: state_packet(header, state))
        if offer.movers and now_ns - self._movers_ns >= MOVERS_NS:
            self._movers_ns = now_ns
            self._add_movers(out, offer, now_ns)
        self._add_planes(out, offer, now_ns)
        return out

    def _refill(self, now_ns: int) -> None:
        gained = self._fill_bytes_per_s * (now_ns - self._tokens_ns) / NS
        self._tokens, self._tokens_ns = min(self._most_tokens, self._tokens + gained), now_ns

    def _header(self, now_ns: int) -> Header:
        self._sent_ms = max(self._sent_ms + 1, (now_ns - self._begun_ns) // 1_000_000)
        if self._sent_ms > LAST_MS:  # after 49 days: a new stream
            self._stream, self._begun_ns, self._sent_ms = self._stream + 1, now_ns, 0
        return Header(vehicle=self._vehicle, stream=self._stream, sent_ms=self._sent_ms, section=self._section & 0xFF)

    def _add(self, out: list[bytes], now_ns: int, encode: Callable[[Header], bytes]) -> None:
        """Encodes a packet and deducts it from the budget; counts packets that cannot be encoded."""
        try:
            data = encode(self._header(now_ns))
        except PacketError:
            self.unencodable += 1
            return
        out.append(data)
        size = len(data) + self._budget.overhead_bytes
        self._tokens -= size
        self.sent_bytes += size
        self.sent_packets += 1

    def _add_movers(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        """Adds the nearest moving obstacles. If they do not fit into one packet, they are sent in turns."""
        state = offer.state
        if state is None:
            return
        x, y, z = state.position_m
        near = sorted(offer.movers, key=lambda m: (math.hypot(m.centre_m[0] - x, m.centre_m[1] - y), m.id))
        try:
            anchor_m = anchor_of(x, y, z)
        except PacketError:
            self.unencodable += len(near)
            return
        good = [m for m in near if mover_fits(m, anchor_m)]
        self.unencodable += len(near) - len(good)
        begin = self._next_mover % len(good) if len(good) > MOVERS_PER_TUNNEL else 0
        some = tuple((good[begin:] + good[:begin])[:MOVERS_PER_TUNNEL])
        if not some or OVERHEAD_BYTES + 16 * len(some) + self._budget.overhead_bytes > self._tokens:
            return
        self._next_mover = begin + len(some)
        self._add(out, now_ns, lambda header: movers_packet(header, some, anchor_m))

    def _add_planes(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        planes = offer.planes
        self._forget(planes.ids)
        urgent, other = self._ranked(offer, now_ns)
        full = self._budget.planes_per_packet
        while len(out) < MOST_WAITING:
            room = self._room(0.0) if len(urgent) else self._room(RESERVE_BYTES)
            fresh = int((self._times[planes.ids[urgent]] == 0).sum())
            # of many planes full packets: each packet has its overhead
            if room < min(full, fresh or len(urgent) or len(other)):
                return
            if not (len(urgent) or len(other) >= full or self._overdue(planes, other, now_ns)):
                return
            filler = other[: max(0, self._room(RESERVE_BYTES) - len(urgent))]
            rows = np.concatenate([urgent[:room], filler])[: 4 * full]
            anchor_m = _anchor(planes.box[rows[0]])
            chosen = np.array([r for r in rows if plane_fits(planes, int(r), anchor_m)][: min(full, room)], np.intp)
            if not len(chosen) or chosen[0] != rows[0]:  # it fits to no packet
                self.unencodable += 1
                chosen = rows[:1]
            else:
                self._add_part(out, planes.part(chosen), anchor_m, now_ns)
            self._note(planes, chosen, now_ns)
            urgent, other = (rest[~np.isin(rest, chosen)] for rest in (urgent, other))

    def _add_part(self, out: list[bytes], part: SharedPlanes, anchor_m: Anchor, now_ns: int) -> None:
        self._add(out, now_ns, lambda header: planes_packet(header, part, anchor_m))

    def _room(self, reserve_bytes: float) -> int:
        """Returns the number of planes of one packet that the budget allows now."""
        return int((self._tokens - reserve_bytes - self._budget.overhead_bytes - OVERHEAD_BYTES) // PLANE_BYTES)

    def _note(self, planes: SharedPlanes, rows: NDArray[np.intp], now_ns: int) -> None:
        """Records what was sent."""
        ids = planes.ids[rows]
        self._times[ids] += 1
        self._boxes[ids], self._sent_ns[ids] = planes.box[rows], now_ns

    def _overdue(self, planes: SharedPlanes, rows: NDArray[np.intp], now_ns: int) -> bool:
        """True if a plane has waited too long for a full packet."""
        limit_ns = now_ns - round(1.25 * self._budget.refresh_s * NS)
        return bool((self._sent_ns[planes.ids[rows]] <= limit_ns).any())

    def _ranked(self, offer: Offer, now_ns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns the rows of the new planes and those of the planes to repeat, each with the most important first."""
        planes, ids = offer.planes, offer.planes.ids
        times, waited_ns = self._times[ids], now_ns - self._sent_ns[ids]
        changed = _changed(self._boxes[ids], planes.box) & (times > 0) & (waited_ns >= CHANGED_NS)
        new = (times < REPEATS) & (waited_ns >= REPEAT_NS) | changed
        due = new | (waited_ns >= round(self._budget.refresh_s * NS))
        for body in offer.others:
            for row in np.flatnonzero(due & _small(planes.box)):
                due[row] &= not is_body(body, planes.box[row])
        cut = (planes.flags & (PlaneFlags.CUT_LEFT | PlaneFlags.CUT_RIGHT)) != 0
        # Order: never sent, sent once, changed; then near other vehicles; then complete; then waiting longest.
        rank = np.where(times < REPEATS, times, np.where(changed, REPEATS, REPEATS + 1))
        order = np.lexsort((np.arange(len(planes)), -waited_ns, cut, ~_near(planes.box, offer), rank))
        order = order[due[order]]
        return order[new[order]], order[~new[order]]

    def _forget(self, ids: NDArray[np.uint16]) -> None:
        """Forgets planes that are no longer in the own world: if their number is used again, the plane is new."""
        there = np.zeros(MOST_IDS, bool)
        there[ids] = True
        gone = (self._times > 0) & ~there
        self._times[gone], self._sent_ns[gone] = 0, NEVER_NS


def _anchor(box: NDArray[np.float64]) -> Anchor:
    try:
        return anchor_of(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), box[4])
    except PacketError:
        return 0.0, 0.0, 0.0


def _changed(old: NDArray[np.float64], new: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns (N,): planes (N, 6) that have moved or grown enough to be sent again at once."""
    moved_m = [np.hypot(*(new[:, k : k + 2] - old[:, k : k + 2]).T) for k in (0, 2)]
    grown_m = np.maximum(old[:, 4] - new[:, 4], new[:, 5] - old[:, 5])
    return np.asarray((np.maximum(*moved_m) > MOVED_M) | (grown_m > GROWN_M))


def _small(box: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns (N,): planes that are small enough for a side of a vehicle."""
    return np.asarray(np.hypot(box[:, 2] - box[:, 0], box[:, 3] - box[:, 1]) <= 4.0 * BODY_SIZE_M)


def _near(box: NDArray[np.float64], offer: Offer) -> NDArray[np.bool_]:
    """Returns (N,): planes whose middle is near the path of another vehicle."""
    middle = 0.5 * (box[:, 0:2] + box[:, 2:4])
    near = np.zeros(len(box), bool)
    for body in offer.others:
        begin, way = np.array(body.centre_m[:2]), AHEAD_S * np.array(body.velocity_m_s)
        length2 = max(float(way @ way), 1e-9)
        t = np.clip((middle - begin) @ way / length2, 0.0, 1.0)
        off = middle - begin - t[:, None] * way
        near |= np.hypot(off[:, 0], off[:, 1]) <= NEAR_M
    return near
