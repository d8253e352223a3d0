"""The part of the service that shares obstacles: its thread, its links, and what it publishes and records."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

from core.sharing.neighbour_map import own_frame
from core.sharing.obstacles import SharedObstacles
from core.sharing.placement import is_corrected
from core.sharing.records import SharedPlanes
from core.sharing.send_budget import Budget
from core.types import AttitudeSample, PoseSample
from core.world.world import World
from drivers.sharing.link import Deliver, ReceivedPacket, TeamLink
from drivers.watched_thread import WatchedThread
from osape_client.proto import osape_v1_pb2 as pb

from ..config.share import ShareConfig
from ..diagnostic import Diagnostic, DiagnosticCode
from ..pipeline.tracking import TracksResult
from .link_health import LinkHealth
from .messages import neighbour_messages, obstacles_message
from .output import SharingOutput
from .own_motion import OwnMotion
from .own_movers import OwnMovers
from .own_planes import OwnPlanes, own_planes
from .packet_rate import PacketRate
from .team import Team

NS: Final = 1_000_000_000
STEP_S: Final = 0.05
SEND_NS: Final = NS // 10
PUBLISH_NS, SOON_NS = NS // 5, NS // 10
"""Longest time between two publications; and the same if a packet was accepted since the last one."""
LOG_NS: Final = NS
OWN_PLANES_NS: Final = NS // 10
MOST_PER_STEP: Final = 64
SAME_NUMBER_NS: Final = 30 * NS
"""A packet of another vehicle with the own number is a fault for this time."""
MOST_WAITING: Final = 512
"""Packets; beyond it the oldest are dropped."""


class OwnVehicle(NamedTuple):
    """The own vehicle, as other vehicles know it."""

    number: Callable[[], int]  # returns its number; 0: not known yet, then nothing is exchanged
    stream: int  # of its packets, another one after each start
    radius_m: float  # of its hull


def is_due(published_ns: int, now_ns: int, *, has_new: bool) -> bool:
    """True if the obstacles are to be published now. has_new: a packet was accepted since they were published."""
    return now_ns - published_ns >= (SOON_NS if has_new else PUBLISH_NS)


class Sharing:
    """Exchanges obstacles with other vehicles, in a thread.

    links: makes the links, which deliver to the given callable. output: closed at the end."""

    def __init__(
        self,
        config: ShareConfig,
        own: OwnVehicle,
        links: Callable[[Deliver], Sequence[TeamLink]],
        output: SharingOutput,
    ) -> None:
        self._config, self._own, self._output = config, own, output
        self._packets: deque[ReceivedPacket] = deque(maxlen=MOST_WAITING)
        self._rate = PacketRate(config.member_numbers())
        self.links = tuple(links(self._arrived))
        self._begun_ns = time.monotonic_ns()
        self._team: Team | None = None
        self._origin: tuple[float, float, float] | None = None
        self._motion = OwnMotion()
        self._next_send_ns = self._next_log_ns = self._next_own_ns = 0
        self._published_ns, self._has_new = -PUBLISH_NS, False
        self._obstacles = SharedObstacles.empty(self._begun_ns)
        self._planes = OwnPlanes(SharedPlanes.empty(), 0)
        self._movers = OwnMovers()
        self._health = pb.TeamHealth()
        self._world_fault = ""
        self._stop = threading.Event()
        self._thread = WatchedThread(self._run, "sharing")
        self.alive_ns = self._begun_ns
        self._link_health = LinkHealth()

    # ---- in, from other threads -------------------------------------------------------------------------------------------

    def samples(self, samples: Iterable[AttitudeSample | PoseSample]) -> None:
        """Attitudes and positions of the own vehicle."""
        self._motion.take(samples)

    def origin(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> None:
        """The origin of the own ned as the autopilot states it. A configured one is kept."""
        known, stated = self._origin, (latitude_deg, longitude_deg, altitude_m)
        if stated[:2] == (0.0, 0.0):  # what autopilots send without an origin
            return
        if known is None or is_corrected(own_frame(self._config, *known), own_frame(self._config, *stated)):
            self._origin = stated

    def tracks(self, result: TracksResult) -> None:
        """Moving obstacles of one camera, in ned."""
        if result.frame == "ned" and result.tracks is not None:
            self._movers.take(result.camera, result.tracks, result.t_exposure_ns)

    def world(self, world: World, now_ns: int) -> None:
        """The own world, from the thread that owns it; about ten times a second."""
        if now_ns < self._next_own_ns:
            return
        self._next_own_ns = now_ns + OWN_PLANES_NS
        c = self._config
        try:
            self._planes, self._world_fault = own_planes(world, now_ns, c.least_hits, c.range_m, c.send_planes), ""
        except (ArithmeticError, LookupError, ValueError) as error:  # it must not end the thread of the world
            self._world_fault = f"{type(error).__name__}: {error}"

    # ---- out --------------------------------------------------------------------------------------------------------------

    @property
    def obstacles(self) -> SharedObstacles:
        """The newest obstacles of neighbours, at most 0.2 s old."""
        return self._obstacles

    def open(self) -> None:
        """Starts the links and the thread."""
        for link in self.links:
            link.open()
        self._thread.start()

    def close(self) -> None:
        """Ends them. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)
        for link in self.links:
            link.close()
        self._output.close()

    @property
    def health(self) -> pb.TeamHealth:
        """The state of the team, at most 0.2 s old."""
        return self._health

    def fault(self, now_ns: int, liveness_timeout_s: float) -> str:
        """Returns why the thread does not work, as text; empty: it does. Its newest state is then not the present one."""
        if self._thread.failure:
            return f"obstacles are not shared any more ({self._thread.failure}); restart the service"
        if now_ns - self.alive_ns > liveness_timeout_s * NS:
            return "obstacles are not shared: the thread does not respond; restart the service"
        return ""

    def diagnostics(self, now_ns: int, liveness_timeout_s: float) -> list[Diagnostic]:
        """Returns the present faults."""
        found, fault = list[Diagnostic](), self.fault(now_ns, liveness_timeout_s)
        if fault:
            found.append(Diagnostic(DiagnosticCode.SHARE_FAULT, "", fault))
        if self._thread.failure:
            return found
        if self._world_fault:
            text = f"the own planes cannot be shared ({self._world_fault}); report this"
            found.append(Diagnostic(DiagnosticCode.SHARE_FAULT, "", text))
        same_ns = None if self._team is None else self._team.map.same_number_ns
        if self._team is not None and same_ns is not None and now_ns - same_ns <= SAME_NUMBER_NS:
            text = f"another vehicle uses number {self._team.vehicle}, so both refuse the reports of the other; give each its own"
            found.append(Diagnostic(DiagnosticCode.SHARE_FAULT, "", text))
        for link in self.links:
            if link.fault:
                text = f"the link {link.name} to other vehicles is not open: {link.fault}"
                found.append(Diagnostic(DiagnosticCode.SHARE_LINK_CLOSED, "", text))
        if self._team is None or self._team.frame is None:
            text = (
                "the place of the own frame on Earth is not known: the autopilot sent no GPS_GLOBAL_ORIGIN; wait for its "
                "position, or set [share] origin"
            )
            found.append(Diagnostic(DiagnosticCode.SHARE_NO_FRAME, "", text))
        return found

    # ---- thread -----------------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._stop.wait(STEP_S):
            self.alive_ns = time.monotonic_ns()
            self.step(self.alive_ns)

    def step(self, now_ns: int) -> None:
        """Takes what has arrived, and sends and publishes what is due."""
        if self._team is None and not self._found_team():
            return
        team = self._team
        assert team is not None
        self._update(team, now_ns)
        self._receive(team)
        if now_ns >= self._next_send_ns:
            self._next_send_ns = now_ns + SEND_NS
            self._send(team, now_ns)
        team.align(now_ns)
        if is_due(self._published_ns, now_ns, has_new=self._has_new):
            self._published_ns, self._has_new = now_ns, False
            self._obstacles = team.obstacles(now_ns)
            self._publish(team.own.planes.section, now_ns)
            self._health = self._health_of(team, now_ns)

    def _arrived(self, packet: ReceivedPacket) -> None:
        """A packet, from a thread of its link."""
        if self._rate.allows(packet):
            self._packets.append(packet)

    def _found_team(self) -> bool:
        vehicle = self._config.vehicle or self._own.number()
        if not 0 < vehicle < 256:
            self._packets.clear()
            return False
        c = self._config
        rates = {"tunnel": c.tunnel_bytes_per_s, "zenoh": c.zenoh_bytes_per_s}
        budgets = {
            link.name: Budget(
                bytes_per_s=rates[link.name],
                overhead_bytes=link.overhead_bytes,
                packet_bytes=link.packet_bytes,
                refresh_s=c.refresh_s,
            )
            for link in self.links
        }
        self._team = Team(c, vehicle, self._own.stream, self._begun_ns, self._own.radius_m, budgets)
        return True

    def _update(self, team: Team, now_ns: int) -> None:
        team.own.motion = self._motion.newest
        team.own.planes = self._planes
        team.own.movers, team.own.movers_ns = self._movers.at(now_ns, team.own.motion.jump_ns), now_ns
        if self._config.fixed_origin() is None:
            team.own.origin = self._origin

    def _receive(self, team: Team) -> None:
        """Takes the waiting packets, and records them."""
        for _ in range(min(MOST_PER_STEP, len(self._packets))):
            packet = self._packets.popleft()
            if team.receive(packet.data, packet.arrival_ns, packet.sender):
                continue  # refused, and counted; a flood of them does not fill the log
            self._has_new = True
            for link in self.links:
                if link.name == packet.transport:
                    link.confirm(packet)
            message = pb.TeamPacket(transport=packet.transport, data=packet.data, sender=packet.sender or 0)
            self._output.record("team", message, packet.arrival_ns)

    def _send(self, team: Team, now_ns: int) -> None:
        """Sends what is due, and records it."""
        packets = team.packets(now_ns)
        for link in self.links:
            some = packets.get(link.name, [])
            if some:
                link.send(some, team.vehicle)
            for data in some:
                message = pb.TeamPacket(transport=link.name, data=data, sent=True, sender=team.vehicle)
                self._output.record("team", message, now_ns)

    def _publish(self, section: int, now_ns: int) -> None:
        """Publishes the obstacles, and records them once a second."""
        message = obstacles_message(self._obstacles, section)
        self._output.publish(message, time.monotonic_ns() - self._obstacles.now_ns)
        if now_ns >= self._next_log_ns:
            self._next_log_ns = now_ns + LOG_NS
            self._output.record("neighbours", message, now_ns)

    def _received(self, team: Team) -> dict[str, int]:
        """Packets by code, with the messages that the links have refused."""
        counts = team.map.counts + self._rate.dropped + Counter(unrecorded=self._output.unrecorded)
        for link in self.links:
            counts.update(link.refused)
        return dict(sorted(counts.items()))

    def _health_of(self, team: Team, now_ns: int) -> pb.TeamHealth:
        """The state of the team."""
        return pb.TeamHealth(
            vehicle=team.vehicle,
            frame_known=team.frame is not None,
            neighbours=neighbour_messages(self._obstacles.neighbours),
            received=self._received(team),
            links=self._link_health.messages(self.links, team.queues, now_ns),
        )
