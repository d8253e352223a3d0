"""Makes the part of the service that shares obstacles, with the links of the configuration."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import zmq
from google.protobuf.message import Message

from core.types import AttitudeSample, PoseSample
from core.world.world import World
from drivers.mavlink.address import parse_address
from drivers.mavlink.commands import request_message
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.parser import Frame
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.signing import Signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import load_key
from drivers.sharing.link import Deliver, TeamLink
from drivers.sharing.tunnel import TUNNEL_ID
from drivers.sharing.tunnel_line import TunnelLine
from drivers.sharing.zenoh_link import ZenohLink
from osape_client.proto import osape_v1_pb2 as pb

from ..config.loader import Config
from ..config.share import AUTOPILOT_LINE
from ..diagnostic import Diagnostic, DiagnosticCode
from ..paths import Folders
from ..pipeline.tracking import TracksResult
from ..streams.curve_auth import ServerKeys
from ..streams.publication import PublicationStamps
from ..streams.publisher import Publisher, Stream
from .autopilot_tunnel import AutopilotTunnel
from .output import SharingOutput
from .sharing_thread import OwnVehicle, Sharing

NS: Final = 1_000_000_000
GPS_GLOBAL_ORIGIN: Final = dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN
CLOCK_FILE: Final = "signing-clock-share"
MOST_STREAM: Final = (1 << 32) - 1024
"""Leaves room for the streams that follow each other without a restart."""
REQUEST_NS, REQUEST_AGAIN_NS = 2 * NS, 30 * NS


class ShareService:
    """Connects `Sharing` with the service: messages of the autopilot in, requests out. All methods may be called before
    `open`."""

    reads = frozenset({GPS_GLOBAL_ORIGIN})
    """Ids of the autopilot's messages that `message` needs."""
    foreign_reads = frozenset({TUNNEL_ID})
    """Ids of messages of other vehicles that `foreign` needs."""

    def __init__(
        self,
        config: Config,
        folders: Folders,
        stamps: PublicationStamps,
        log: Callable[[str, Message, int], None],
    ) -> None:
        """log: records a message. Raises DriverError for a signing key that cannot be used."""
        self._config, self._folders, self._stamps, self._log = config, folders, stamps, log
        self._session: MavlinkSession | None = None
        self._link: MavlinkLink | None = None
        self._tunnel: AutopilotTunnel | None = None
        self._signing = _signing(config, folders)
        self._next_request_ns = 0
        self._has_origin = False
        self.sharing: Sharing | None = None

    def connect(self, session: MavlinkSession | None, link: MavlinkLink | None) -> None:
        """session, link: to the autopilot, None: none is configured."""
        self._session, self._link = session, link

    def open(self, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys | None) -> None:
        """Opens stream and links and starts the thread. Raises as Publisher and the links do."""
        share, address = self._config.share, self._config.publish.address("neighbours", self._folders.run)
        publisher = Publisher(Stream("neighbours", address), context, keys) if address else None
        try:
            own = OwnVehicle(self._vehicle, stream_of(time.time_ns()), self._config.avoid.radius_m)
            self.sharing = Sharing(share, own, self._links, SharingOutput(publisher, self._stamps, self._log))
        except BaseException:
            if publisher is not None:
                publisher.close()
            raise
        self.sharing.open()

    def close(self) -> None:
        """Ends it. May be called twice."""
        if self.sharing is not None:
            self.sharing.close()
        self._signing.close()

    def message(self, message: Any) -> None:
        """A message of the autopilot, of `reads`."""
        if message.get_type() == "GPS_GLOBAL_ORIGIN" and self.sharing is not None:
            self._has_origin = True
            self.sharing.origin(message.latitude / 1e7, message.longitude / 1e7, message.altitude / 1e3)

    def samples(self, samples: list[AttitudeSample | PoseSample]) -> None:
        """Attitudes and positions of the own vehicle."""
        if self.sharing is not None:
            self.sharing.samples(samples)

    def tracks(self, result: TracksResult) -> None:
        """Moving obstacles of the own sensors."""
        if self.sharing is not None:
            self.sharing.tracks(result)

    def world(self, world: World, now_ns: int) -> None:
        """The own world, from the thread that owns it."""
        if self.sharing is not None:
            self.sharing.world(world, now_ns)

    def diagnostics(self, now_ns: int) -> list[Diagnostic]:
        """Returns the present faults."""
        found = [] if self.sharing is None else self.sharing.diagnostics(now_ns, self._config.service.hang_s)
        if fault := self._signing.clock_fault:
            found.append(Diagnostic(DiagnosticCode.SIGNATURE_CLOCK_FAULT, "", f"line to other vehicles: {fault}"))
        return found

    def fill(self, report: pb.Health) -> None:
        """Writes the state of the team into a health report; only the own number while the thread does not work."""
        if self.sharing is None:
            return
        report.team.CopyFrom(self.sharing.health)
        if self.sharing.fault(report.t_ns, self._config.service.hang_s):
            report.team.CopyFrom(pb.TeamHealth(vehicle=report.team.vehicle))

    def foreign(self, frame: Frame, arrival_ns: int) -> None:
        """A message of another vehicle, of `foreign_reads`."""
        if self._tunnel is not None:
            self._tunnel.take(frame, arrival_ns)

    def tick(self, now_ns: int) -> None:
        """Requests the origin of the autopilot repeatedly, because it may change."""
        if self._link is None or now_ns < self._next_request_ns or self._config.share.fixed_origin() is not None:
            return
        system = self._vehicle()
        if system:
            self._next_request_ns = now_ns + (REQUEST_AGAIN_NS if self._has_origin else REQUEST_NS)
            self._link.post(request_message(system, GPS_GLOBAL_ORIGIN))

    def _vehicle(self) -> int:
        vehicle = self._session.vehicle if self._session is not None else None
        return 0 if vehicle is None else vehicle.system_id

    def _links(self, deliver: Deliver) -> Sequence[TeamLink]:
        share, links = self._config.share, list[TeamLink]()
        if share.tunnel == AUTOPILOT_LINE and self._link is not None:
            self._tunnel = AutopilotTunnel(self._link, deliver, signed=bool(self._config.autopilot.signing_key))
            links.append(self._tunnel)
        elif share.tunnel:
            component = self._config.autopilot.component_id
            links.append(TunnelLine(parse_address(share.tunnel), component, deliver, self._signing))
        if share.zenoh:
            links.append(ZenohLink(share.zenoh_team, Path(share.zenoh), deliver))
        return links


def stream_of(unix_ns: int) -> int:
    """Returns the stream of packets of a start at this wall clock, within the range of a packet whatever the clock."""
    return min(max(1, unix_ns // NS), MOST_STREAM)


def _signing(config: Config, folders: Folders) -> Signing:
    """Signatures of a line of its own, with the key of the link to the autopilot and timestamps of their own."""
    share, key = config.share, config.autopilot.signing_key
    if not key or not share.tunnel or share.tunnel == AUTOPILOT_LINE:
        return Signing()
    return Signing(load_key(Path(key)), SigningClock(folders.state / CLOCK_FILE))
