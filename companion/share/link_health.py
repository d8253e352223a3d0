"""State of the links to other vehicles, for health reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

from core.sharing.send_queue import SendQueue
from drivers.sharing.link import TeamLink
from osape_client.proto import osape_v1_pb2 as pb

NS: Final = 1_000_000_000
RATE_S: Final = 10
"""Time over which rates are computed."""


class LinkHealth:
    """Call `messages` about once per second or more often. It keeps the bytes that each link had sent before."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, dict[str, int]]] = deque(maxlen=RATE_S + 1)

    def messages(
        self, links: Sequence[TeamLink], queues: Mapping[str, SendQueue], now_ns: int
    ) -> list[pb.TeamLinkHealth]:
        """The state of each link. queues: by the name of the link."""
        sent = {name: queue.sent_bytes for name, queue in queues.items()}
        if not self._sent or now_ns - self._sent[-1][0] >= NS:
            self._sent.append((now_ns, sent))
        begun_ns, before = self._sent[0]
        seconds = (now_ns - begun_ns) / NS
        return [
            pb.TeamLinkHealth(
                name=link.name,
                fault=link.fault,
                sent_bytes=sent[link.name],
                sent_packets=queues[link.name].sent_packets,
                sent_bytes_per_s=(sent[link.name] - before[link.name]) / seconds if seconds > 0.0 else 0.0,
                unencodable=queues[link.name].unencodable,
            )
            for link in links
        ]
