"""Obstacles that neighbours have reported, separate from the own model.

`receive` takes packets of any origin: damaged, replayed and delayed packets and those of other vehicles are refused
and counted. `obstacles` returns the obstacles that count now, in the own frame. The own model is never changed."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bodies import Body, MovingReport, are_bodies
from .neighbour import NS, FrameReports, Neighbour
from .obstacles import (
    MoverKind,
    NeighbourStatus,
    PlacementState,
    SharedMovingObstacle,
    SharedObstacles,
    placed_planes,
)
from .packet_codec import decoded
from .params import SharingParams
from .placement import Floats, Placement
from .records import LocalFrame, Packet, PacketError, SharedMover, VehicleState

VEHICLE_ID = 0xFFFF
"""Number of the moving obstacle that represents the neighbour itself."""
ALIGNED_Z_M = 0.5
"""Standard deviation of a height that is not left to the positions."""
GROWTH_M_S2 = 2.0
"""Acceleration by which margins of moving obstacles grow."""
OWN_PACKETS = 1024
"""Number of own packets that are known when they come back: those of ten seconds at any data rate, of minutes at 300 B/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnState:
    """State of the own vehicle."""

    state: VehicleState | None  # None: the place of its frame on Earth is not known
    section: int  # number of the own frame
    estimate: tuple[int, ...] = ()  # numbers that change when the own position or heading has jumped, or may have


class NeighbourMap:
    """Map of the reports of all neighbours.

    own_vehicle: own number, 1..255; members: numbers of the accepted vehicles, empty: all. same_number_ns: arrival of the
    newest packet of another vehicle with the own number; None: there was none."""

    def __init__(
        self, own_vehicle: int, params: SharingParams | None = None, members: frozenset[int] = frozenset()
    ) -> None:
        self.params, self._own_vehicle, self._members = params or SharingParams(), own_vehicle, members
        self._sent: deque[bytes] = deque(maxlen=OWN_PACKETS)
        self._neighbours: dict[int, Neighbour] = {}
        self._own: tuple[int, tuple[int, ...], LocalFrame | None] = -1, (), None
        self.counts: Counter[str] = Counter()
        self.same_number_ns: int | None = None

    def note_sent(self, packets: Iterable[bytes]) -> None:
        """Takes own packets before they are sent: a link may return them. Others with the own number are of another
        vehicle, even one that has started in the same second."""
        self._sent.extend(packets)

    def receive(self, data: bytes, arrival_ns: int, sender: int | None = None) -> str:
        """Takes a packet; returns why it is refused, as a code, or "". sender: the vehicle by the transport; None:
        not known."""
        try:
            packet = decoded(data)
        except PacketError as error:
            return self._refuse(error.code)
        vehicle = packet.header.vehicle
        if vehicle == self._own_vehicle:
            if data in self._sent:
                return self._refuse("own_packet")
            self.same_number_ns = arrival_ns
            return self._refuse("same_number")
        if sender is not None and sender != vehicle:
            return self._refuse("sender_mismatch")
        if self._members and vehicle not in self._members:
            return self._refuse("unknown_sender")
        return self._take(packet, arrival_ns)

    def _take(self, packet: Packet, arrival_ns: int) -> str:
        neighbour = self._neighbours.get(packet.header.vehicle)
        if neighbour is None:
            if len(self._neighbours) >= self.params.most_neighbours and not self._make_room(arrival_ns):
                return self._refuse("too_many_neighbours")
            neighbour = self._neighbours[packet.header.vehicle] = Neighbour.first(packet.header, arrival_ns)
        code = neighbour.refusal(packet, arrival_ns, self.params)
        if code:
            neighbour.refused += 1
            return self._refuse(code)
        neighbour.take(packet, arrival_ns, self.params)
        self.counts["accepted"] += 1
        return ""

    @property
    def vehicles(self) -> int:
        """Number of neighbours."""
        return len(self._neighbours)

    def align(self, own_box: Floats, own: OwnState, now_ns: int) -> None:
        """Refines the place of the frame of one neighbour by own planes, (N, 6) in the own frame: of that whose newest
        fit is the oldest."""
        self._follow(own)
        if own.state is None or not self.params.align or not self._neighbours:
            return
        neighbour = min(self._neighbours.values(), key=lambda n: (n.fitted_ns, n.vehicle))
        neighbour.expire(now_ns, self.params)
        neighbour.align(own_box, own.state.frame, now_ns)

    def obstacles(self, own: OwnState, now_ns: int) -> SharedObstacles:
        """Returns the obstacles that count now."""
        parts, movers, statuses = [], [], []
        bodies = self.bodies(own, now_ns)  # follows a jump of the own frame
        for _, neighbour in sorted(self._neighbours.items()):
            neighbour.expire(now_ns, self.params)
            found, moving, status = self._placed(neighbour, own, bodies, now_ns)
            statuses.append(status)
            movers += moving
            parts += found
        return _joined(parts, tuple(movers), tuple(statuses), now_ns)

    def bodies(self, own: OwnState, now_ns: int) -> list[Body]:
        """Returns the vehicles of the team in the own frame whose place is certain enough, the own one first."""
        self._follow(own)
        found = []
        if own.state is not None:
            vx, vy, _ = own.state.velocity_m_s
            position_m, radius_m = own.state.position_m, own.state.radius_m
            found.append(Body(self._own_vehicle, position_m, radius_m, 0.0, (vx, vy), is_own=True))
        for _, neighbour in sorted(self._neighbours.items()):
            placement = self._placement(neighbour, own)
            body = self._body(neighbour, placement, now_ns)
            if body is not None and placement is not None:
                found.append(_body_of(body, placement))
        return found

    def _placed(
        self,
        neighbour: Neighbour,
        own: OwnState,
        bodies: list[Body],
        now_ns: int,
    ) -> tuple[list[dict[str, NDArray[Any]]], list[SharedMovingObstacle], NeighbourStatus]:
        """Returns the planes, the moving obstacles and the state of one neighbour."""
        vehicle, placement = neighbour.vehicle, self._placement(neighbour, own)
        # a vehicle does not observe itself: what it reports beside itself is something else
        bodies = [body for body in bodies if body.vehicle != vehicle]
        frames = self._frames_of(neighbour, own)
        parts = [self._planes_of(vehicle, reports, place, bodies, now_ns) for reports, place in frames]
        movers = [m for reports, place in frames for m in self._movers_of(vehicle, reports, place, bodies, now_ns)]
        body = self._body(neighbour, placement, now_ns)
        if body is not None:
            movers.append(body)
        count = sum(len(part["sender"]) for part in parts)
        status = NeighbourStatus(
            vehicle=vehicle,
            silent_s=_age_s(neighbour.received_ns, now_ns),
            placement=_state_of(placement, self.params.max_sigma_m),
            fit="" if neighbour.last_fit is None else str(neighbour.last_fit.result.value),
            sigma_m=math.inf if placement is None else placement.sigma_m,
            planes=count,
            movers=len(movers),
            withheld=sum(len(reports.planes) for reports in (neighbour.present, *neighbour.former)) - count,
            packets=neighbour.packets,
            refused=neighbour.refused,
            vehicle_m=None if body is None else body.centre_m,
        )
        return parts, movers, status

    def _frames_of(self, neighbour: Neighbour, own: OwnState) -> list[tuple[FrameReports, Placement]]:
        """Returns the reports of the present frame and of former ones whose place is known well enough, and that place."""
        if own.state is None:
            return []
        placed = [(reports, reports.placement(own.state.frame)) for reports in (neighbour.present, *neighbour.former)]
        return [(r, place) for r, place in placed if place is not None and place.sigma_m <= self.params.max_sigma_m]

    def _planes_of(
        self, vehicle: int, reports: FrameReports, placement: Placement, bodies: list[Body], now_ns: int
    ) -> dict[str, NDArray[Any]]:
        held, box = list(reports.planes.items()), reports.boxes()
        error_m = np.array([p.margin_m for _, p in held], np.float64)
        planes, margin_m, sigma_m = placed_planes(box, error_m, placement)
        keep = sigma_m <= self.params.max_sigma_m
        placed, flags = placement.boxes(box), np.array([p.flags for _, p in held], np.uint8)
        for body in bodies:
            keep &= ~are_bodies(body, placed, flags, error_m, margin_m.astype(np.float64), 2.0 * placement.sigma_z_m)
        rows = np.flatnonzero(keep)
        return {
            "sender": np.full(len(rows), vehicle, np.uint8),
            "ids": np.array([held[k][0] for k in rows], np.uint16),
            "planes": planes[rows],
            "margin_m": margin_m[rows],
            "age_s": np.array([_age_s(held[k][1].seen_ns, now_ns) for k in rows], np.float32),
            "flags": flags[rows],
            "aligned": np.full(len(rows), int(placement.refined), np.uint8),
        }

    def _movers_of(
        self, vehicle: int, reports: FrameReports, placement: Placement, bodies: list[Body], now_ns: int
    ) -> list[SharedMovingObstacle]:
        """Returns the moving obstacles of one frame without vehicles of the team."""
        found, candidates = [], []
        for number, held in sorted(reports.movers.items()):
            mover = _placed_mover(vehicle, number, held.mover, placement, _age_s(held.seen_ns, now_ns))
            found.append(mover)
            candidates.append(
                MovingReport(
                    centre_m=mover.centre_m,
                    half_size_m=held.mover.half_size_m,  # without the uncertainty of the height
                    velocity_m_s=mover.velocity_m_s,
                    sigma_m_s=held.mover.sigma_m_s,
                    margin_m=mover.margin_m,
                    margin_z_m=2.0 * placement.sigma_z_m,
                    error_m=2.0 * held.mover.sigma_m,
                    age_s=_age_s(held.seen_ns, now_ns),
                    partial=held.mover.partial,
                )
            )
        for body in bodies:
            k = body.find(candidates)
            if k is not None:
                del found[k], candidates[k]
        return found

    def _body(self, neighbour: Neighbour, placement: Placement | None, now_ns: int) -> SharedMovingObstacle | None:
        """Returns the neighbour itself; None: its place is too old or too uncertain. Then it hides no report, either."""
        state, age_s = neighbour.present.state, _age_s(neighbour.state_ns, now_ns)
        if placement is None or placement.sigma_m > self.params.max_sigma_m:
            return None
        if state is None or age_s > max(2.5, self.params.mover_expire_s):
            return None
        r = state.radius_m
        mover = SharedMover(
            id=VEHICLE_ID,
            centre_m=state.position_m,
            half_size_m=(r, r, r),
            velocity_m_s=(state.velocity_m_s[0], state.velocity_m_s[1]),
            sigma_m=0.1,
            sigma_m_s=0.5,
            age_s=0.0,
        )
        return replace(_placed_mover(neighbour.vehicle, VEHICLE_ID, mover, placement, age_s), kind=MoverKind.VEHICLE)

    def _placement(self, neighbour: Neighbour, own: OwnState) -> Placement | None:
        return None if own.state is None else neighbour.present.placement(own.state.frame)

    def _follow(self, own: OwnState) -> None:
        """Discards the alignments if the own frame has changed, or may have while the own position was not known."""
        known = own.section, own.estimate, own.state.frame if own.state is not None else None
        if known != self._own:
            self._own = known
            for neighbour in self._neighbours.values():
                neighbour.forget_alignment()

    def _make_room(self, now_ns: int) -> bool:
        """Removes the neighbour with the longest silence, if it exceeds expire_s."""
        oldest = min(self._neighbours.values(), key=lambda n: n.received_ns)
        if now_ns - oldest.received_ns <= self.params.expire_s * NS:
            return False
        del self._neighbours[oldest.vehicle]
        return True

    def _refuse(self, code: str) -> str:
        self.counts[code] += 1
        return code


def own_frame(params: SharingParams, latitude_deg: float, longitude_deg: float, altitude_m: float) -> LocalFrame:
    """Returns the own frame with the configured errors. Its axes are north, east, down."""
    return LocalFrame(
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_m=altitude_m,
        sigma_m=params.position_sigma_m,
        sigma_z_m=params.height_sigma_m,
        sigma_yaw_rad=math.radians(params.heading_sigma_deg),
    )


def _age_s(seen_ns: int, now_ns: int) -> float:
    """Returns an age. Packets are stamped in other threads, and may be a little later than now_ns."""
    return max(0, now_ns - seen_ns) / NS


def _state_of(placement: Placement | None, max_sigma_m: float) -> PlacementState:
    if placement is None:
        return PlacementState.UNKNOWN
    if placement.sigma_m > max_sigma_m:
        return PlacementState.WITHHELD
    return PlacementState.ALIGNED if placement.refined else PlacementState.BY_POSITION


def _body_of(vehicle: SharedMovingObstacle, placement: Placement) -> Body:
    """Returns a neighbour as a body."""
    return Body(
        vehicle=vehicle.sender,
        centre_m=vehicle.centre_m,
        radius_m=vehicle.half_size_m[0],
        margin_m=vehicle.margin_m,
        velocity_m_s=vehicle.velocity_m_s,
        margin_z_m=2.0 * placement.sigma_z_m,
        is_aligned=placement.refined and placement.sigma_z_m <= ALIGNED_Z_M,
    )


def _placed_mover(
    vehicle: int, number: int, mover: SharedMover, placement: Placement, age_s: float
) -> SharedMovingObstacle:
    """Returns the mover in the own frame, moved to the present by its velocity. Its margin grows with its age."""
    centre = placement.points(np.array([mover.centre_m]))[0]
    velocity = placement.velocity(mover.velocity_m_s)
    sigma_m = float(placement.sigma_at_m(np.array([mover.centre_m[:2]]))[0])
    moved_m = 2.0 * mover.sigma_m_s * age_s + 0.5 * GROWTH_M_S2 * age_s * age_s
    hx, hy, hz = mover.half_size_m
    c, s = abs(math.cos(placement.yaw_rad)), abs(math.sin(placement.yaw_rad))
    half = (c * hx + s * hy, s * hx + c * hy, hz + 2.0 * placement.sigma_z_m)
    return SharedMovingObstacle(
        sender=vehicle,
        id=number,
        kind=MoverKind.OBSTACLE,
        centre_m=(float(centre[0] + velocity[0] * age_s), float(centre[1] + velocity[1] * age_s), float(centre[2])),
        half_size_m=half,
        velocity_m_s=velocity,
        margin_m=2.0 * math.hypot(mover.sigma_m, sigma_m) + moved_m,
        age_s=age_s,
    )


def _joined(
    parts: list[dict[str, NDArray[Any]]],
    movers: tuple[SharedMovingObstacle, ...],
    statuses: tuple[NeighbourStatus, ...],
    now_ns: int,
) -> SharedObstacles:
    if not parts:
        return replace(SharedObstacles.empty(now_ns), movers=movers, neighbours=statuses)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return SharedObstacles(now_ns=now_ns, movers=movers, neighbours=statuses, **columns)
