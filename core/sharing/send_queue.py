"""Chooses what is sent next within a data rate: new planes, planes near the paths of other vehicles, and complete
planes first.

The planes of the own world are given with an `Offer`; `packets` returns what to send now. A new plane is sent twice
within a fraction of a second, because packets are lost and not acknowledged, and a third time some seconds later. A plane
that has changed is sent at once and again some seconds later. Each is then sent once per `refresh_s`, so that it does
not expire."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..segment_distance import segment_distance_m
from ..types import PlaneFlags
from .bodies import Body, are_bodies
from .cover import covered
from .packet_codec import (
    MOTION_BYTES,
    MOVERS_PER_TUNNEL,
    OVERHEAD_BYTES,
    anchor_of,
    motion_fits,
    mover_fits,
    movers_packet,
    plane_fits,
    planes_packet,
    state_packet,
)
from .plane_codec import LONG, SHORT, Anchor
from .records import PLANE_IDS, Header, LocalFrame, Motion, PacketError, SharedMover, SharedPlanes, VehicleState
from .send_budget import PACKET_S, Budget, SentBytes

NS = 1_000_000_000
REPEATS = 2
"""Number of times a new plane is sent at once."""
REPEAT_NS, LATEST_REPEAT_NS = NS // 10, NS // 4
"""Time between two of these: the least, and that after which a packet is sent for it alone."""
THIRD_NS, LATEST_THIRD_NS = NS, 3 * NS
"""Time until the third copy of a new plane and the second one of a changed plane: the least, and that after which a
packet is sent for it alone."""
CHANGED_NS = NS
"""Least time between two packets with a plane that changes all the time."""
STATE_NS, FIRST_STATES, MOTION_NS, MOVERS_NS = 10 * NS, 3, NS, NS // 4
"""Intervals of the state, after the first ones, of which each has the interval of the motion; of the motion, and of
moving obstacles."""
MOVED_M, GROWN_M = 0.3, 0.5
"""A plane counts as new if an end has moved by MOVED_M beyond what was sent, or its top or bottom outward by GROWN_M."""
NEAR_M = 40.0
"""A plane within this distance of the path of another vehicle is preferred."""
AHEAD_S = 8.0
"""Length of that path."""
LAST_MS = (1 << 32) - 1
NEVER_NS = -(1 << 62)
MOST_PACKETS = 4
"""Greatest number of packets with planes per call."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What may be sent at one instant."""

    planes: SharedPlanes  # planes of the own world; their ids are their slots
    movers: tuple[SharedMover, ...]  # moving obstacles of the own sensors
    state: VehicleState | None  # the own vehicle; None: not known
    section: int  # number of the own frame
    others: tuple[Body, ...] = ()  # the other vehicles in the own frame


class SendQueue:
    """Chooses packets. vehicle: own number; stream: number of this start, greater than that of each earlier start."""

    def __init__(self, vehicle: int, stream: int, begun_ns: int, budget: Budget) -> None:
        most_bytes = round(PACKET_S * budget.bytes_per_s) - budget.overhead_bytes
        budget = replace(budget, packet_bytes=min(budget.packet_bytes, most_bytes))
        self._vehicle, self._stream, self._begun_ns, self._budget = vehicle, stream, begun_ns, budget
        self._boxes = np.zeros((PLANE_IDS, 6))
        self._times = np.zeros(PLANE_IDS, np.int32)
        self._sent_ns = np.full(PLANE_IDS, NEVER_NS, np.int64)
        self._sent_ms, self._next_mover = -1, 0
        self._frame: tuple[int, LocalFrame | None] = -1, None
        self._corrections = 0
        self._sent = SentBytes(budget, begun_ns)
        self._state_ns = self._motion_ns = self._movers_ns = NEVER_NS
        self._states = 0
        self.unencodable = self.sent_bytes = self.sent_packets = 0

    def packets(self, offer: Offer, now_ns: int) -> list[bytes]:
        """Returns the packets to send now; call it about ten times per second."""
        self._sent.follow(now_ns)
        self._follow_frame(offer)
        out: list[bytes] = []
        self._add_state(out, offer, now_ns)
        if offer.movers and now_ns - self._movers_ns >= MOVERS_NS:
            self._movers_ns = now_ns
            self._add_movers(out, offer, now_ns)
        self._add_planes(out, offer, now_ns)
        self._add_motion(out, offer, now_ns)
        return out

    def _follow_frame(self, offer: Offer) -> None:
        """Sends everything anew after a jump of the own position, or a correction of the place of its origin on Earth."""
        section, frame = self._frame
        place = frame if offer.state is None else offer.state.frame
        if (offer.section, place) == (section, frame):
            return
        self._corrections += frame is not None and place != frame
        self._frame, self._states = (offer.section, place), 0
        self._times[:], self._sent_ns[:] = 0, NEVER_NS

    def _add_state(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        state = offer.state
        interval_ns = STATE_NS if self._states >= FIRST_STATES else MOTION_NS
        if state is None or (self._states and now_ns - self._state_ns < interval_ns):
            return
        self._states, self._state_ns, self._motion_ns = self._states + 1, now_ns, now_ns
        self._add(out, now_ns, state_packet, state)

    def _add_motion(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        """Adds a packet with the motion alone if none with planes has contained it."""
        state = offer.state
        if state is None or now_ns - self._motion_ns < MOTION_NS:
            return
        anchor_m = _anchor_at(*state.position_m)
        motion = self._motion(offer, anchor_m)
        if motion is None:  # the state has a greater range
            self._states = 0
            self._add_state(out, offer, now_ns)
            return
        self._motion_ns = now_ns
        self._add(out, now_ns, planes_packet, SharedPlanes.empty(), anchor_m, SHORT, motion)

    def _motion(self, offer: Offer, anchor_m: Anchor) -> Motion | None:
        """Returns the own motion; None: it is not known, or cannot be sent with this anchor."""
        return offer.state if offer.state is not None and motion_fits(offer.state, anchor_m) else None

    def _header(self, now_ns: int) -> Header:
        self._sent_ms = max(self._sent_ms + 1, (now_ns - self._begun_ns) // 1_000_000)
        if self._sent_ms > LAST_MS:  # after 49 days: a new stream
            self._stream, self._begun_ns, self._sent_ms = self._stream + 1, now_ns, 0
        section = self._frame[0] + self._corrections & 0xFF
        return Header(vehicle=self._vehicle, stream=self._stream, sent_ms=self._sent_ms, section=section)

    def _add(self, out: list[bytes], now_ns: int, encode: Callable[..., bytes], *content: object) -> None:
        """Adds the packet encode(header, *content) and deducts it from the budget; counts those that cannot be encoded."""
        try:
            data = encode(self._header(now_ns), *content)
        except PacketError:
            self.unencodable += 1
            return
        out.append(data)
        size = len(data) + self._budget.overhead_bytes
        self._sent.add(size)
        self.sent_bytes += size
        self.sent_packets += 1

    def _add_movers(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        """Adds the nearest moving obstacles. If they do not fit into one packet, they are sent in turns."""
        state = offer.state
        if state is None:
            return
        x, y, _ = state.position_m
        near = sorted(offer.movers, key=lambda m: (math.hypot(m.centre_m[0] - x, m.centre_m[1] - y), m.id))
        anchor_m = _anchor_at(*state.position_m)
        good = [m for m in near if mover_fits(m, anchor_m)]
        self.unencodable += len(near) - len(good)
        begin = self._next_mover % len(good) if len(good) > MOVERS_PER_TUNNEL else 0
        some = tuple((good[begin:] + good[:begin])[:MOVERS_PER_TUNNEL])
        if not some or OVERHEAD_BYTES + 16 * len(some) + self._budget.overhead_bytes > self._sent.room(urgent=True):
            return
        self._next_mover = begin + len(some)
        self._add(out, now_ns, movers_packet, some, anchor_m)

    def _add_planes(self, out: list[bytes], offer: Offer, now_ns: int) -> None:
        planes = offer.planes
        self._forget(planes.ids)
        urgent, paced = self._ranked(offer, now_ns)
        for _ in range(MOST_PACKETS):
            if not self._worth_a_packet(planes, urgent, paced, now_ns):
                return
            rows = np.concatenate([urgent, paced])
            anchor_m = _anchor(planes.box[rows[0]])
            form = SHORT if plane_fits(SHORT, planes, int(rows[0]), anchor_m) else LONG
            motion = self._motion(offer, anchor_m) if now_ns - self._motion_ns >= 3 * MOTION_NS // 4 else None
            used = OVERHEAD_BYTES + (MOTION_BYTES if motion is not None else 0)
            most = (self._budget.packet_bytes - used) // form.bytes
            used += self._budget.overhead_bytes
            room, paced_room = ((self._sent.room(urgent=u) - used) // form.bytes for u in (True, False))
            some = rows[: min(len(urgent), max(0, room)) + max(0, min(len(paced), paced_room - len(urgent)))]
            unsent = int((self._times[planes.ids[urgent]] == 0).sum())
            # Each packet has its overhead: copies wait for a full one, what was never sent does not wait for copies.
            if len(some) < min(most, unsent or len(urgent) or len(paced)):
                return
            fitting = (r for r in some[: 4 * most] if plane_fits(form, planes, int(r), anchor_m))
            chosen = np.array([row for row, _ in zip(fitting, range(min(most, room)), strict=False)], np.intp)
            if not len(chosen) or chosen[0] != rows[0]:  # it fits to no packet
                self.unencodable += 1
                chosen = rows[:1]
            else:
                self._motion_ns = now_ns if motion is not None else self._motion_ns
                self._add(out, now_ns, planes_packet, planes.part(chosen), anchor_m, form, motion)
            self._note(planes, chosen, now_ns)
            urgent, paced = (rest[~np.isin(rest, chosen)] for rest in (urgent, paced))

    def _note(self, planes: SharedPlanes, rows: NDArray[np.intp], now_ns: int) -> None:
        """Records what was sent. A changed plane is repeated in its turn like a new one that was sent REPEATS times."""
        ids = planes.ids[rows]
        changed = _changed(self._boxes[ids], planes.box[rows])
        self._times[ids] = np.where(changed & (self._times[ids] >= REPEATS), REPEATS, self._times[ids] + 1)
        self._boxes[ids], self._sent_ns[ids] = planes.box[rows], now_ns

    def _worth_a_packet(
        self, planes: SharedPlanes, urgent: NDArray[np.intp], paced: NDArray[np.intp], now_ns: int
    ) -> bool:
        """True if something cannot wait for others to fill the packet, each of which has an overhead."""
        full = (self._budget.packet_bytes - OVERHEAD_BYTES - MOTION_BYTES) // SHORT.bytes
        if len(urgent) + len(paced) >= full:
            return True
        ids = planes.ids[urgent]
        waited_ns = now_ns - self._sent_ns[ids]
        if bool(((self._times[ids] == 0) | (waited_ns >= LATEST_REPEAT_NS)).any()):
            return True
        ids = planes.ids[paced]
        longest_ns = np.where(self._times[ids] > REPEATS, round(1.25 * self._budget.refresh_s * NS), LATEST_THIRD_NS)
        return bool((now_ns - self._sent_ns[ids] >= longest_ns).any())

    def _ranked(self, offer: Offer, now_ns: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns the rows of the planes to send at once and those of the planes to repeat, each with the most
        important first."""
        planes, ids = offer.planes, offer.planes.ids
        times, waited_ns = self._times[ids], now_ns - self._sent_ns[ids]
        changed = _changed(self._boxes[ids], planes.box) & (times > 0) & (waited_ns >= CHANGED_NS)
        new = (times < REPEATS) & (waited_ns >= REPEAT_NS) | changed
        new &= ~covered(planes.box, np.flatnonzero(new), self._boxes[ids], times > 0, self._sent_ns[ids])
        refresh_ns = np.where(times > REPEATS, round(self._budget.refresh_s * NS), THIRD_NS)
        due = new | (waited_ns >= refresh_ns)
        # What is not sent no receiver knows: only where the place of the other vehicle is known well.
        for body in (b for b in offer.others if b.is_aligned):
            due &= ~are_bodies(body, planes.box, planes.flags, planes.margin_m)
        cut = (planes.flags & (PlaneFlags.CUT_LEFT | PlaneFlags.CUT_RIGHT)) != 0
        # Order: never sent, sent once, changed; then near other vehicles; then complete; then waiting longest.
        rank = np.where(times < REPEATS, times, np.where(changed, REPEATS, REPEATS + 1))
        # Sent once: the newest first, so that a loss is repaired soon where not all can be sent twice at once.
        turn = np.where(times == 1, waited_ns, -waited_ns)
        order = np.lexsort((np.arange(len(planes)), turn, cut, ~_near(planes.box, offer), rank))
        order = order[due[order]]
        return order[new[order]], order[~new[order]]

    def _forget(self, ids: NDArray[np.uint16]) -> None:
        """Forgets planes that are no longer in the own world: if their number is used again, the plane is new."""
        there = np.zeros(PLANE_IDS, bool)
        there[ids] = True
        gone = (self._times > 0) & ~there
        self._times[gone], self._sent_ns[gone] = 0, NEVER_NS


def _anchor(box: NDArray[np.float64]) -> Anchor:
    """Returns the anchor of a plane (6,)."""
    return _anchor_at(0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]), box[4])


def _anchor_at(x_m: float, y_m: float, z_m: float) -> Anchor:
    """Returns the anchor nearest to a place; the origin if that is too far from it: nothing there can be sent."""
    try:
        return anchor_of(x_m, y_m, z_m)
    except PacketError:
        return 0.0, 0.0, 0.0


def _changed(old: NDArray[np.float64], new: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Returns (N,): planes (N, 6) that have moved or grown enough to be sent again at once: what was sent does not
    contain them. A plane that has become shorter is repeated in its turn."""
    moved_m = np.maximum(*(segment_distance_m(new[:, k : k + 2], old[:, 0:2], old[:, 2:4]) for k in (0, 2)))
    grown_m = np.maximum(old[:, 4] - new[:, 4], new[:, 5] - old[:, 5])
    return np.asarray((moved_m > MOVED_M) | (grown_m > GROWN_M))


def _near(box: NDArray[np.float64], offer: Offer) -> NDArray[np.bool_]:
    """Returns (N,): planes whose middle is near the path of another vehicle."""
    middle = 0.5 * (box[:, 0:2] + box[:, 2:4])
    near = np.zeros(len(box), bool)
    for body in offer.others:
        begin = np.array(body.centre_m[:2])
        near |= segment_distance_m(middle, begin, begin + AHEAD_S * np.array(body.velocity_m_s)) <= NEAR_M
    return near
