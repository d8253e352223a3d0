"""A planner's copy of the merged world, kept up to date from snapshots and changes.

    from osape_client import WorldMirror

    with WorldMirror() as mirror:
        if mirror.update(1.0):
            print(mirror.space.segments([[0, 0, -2]], [[5, 0, -2]], radius_m=0.5))

The mirror requests a snapshot when it starts, after a missed message and after a restart of the service. Until it is
complete again, when no messages come, and while the service has no position, nothing is free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np
import zmq
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from ..clock import clock_ns, deadline_ns
from ..connect import MOST_WORLD_BYTES, connect
from ..proto import osape_v1_pb2 as pb
from ..receive_time import Delays, TimedSocket, age_ns
from ..run_folder import run_folder
from ..sources import CONFLICT_TEXT, Sources, Verdict
from .decode import (
    PLANE_RECORD,
    SCHEMA_VERSION,
    blocks_from_message,
    ground_from_message,
    records_from_message,
    snapshot_from_parts,
)
from .snapshot import WorldSnapshot
from .space import WorldSpace

NS = 1_000_000_000
TIMEOUT_S = 1.0
"""Default age of the newest message, and of the newest exposure in it, at which nothing is free any more. The service sends a
message five times a second."""
_REPEAT_NS = NS
"""A request that was not answered within this time is sent again."""


@dataclass(slots=True)
class MirrorStats:
    """Counts of received messages. gaps: how often a message was missing; out_of_order: already contained in the copy, or of
    a service that has ended; undecodable: not a message of this schema, or one that does not fit together; conflicting: not used
    because two services publish to the address; last_error: the cause of the last undecodable or conflicting one."""

    messages: int = 0
    snapshots: int = 0
    gaps: int = 0
    out_of_order: int = 0
    undecodable: int = 0
    conflicting: int = 0
    last_error: str = ""


class WorldMirror:
    """A copy of the merged world. address, requests: None: the service on this machine; timeout_s: age at which the copy cannot
    be used any more; keys: as of a Subscriber; most_bytes: largest message that is received, to be raised where the service has
    a larger [world] most_planes (35 bytes each) or most_free_blocks (up to 3.1 kB each) than fits.

    Raises KeyFileError, and ValueError for an address that cannot be used. Not thread-safe."""

    def __init__(
        self,
        address: str | None = None,
        requests: str | None = None,
        *,
        timeout_s: float = TIMEOUT_S,
        keys: Path | None = None,
        most_bytes: int = MOST_WORLD_BYTES,
    ) -> None:
        self.address = address or f"ipc://{run_folder()}/world"
        self.requests = requests or f"ipc://{run_folder()}/world-snapshot"
        self.stats = MirrorStats()
        self._timeout_s, self._keys, self._most_bytes = timeout_s, keys, most_bytes
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        try:
            self._connected(zmq.REQ, self.requests).close()  # an address that cannot be used is an error now
            self._updates = self._connected(zmq.SUB, self.address)
        except BaseException:
            self._context.destroy(linger=0)
            raise
        self._request: TimedSocket | None = None
        self._requested_ns = 0
        self._newest: pb.WorldUpdate | None = None
        self._received_ns = 0
        self._delays = Delays()
        self._complete = False
        self._sources, self._in_conflict = Sources(), False
        self._planes: dict[int, np.void] = {}
        self._blocks: dict[tuple[int, ...], tuple[NDArray[np.uint64], NDArray[np.float32]]] = {}
        self._space: tuple[bool, WorldSpace] | None = None

    def __enter__(self) -> WorldMirror:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """May be called twice."""
        self._updates.close()
        if self._request is not None:
            self._request.close()
        self._context.term()

    @property
    def complete(self) -> bool:
        """Whether no message of the service is missing."""
        return self._complete

    @property
    def age_s(self) -> float:
        """Upper bound of the present age of the newest exposure; infinite before the first. On another machine it lacks the least
        time on the network."""
        if self._newest is None or not self._newest.t_ns:
            return float("inf")
        return age_ns(self._newest.publication, self._newest.t_ns, self._received_ns) / NS

    @property
    def usable(self) -> bool:
        """Whether the copy is complete, the service has a position, and both are recent."""
        newest = self._newest
        return self._complete and newest is not None and bool(newest.valid) and self.age_s <= self._timeout_s

    @property
    def cause(self) -> str:
        """Why the copy cannot be used, in words; empty when it can."""
        if self._newest is None:
            return "no message was received yet"
        if self._in_conflict:
            return CONFLICT_TEXT
        if not self._complete:
            return "a message was missed; a snapshot was requested"
        silence_s = (clock_ns() - self._received_ns) / NS
        if not self._newest.valid and silence_s <= self._timeout_s:
            return str(self._newest.cause_text)
        if not self._newest.valid:
            return f"no message for {silence_s:.1f} s; does the service run?"
        return "" if self.usable else f"its newest exposure is {self.age_s:.1f} s old"

    @property
    def section(self) -> int:
        """Number that changes when the position jumped, or may have while the service was restarted: coordinates from before
        are not valid any more."""
        return 0 if self._newest is None else int(self._newest.section)

    @property
    def space(self) -> WorldSpace:
        """Queries of the copy. While it cannot be used nothing is free; known planes and ground remain occupied."""
        usable = self.usable
        if self._space is None or self._space[0] != usable:
            snapshot = self._snapshot()
            if not usable:
                snapshot = replace(snapshot, masks=np.zeros_like(snapshot.masks))
            self._space = usable, WorldSpace(snapshot)
        return self._space[1]

    def update(self, timeout_s: float = 0.0) -> bool:
        """Applies all messages that have come; waits up to timeout_s until the copy can be used. Returns whether it can.
        Raises RuntimeError after `close`."""
        self._updates.check_open()
        end_ns = deadline_ns(timeout_s)
        while True:
            self._request_if_incomplete()
            while self._receive():
                pass
            left_ms = (end_ns - clock_ns()) // 1_000_000
            if self.usable or left_ms <= 0:
                return self.usable
            poller = zmq.Poller()
            poller.register(self._updates.socket, zmq.POLLIN)
            if self._request is not None:
                poller.register(self._request.socket, zmq.POLLIN)
            poller.poll(min(left_ms, 200))

    def _apply(self, message: pb.WorldUpdate, received_ns: int) -> None:
        """Applies one message. received_ns: the earliest time at which it can have arrived, by `clock_ns`. Raises
        ValueError for a message whose parts do not fit together; the copy is unchanged then."""
        records, ground = records_from_message(message), ground_from_message(message)
        blocks, masks = blocks_from_message(message)
        verdict = self._sources.take(message.publication, message.t_ns, received_ns)
        self._in_conflict = verdict is Verdict.CONFLICT
        if verdict is Verdict.CONFLICT:
            self.stats.conflicting += 1
            self.stats.last_error = f"{self.address}: {CONFLICT_TEXT}"
            self._complete = False
            return
        if verdict is Verdict.LATE:  # it waited in the other socket meanwhile
            self.stats.out_of_order += 1
            return
        before = self._newest
        same = before is not None and _source_of(before) == _source_of(message)
        newest = before.sequence if before is not None and same else 0
        if same and (message.sequence < newest or (message.sequence == newest and self._complete)):
            self.stats.out_of_order += 1
            if message.snapshot and not self._complete:
                self._requested_ns = 0  # the stream is ahead of this snapshot: changes between them are missing
            return
        if message.snapshot:
            self._planes.clear()
            self._blocks.clear()
            self._complete = True
            self.stats.snapshots += 1
        elif before is None or not same or message.section != before.section or message.sequence != newest + 1:
            self.stats.gaps += self._complete
            self._complete = False
        if self._complete:
            self._planes |= {int(r["slot"]): r for r in records}
            for slot in message.removed:
                self._planes.pop(slot, None)
            self._put_blocks(list(map(tuple, blocks.tolist())), masks, ground)
        self.stats.messages += 1
        arrival_ns = self._delays.arrival_ns(message.publication, message.t_ns, received_ns)
        self._newest, self._received_ns, self._space = message, arrival_ns, None

    def _put_blocks(
        self, blocks: list[tuple[int, ...]], masks: NDArray[np.uint64], ground: NDArray[np.float32]
    ) -> None:
        """Replaces blocks of free space, and removes those of which nothing is known any more."""
        self._blocks |= dict(zip(blocks, zip(masks, ground, strict=True), strict=True))
        for block in set(blocks):
            if _is_empty(*self._blocks[block]):
                del self._blocks[block]

    def _connected(self, kind: int, address: str) -> TimedSocket:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        if kind == zmq.SUB:
            socket.setsockopt(zmq.SUBSCRIBE, b"")
        try:
            connect(socket, address, self._keys, self._most_bytes)
        except ValueError:  # of the address or the keys
            socket.close(0)
            raise
        return TimedSocket(socket, address if kind == zmq.SUB else None)  # a request is sent by a new socket

    def _request_if_incomplete(self) -> None:
        """Sends one request at a time; the socket of an unanswered one is replaced."""
        now_ns = clock_ns()
        if self._complete or now_ns - self._requested_ns < _REPEAT_NS:
            return
        if self._request is not None:
            self._request.close()
        self._request, self._requested_ns = self._connected(zmq.REQ, self.requests), now_ns
        self._request.socket.send(b"")

    def _receive(self) -> bool:
        """Receives one message; False: there is none. The answer to a request comes first: the stream continues it, and what of
        the stream it contains is left out. In the other order changes that were published after the answer would make it outdated
        whenever the planner looks less often than the service publishes."""
        for source in (self._request, self._updates):
            received = source.take() if source is not None else None
            if received is not None:
                if source is self._request and self._request is not None:
                    self._request.close()
                    self._request = None
                self._read(*received)
                return True
        return False

    def _read(self, data: bytes, received_ns: int) -> None:
        message = pb.WorldUpdate()
        try:
            message.ParseFromString(data)
            if message.schema_version != SCHEMA_VERSION:
                raise ValueError(f"schema version {message.schema_version}; this mirror reads {SCHEMA_VERSION}")
            if not message.HasField("publication"):
                raise ValueError("cut short: the part that is written last is missing")
            if message.section == 0 and (message.valid or message.planes or message.blocks):
                raise ValueError("section 0 means that there is no world yet, but the message contains one")
            if message.valid and message.cause != pb.WorldUpdate.CAUSE_NONE:
                raise ValueError(f"cause {message.cause} of a valid message")
            self._apply(message, received_ns)
        except (DecodeError, ValueError) as error:
            self.stats.undecodable += 1
            self.stats.last_error = f"{self.address}: {len(data)} bytes are not a WorldUpdate ({error})"
            self._complete = False  # it may have been a change

    def _snapshot(self) -> WorldSnapshot:
        records = np.array(list(self._planes.values()), PLANE_RECORD)
        used = sorted(self._blocks)
        blocks = np.array(used, np.int32).reshape(-1, 3)
        masks = np.array([self._blocks[block][0] for block in used], np.uint64).reshape(-1, 256)
        ground = np.array([self._blocks[block][1] for block in used], np.float32).reshape(-1, 256, 2)
        t_ns = 0 if self._newest is None else self._newest.t_ns
        return snapshot_from_parts(self.section, records, blocks, masks, ground, t_ns)


def _source_of(message: pb.WorldUpdate) -> tuple[str, int]:
    """The service that has sent it."""
    return message.publication.boot_id, message.publication.start_ns


def _is_empty(mask: NDArray[np.uint64], ground: NDArray[np.float32]) -> bool:
    """Whether nothing is known of a block: the service no longer holds it."""
    return not mask.any() and bool(np.isnan(ground).all())
