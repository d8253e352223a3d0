"""One vehicle as a process: its frames in real time, its merged world, and the part of the service that shares obstacles."""

from __future__ import annotations

import pickle
import time
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.sharing.delays import Confirmed, Received
from benchmarks.sharing.flights import HZ, Seen
from companion.config.share import ShareConfig
from companion.share.output import SharingOutput
from companion.share.sharing_thread import OwnVehicle, Sharing
from companion.streams.publication import PublicationStamps
from core.sharing.obstacles import SharedObstacles
from core.sharing.packet_codec import decoded
from core.sharing.records import SharedPlanes
from core.types import AttitudeSample, PoseSample
from core.world.world import Observation, World
from drivers.mavlink.address import parse_address
from drivers.mavlink.signing import Signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import SigningKey
from drivers.sharing.link import Deliver, ReceivedPacket
from drivers.sharing.tunnel_line import TunnelLine

NS = 1_000_000_000
Vector = tuple[float, float, float]
LOOK_S = 0.02
REST_S = 8.0
"""Hover after the flight."""
COMPONENT, KEY = 196, bytes(range(1, 33))


@dataclass(frozen=True, slots=True)
class Task:
    """number: 1..; frames: pickle of a tuple of Seen; port: of the radio."""

    number: int
    frames: Path
    origin: tuple[float, float, float]
    port: int
    bytes_per_s: float


@dataclass(slots=True)
class Outcome:
    """What one vehicle measured. own: (N, 6) planes of the own world in the end, own_margin_m, own_ids; shared: in the end."""

    number: int
    confirmed: Confirmed = field(default_factory=Confirmed)
    received: Received = field(default_factory=Received)
    own: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6)))
    own_margin_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    own_ids: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    shared: SharedObstacles | None = None
    counts: dict[str, int] = field(default_factory=dict)
    late_frames: int = 0

    def noting(self, deliver: Deliver) -> Deliver:
        """A receiver of packets that notes their planes, too."""

        def received(packet: ReceivedPacket) -> None:
            deliver(packet)
            self.note(packet.data, packet.arrival_ns)

        return received

    def note(self, data: bytes, arrival_ns: int) -> None:
        """Notes the planes of a packet."""
        packet = decoded(data)
        if isinstance(packet.content, SharedPlanes):
            self.received.planes.append((arrival_ns, packet.header.vehicle, packet.content))


def fly(task: Task, out: Connection) -> None:
    """Loads the frames and the kernels and sends "ready", receives the begin of the flight, flies and sends the Outcome."""
    frames: tuple[Seen, ...] = pickle.loads(task.frames.read_bytes())
    lat, lon, alt = task.origin
    config = ShareConfig(
        enabled=True,
        vehicle=task.number,
        origin=f"{lat:.9f}, {lon:.9f}, {alt}",
        tunnel_bytes_per_s=task.bytes_per_s,
        tunnel=f"udpout:127.0.0.1:{task.port}",
    )
    signing, outcome = Signing(SigningKey(KEY), SigningClock()), Outcome(task.number)
    sharing = Sharing(
        config,
        OwnVehicle(lambda: task.number, 1_700_000_000, 0.4),
        lambda deliver: [TunnelLine(parse_address(config.tunnel), COMPONENT, outcome.noting(deliver), signing)],
        SharingOutput(None, PublicationStamps(""), lambda key, message, t_ns: None),
    )
    world, warm = World(), World()
    for k, seen in enumerate(frames[:2]):
        warm.add(Observation(model=seen.model, place_m=seen.place_m, t_ns=(k + 1) * NS))
    out.send("ready")
    begin_ns = out.recv()
    sharing.open()
    try:
        _loop(task, frames, world, sharing, outcome, begin_ns)
        health = sharing.health
    finally:
        sharing.close()
    picture = world.picture(time.monotonic_ns())
    outcome.own, outcome.own_ids = picture.planes.astype(np.float64), picture.slots
    outcome.own_margin_m = picture.margin_m.astype(np.float64)
    outcome.counts = dict(health.received)
    out.send(outcome)


def samples_at(now_ns: int, place_m: Vector, velocity_m_s: Vector) -> tuple[PoseSample, AttitudeSample]:
    """Position and attitude. Models are in the local ned already: only that an attitude is known counts."""
    pose = PoseSample(
        t_ns=now_ns, t_arrival_ns=now_ns, position_ned_m=place_m, velocity_ned_m_s=velocity_m_s, reset_counter=0
    )
    return pose, AttitudeSample(now_ns, now_ns, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _loop(
    task: Task, frames: tuple[Seen, ...], world: World, sharing: Sharing, outcome: Outcome, begin_ns: int
) -> None:
    taken, last = 0, frames[0].place_m
    config_hits = ShareConfig().least_hits
    end_ns = begin_ns + round((len(frames) / HZ + REST_S) * NS)
    newest_ns = 0
    while (now_ns := time.monotonic_ns()) < end_ns:
        due = int((now_ns - begin_ns) / NS * HZ) + 1 if now_ns >= begin_ns else 0
        if taken < due:
            if due - taken > 1:
                outcome.late_frames += 1
            seen = frames[min(taken, len(frames) - 1)]  # it hovers in the end
            world.add(Observation(model=seen.model, place_m=seen.place_m, t_ns=now_ns))
            outcome.confirmed.note(world, config_hits, now_ns)
            velocity = tuple(HZ * (b - a) for a, b in zip(last, seen.place_m, strict=True))
            last, taken = seen.place_m, taken + 1
        flying = taken < len(frames)
        speed = velocity if flying and taken > 1 else (0.0, 0.0, 0.0)
        sharing.samples(samples_at(now_ns, last, (speed[0], speed[1], speed[2])))
        sharing.world(world, now_ns)
        obstacles = sharing.obstacles
        if obstacles.now_ns != newest_ns:
            newest_ns = obstacles.now_ns
            outcome.shared = obstacles
            outcome.received.published_ns.append(now_ns)
        time.sleep(LOOK_S)
