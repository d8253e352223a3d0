"""A radio that all vehicles share, as a process: UDP datagrams are passed to all others, late, limited in rate, and some are lost."""

from __future__ import annotations

import heapq
import select
import socket
import time
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

import numpy as np

NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Channel:
    """loss: share of datagrams that each receiver loses; bytes_per_s: of all vehicles together; delay_s: of each datagram;
    queue_s: a datagram that would wait longer is dropped."""

    loss: float = 0.1
    bytes_per_s: float = 5760.0
    delay_s: float = 0.03
    queue_s: float = 0.5


@dataclass(slots=True)
class Traffic:
    """What vehicles have sent: (time, bytes) of each datagram by vehicle; lost, dropped: datagrams."""

    sent: list[list[tuple[int, int]]] = field(default_factory=list)
    lost: int = 0
    dropped: int = 0


def radio(ports: Connection, vehicles: int, channel: Channel, seed: int) -> None:
    """Sends its ports to `ports`, runs until something arrives there, and answers with the Traffic."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(vehicles)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    ports.send([s.getsockname()[1] for s in sockets])
    rng = np.random.Generator(np.random.PCG64([seed, 24]))
    traffic = Traffic(sent=[[] for _ in range(vehicles)])
    peers: list[tuple[str, int] | None] = [None] * vehicles
    waiting: list[tuple[int, int, int, bytes]] = []
    free_ns, number = time.monotonic_ns(), 0
    while not ports.poll(0):
        timeout_s = 0.005 if waiting else 0.02
        for s in select.select(sockets, [], [], timeout_s)[0]:
            k = sockets.index(s)
            data, peers[k] = s.recvfrom(4096)
            now_ns = time.monotonic_ns()
            traffic.sent[k].append((now_ns, len(data)))
            if free_ns - now_ns > channel.queue_s * NS:
                traffic.dropped += 1
                continue
            free_ns = max(free_ns, now_ns) + round(len(data) / channel.bytes_per_s * NS)
            heapq.heappush(waiting, (free_ns + round(channel.delay_s * NS), number, k, data))
            number += 1
        while waiting and waiting[0][0] <= time.monotonic_ns():
            _, _, sender, data = heapq.heappop(waiting)
            for k, peer in enumerate(peers):
                if k == sender or peer is None:
                    continue
                if rng.random() < channel.loss:
                    traffic.lost += 1
                else:
                    sockets[k].sendto(data, peer)
    ports.recv()
    ports.send(traffic)
    for s in sockets:
        s.close()
