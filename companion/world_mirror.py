"""A planner's copy of the merged world, kept up to date: asked like the world itself.

    from companion.world_mirror import WorldMirror
    with WorldMirror() as mirror:
        if mirror.update(1.0):
            print(mirror.space.segments([[0, 0, -2]], [[5, 0, -2]], radius_m=0.5))

A late joiner asks for a snapshot, and so does one that missed a message or came to a service that was started anew. Until it
is whole again, when nothing comes any more, and when the service has no position, nothing is free. Needs pyzmq, protobuf
and numpy only.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType

import numpy as np
import zmq
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from core.world.serialize import ON_WIRE
from core.world.snapshot import WorldPicture
from core.world.space import WorldSpace
from drivers.proto import osape_v1_pb2 as pb

from .paths import folders
from .streams.curve_auth import use_client_keys
from .streams.receive_time import Ear, age_ns
from .streams.world_messages import SCHEMA_VERSION, blocks_of, ground_of, picture_of, records_of

NS = 1_000_000_000
STALE_S = 1.0
"""Without a message for so long, or with an exposure so old, nothing is free: the service says something five times a
second."""
_AGAIN_NS = NS
"""A request that was not answered for so long is sent again."""


@dataclass(slots=True)
class MirrorCounts:
    """What came. gaps: times that a message was missing; late: what the copy held
    already; foreign: what was no message of ours, or did not fit together."""

    messages: int = 0
    snapshots: int = 0
    gaps: int = 0
    late: int = 0
    foreign: int = 0
    last_error: str = field(default="")


class WorldMirror:
    """Listens and asks. address, requests: None: where a service on this machine publishes; keys: as for a Client.

    Not for several threads at once."""

    def __init__(
        self,
        address: str | None = None,
        requests: str | None = None,
        *,
        stale_s: float = STALE_S,
        keys: Path | None = None,
    ) -> None:
        self.address = address or f"ipc://{folders().run}/world"
        self.requests = requests or f"ipc://{folders().run}/world-snapshot"
        self.counts = MirrorCounts()
        self._stale_s, self._keys = stale_s, keys
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._ear = self._connected(zmq.SUB, self.address)
        self._asker: Ear | None = None
        self._asked_ns = 0
        self._newest: pb.WorldUpdate | None = None
        self._came_ns = 0
        self._whole = False
        self._planes: dict[int, np.void] = {}
        self._blocks: dict[tuple[int, int, int], tuple[NDArray[np.uint64], NDArray[np.float32]]] = {}
        self._space: tuple[bool, WorldSpace] | None = None

    def __enter__(self) -> WorldMirror:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """May be called twice."""
        self._ear.close()
        if self._asker is not None:
            self._asker.close()
        self._context.term()

    @property
    def whole(self) -> bool:
        """Whether nothing is missing of what the service has said."""
        return self._whole

    @property
    def age_s(self) -> float:
        """Of the newest exposure in it, now, at the most; infinite before the first."""
        if self._newest is None or not self._newest.t_ns:
            return float("inf")
        return age_ns(self._newest.publication, self._newest.t_ns, self._came_ns) / NS

    @property
    def usable(self) -> bool:
        """Whether it is whole, the service has a position, and both are fresh."""
        return self._whole and self._newest is not None and bool(self._newest.valid) and self.age_s <= self._stale_s

    @property
    def cause(self) -> str:
        """Why it cannot be used, in words; empty: it can."""
        if self._newest is None:
            return "nothing was heard yet"
        if not self._whole:
            return "part of it is missing, and asked for"
        if not self._newest.valid:
            return str(self._newest.cause_text)
        return "" if self.usable else f"its newest exposure is {self.age_s:.1f} s old"

    @property
    def section(self) -> int:
        """Changes where the position jumped: no coordinate of before holds any more."""
        return 0 if self._newest is None else int(self._newest.section)

    @property
    def space(self) -> WorldSpace:
        """What may be asked. While it cannot be used nothing is free; planes and ground that are known are occupied all the
        same."""
        usable = self.usable
        if self._space is None or self._space[0] != usable:
            p = self._picture()
            if not usable:
                p = replace(p, masks=np.zeros_like(p.masks))
            self._space = usable, WorldSpace(p)
        return self._space[1]

    def update(self, timeout_s: float = 0.0) -> bool:
        """Takes all that has come; waits up to timeout_s until it can be used. Whether it can."""
        end_ns = time.monotonic_ns() + round(timeout_s * NS)
        while True:
            self._ask_where_needed()
            while self._take():
                pass
            left_ms = (end_ns - time.monotonic_ns()) // 1_000_000
            if self.usable or left_ms <= 0:
                return self.usable
            poller = zmq.Poller()
            poller.register(self._ear.socket, zmq.POLLIN)
            if self._asker is not None:
                poller.register(self._asker.socket, zmq.POLLIN)
            poller.poll(min(left_ms, 200))

    def _connected(self, kind: int, address: str) -> Ear:
        socket = self._context.socket(kind)
        socket.setsockopt(zmq.LINGER, 0)
        if kind == zmq.SUB:
            socket.setsockopt(zmq.SUBSCRIBE, b"")
        if self._keys is not None:
            use_client_keys(socket, self._keys)
        socket.connect(address)
        return Ear(socket)

    def _ask_where_needed(self) -> None:
        """One request at a time; one that nobody answers is given up with its socket."""
        now_ns = time.monotonic_ns()
        if self._whole or now_ns - self._asked_ns < _AGAIN_NS:
            return
        if self._asker is not None:
            self._asker.close()
        self._asker, self._asked_ns = self._connected(zmq.REQ, self.requests), now_ns
        self._asker.socket.send(b"")

    def _take(self) -> bool:
        """Takes one message; False: there is none. What was heard goes first: an answer is newer."""
        for ear in (self._ear, self._asker):
            taken = ear.take() if ear is not None else None
            if taken is not None:
                if ear is self._asker and self._asker is not None:
                    self._asker.close()
                    self._asker = None
                self._read(*taken)
                return True
        return False

    def _read(self, data: bytes, came_ns: int) -> None:
        message = pb.WorldUpdate()
        try:
            message.ParseFromString(data)
            if message.schema_version != SCHEMA_VERSION:
                raise ValueError(f"schema version {message.schema_version}; this mirror reads {SCHEMA_VERSION}")
            if not message.HasField("publication"):
                raise ValueError("cut short: what is written last is missing")
            self._apply(message, came_ns)
        except (DecodeError, ValueError) as error:
            self.counts.foreign += 1
            self.counts.last_error = f"{self.address}: {len(data)} bytes that are no world ({error})"
            self._whole = False  # it may have been a change

    def _apply(self, message: pb.WorldUpdate, came_ns: int) -> None:
        """Into the copy. Raises ValueError for what does not fit together, the copy as it was."""
        records, (blocks, masks), ground = records_of(message), blocks_of(message), ground_of(message)
        before = self._newest
        same = before is not None and before.publication.boot_id == message.publication.boot_id
        heard = before.sequence if before is not None and same else 0
        if same and (message.sequence < heard or (message.sequence == heard and self._whole)):
            self.counts.late += 1
            if message.snapshot and not self._whole:
                self._asked_ns = 0  # the stream has overtaken the answer: what came between is missing
            return
        if message.snapshot:
            self._planes.clear()
            self._blocks.clear()
            self._whole = True
            self.counts.snapshots += 1
        elif before is None or not same or message.section != before.section or message.sequence != heard + 1:
            self.counts.gaps += self._whole
            self._whole = False
        if self._whole:
            self._planes |= {int(r["slot"]): r for r in records}
            for slot in message.removed:
                self._planes.pop(slot, None)
            told = zip(masks, ground, strict=True)
            self._blocks |= dict(zip(map(tuple, blocks.tolist()), told, strict=True))
        self.counts.messages += 1
        self._newest, self._came_ns, self._space = message, came_ns, None

    def _picture(self) -> WorldPicture:
        records = np.array(list(self._planes.values()), ON_WIRE)
        on = sorted(block for block, (mask, ground) in self._blocks.items() if mask.any() or not np.isnan(ground).all())
        blocks = np.array(on, np.int32).reshape(-1, 3)
        masks = np.array([self._blocks[block][0] for block in on], np.uint64).reshape(-1, 256)
        ground = np.array([self._blocks[block][1] for block in on], np.float32).reshape(-1, 256, 2)
        t_ns = 0 if self._newest is None else self._newest.t_ns
        return picture_of(self.section, records, blocks, masks, ground, t_ns)
