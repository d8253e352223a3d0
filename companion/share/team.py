"""One vehicle of a team, without thread, clock or link: own observations and packets in, packets and obstacles out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

from core.sharing.neighbour_map import NeighbourMap, OwnState, own_frame
from core.sharing.obstacles import SharedObstacles
from core.sharing.records import LocalFrame, SharedMover, SharedPlanes, VehicleState
from core.sharing.send_budget import Budget
from core.sharing.send_queue import Offer, SendQueue
from core.sharing.whole_views import WholeViews
from core.types import PoseSample

from ..config.share import ShareConfig
from .own_motion import STALE_NS, Motion
from .own_planes import OwnPlanes

NS: Final = 1_000_000_000
PLANES_NS: Final = NS
"""Planes of a world without a newer frame are neither sent nor used to align."""
ALIGN_NS: Final = 2 * NS
"""Interval of the fits of each neighbour. They are spread over it, because nothing is sent during a fit."""
ALIGN_PLANES: Final = 300
"""Own planes that a neighbour's are compared with, the nearest."""


@dataclass(slots=True)
class OwnSide:
    """What is known of the own vehicle."""

    origin: tuple[float, float, float] | None = None  # latitude, longitude (deg), altitude (m)
    motion: Motion = field(default_factory=Motion)  # newest position and attitude
    planes: OwnPlanes = field(default_factory=lambda: OwnPlanes(SharedPlanes.empty(), 0))  # of the own world
    movers: tuple[SharedMover, ...] = ()  # of the own sensors
    movers_ns: int = 0  # instant of their ages


class Team:
    """A vehicle with its neighbours.

    vehicle: own number, 1..255; stream: number of this start, larger than those of all starts before; budgets: by the
    name of the link."""

    def __init__(
        self, config: ShareConfig, vehicle: int, stream: int, begun_ns: int, radius_m: float, budgets: dict[str, Budget]
    ) -> None:
        self.own = OwnSide(origin=config.fixed_origin())
        self.map = NeighbourMap(vehicle, config, config.member_numbers())
        self.vehicle = vehicle
        self._config, self._radius_m = config, radius_m
        self.queues = {name: SendQueue(vehicle, stream, begun_ns, budget) for name, budget in budgets.items()}
        self._views = WholeViews()
        self._align_ns = -(1 << 62)

    def receive(self, data: bytes, arrival_ns: int, sender: int | None) -> str:
        """Takes a packet; returns the code of its refusal, empty: it was accepted."""
        return self.map.receive(data, arrival_ns, sender)

    def packets(self, now_ns: int) -> dict[str, list[bytes]]:
        """Returns the packets that each link sends now: none before the own frame and position are known."""
        own = self.state(now_ns)
        if own.state is None:
            return {}
        others = tuple(body for body in self.map.bodies(own, now_ns) if body.vehicle != self.vehicle)
        planes = self._views.planes(self._planes(now_ns), own.state.position_m, own.section, others)
        offer = Offer(
            planes=planes,
            movers=self._views.movers(self._movers(now_ns), planes.box, own.state.position_m, others),
            state=own.state,
            section=own.section,
            others=others,
        )
        packets = {name: queue.packets(offer, now_ns) for name, queue in self.queues.items()}
        for some in packets.values():
            self.map.note_sent(some)
        return packets

    def align(self, now_ns: int) -> bool:
        """Aligns the frame of a neighbour, each one every ALIGN_NS; returns whether it did."""
        if now_ns - self._align_ns < ALIGN_NS // max(1, self.map.vehicles):
            return False
        self._align_ns = now_ns
        self.map.align(self._planes(now_ns).box[:ALIGN_PLANES], self.state(now_ns), now_ns)
        return True

    def obstacles(self, now_ns: int) -> SharedObstacles:
        """Returns what neighbours have reported, in the own ned."""
        return self.map.obstacles(self.state(now_ns), now_ns)

    def state(self, now_ns: int) -> OwnState:
        """Returns the own state for the map."""
        frame, pose = self.frame, self.own.motion.pose_at(now_ns)
        state: VehicleState | None = None
        if frame is not None and pose is not None and self._is_in_section():
            velocity = pose.velocity_ned_m_s or (0.0, 0.0, 0.0)
            state = VehicleState(
                frame=frame, position_m=_moved(pose, now_ns), velocity_m_s=velocity, radius_m=self._radius_m
            )
        return OwnState(state=state, section=self.own.planes.section, estimate=self.own.motion.estimate)

    @property
    def frame(self) -> LocalFrame | None:
        """Own frame on Earth; None: not known."""
        return None if self.own.origin is None else own_frame(self._config, *self.own.origin)

    def _is_in_section(self) -> bool:
        """False between a jump of the own position or heading and the first frame in the own world after it: until then
        the number of the section is that of the frame before the jump."""
        return self.own.planes.newest_ns == 0 or self.own.planes.newest_ns >= self.own.motion.jump_ns

    def _planes(self, now_ns: int) -> SharedPlanes:
        """Returns the own planes; none of a world that is not updated."""
        own = self.own.planes
        return own.planes if now_ns - own.newest_ns <= PLANES_NS else SharedPlanes.empty()

    def _movers(self, now_ns: int) -> tuple[SharedMover, ...]:
        """Returns the own moving obstacles with their ages at now_ns."""
        passed_s = (now_ns - self.own.movers_ns) / NS
        aged = (replace(m, age_s=m.age_s + max(0.0, passed_s)) for m in self.own.movers)
        return tuple(m for m in aged if m.age_s <= self._config.mover_expire_s)


def _moved(pose: PoseSample, now_ns: int) -> tuple[float, float, float]:
    """Returns the position moved to now_ns by its velocity, by STALE_NS at most."""
    seconds = min(max(0, now_ns - pose.t_ns), STALE_NS) / NS
    (x, y, z), (vx, vy, vz) = pose.position_ned_m, pose.velocity_ned_m_s or (0.0, 0.0, 0.0)
    return x + vx * seconds, y + vy * seconds, z + vz * seconds
