"""A planner's side: the newest obstacles and free space, their age, and what may be asked of them.

    from companion.client import Client
    with Client() as client:
        news = client.wait(1.0)
        if news is not None and not news.stale and news.valid:
            print(news.space.segments([[0, 0, 0]], [[5, 0, 0]], radius_m=0.5))

Needs pyzmq, protobuf and numpy only; nothing is compiled. ZeroMQ connects again by itself when the service starts anew.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import TracebackType

import zmq
from google.protobuf.message import DecodeError

from core.query.queries import SeenFrom, Space
from core.world.local_memory import LevelMemory
from drivers.proto import osape_v1_pb2 as pb

from .paths import folders
from .pipeline.causes import cause_code
from .pipeline.decode_model import model_from_message
from .streams.curve_auth import use_client_keys
from .streams.receive_time import Ear, age_ns

NS = 1_000_000_000
STALE_S = 0.4
"""Older than this is stale: the service itself calls a camera blind at 0.3 s."""


@dataclass(frozen=True, eq=False)
class News:
    """One message. received_ns: it came then or later, on this process's monotonic clock; stale_s: the age from which on
    it is stale.

    message: osape.v1.PrismsFrame of one camera, or SurroundFrame of several."""

    message: pb.PrismsFrame | pb.SurroundFrame
    received_ns: int
    stale_s: float = STALE_S

    @property
    def frame(self) -> str:
        """The frame of all coordinates: "ned", or "level" without a position (docs/reference/frames.md)."""
        return str(self.message.frame)

    @property
    def valid(self) -> bool:
        """False: blind; nothing may be taken as free. `cause` says why."""
        return bool(self.message.valid)

    @property
    def cause(self) -> str:
        """Why it is blind, in words; of several cameras each blind one."""
        if isinstance(self.message, pb.PrismsFrame):
            return str(self.message.cause_text)
        return "; ".join(f"{c.camera}: {c.cause_text}" for c in self.message.cameras if not c.valid)

    @property
    def cause_codes(self) -> dict[str, str]:
        """Camera -> code of why it is blind, for programs (docs/reference/diagnostics.md); empty: none is."""
        parts = [self.message] if isinstance(self.message, pb.PrismsFrame) else self.message.cameras
        return {part.camera: cause_code(part.cause) for part in parts if not part.valid}

    @property
    def age_s(self) -> float:
        """Of the exposure, now, at the most: a message that waited here unread is as old as it may be. On another machine
        it lacks the time on the network."""
        m = self.message
        t_ns = m.t_exposure_ns if isinstance(m, pb.PrismsFrame) else m.t_ns
        return age_ns(m.publication, t_ns, self.received_ns) / NS

    @property
    def stale(self) -> bool:
        """Whether it is too old to fly by; a stopped service shows by this alone."""
        return not self.age_s <= self.stale_s

    @cached_property
    def space(self) -> Space:
        """What may be asked: free, occupied, unknown (core/query/queries.py). Blind cameras know nothing and block nothing; of
        a message whose numbers do not fit together nothing is known either."""
        frames = self.message.cameras if isinstance(self.message, pb.SurroundFrame) else [self.message]
        parts = []
        for frame in frames:
            try:
                model = model_from_message(frame) if frame.valid else None
            except ValueError:
                return Space([])
            if model is not None:
                at = frame.transform.translation_m
                parts.append(SeenFrom(model, (at.x, at.y, at.z)))
        return Space(parts)


def remember(memory: LevelMemory, message: pb.PrismsFrame) -> float | None:
    """Takes a frame without a position into a planner's short memory; the vehicle's heading at its exposure, rad clockwise from
    north, for `LevelMemory.picture`. None: not taken, since it is blind, has a position, or does not fit together."""
    if message.frame != "level" or not message.valid or not message.HasField("attitude"):
        return None
    q = message.attitude.q_ned_frd
    heading_rad = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    try:
        model = model_from_message(message)
        if model is not None:
            memory.add(message.camera, model, heading_rad, message.t_exposure_ns)
    except ValueError:
        return None
    return heading_rad if model is not None else None


@dataclass(slots=True)
class Heard:
    """Counts. foreign: what was no message of ours; late: older than one that had come before."""

    messages: int = 0
    foreign: int = 0
    late: int = 0
    last_error: str = field(default="")


class Client:
    """Listens to the service's prisms. surround: to all cameras as one model, where there are several. address: None:
    where a service on this machine publishes. keys: the folder of this client's CURVE keys (`companion keys`), for a
    service on another machine.

    Not for several threads at once: a socket belongs to one."""

    def __init__(
        self, address: str | None = None, *, surround: bool = False, stale_s: float = STALE_S, keys: Path | None = None
    ) -> None:
        self._kind = pb.SurroundFrame if surround else pb.PrismsFrame
        self.address = address or f"ipc://{folders().run}/{'surround' if surround else 'prisms'}"
        self._stale_s = stale_s
        self.heard = Heard()
        self._newest: News | None = None
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        socket = self._context.socket(zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.setsockopt(zmq.CONFLATE, 1)  # only the newest is worth anything
        socket.setsockopt(zmq.LINGER, 0)
        if keys is not None:
            use_client_keys(socket, keys)
        socket.connect(self.address)
        self._ear = Ear(socket)

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """May be called twice."""
        self._ear.close()
        self._context.term()

    def latest(self) -> News | None:
        """The newest message, at once; None before the first. Look at `stale`: it may be an old one."""
        while self._take(0):
            pass
        return self._newest

    def wait(self, timeout_s: float) -> News | None:
        """The next message; None when none comes in time."""
        end_ns = time.monotonic_ns() + round(timeout_s * NS)
        while True:
            left_ms = max(0, (end_ns - time.monotonic_ns()) // 1_000_000)
            if self._take(left_ms):
                return self._newest
            if time.monotonic_ns() >= end_ns:
                return None

    def run(self, on_news: Callable[[News], bool | None], silence_s: float = 1.0) -> None:
        """Calls on_news with each message until it returns False, and with the last one again after each silence: its
        age then says that nothing comes."""
        for news in self.news(silence_s):
            if on_news(news) is False:
                return

    def news(self, silence_s: float = 1.0) -> Iterator[News]:
        """Each message as it comes, and the last one again after each silence."""
        while True:
            news = self.wait(silence_s) or self._newest
            if news is not None:
                yield news

    def _take(self, timeout_ms: int) -> bool:
        """Takes one message; False: there was none that is news."""
        taken = self._ear.take(timeout_ms)
        if taken is None:
            return False
        data, came_ns = taken
        message = self._kind()
        try:
            message.ParseFromString(data)
        except DecodeError as error:
            self._refuse(f"{len(data)} bytes that are no {self._kind.DESCRIPTOR.name} ({error})")
            return False
        if message.schema_version != 1:
            self._refuse(f"schema version {message.schema_version}; this client reads 1")
            return False
        if not self._follows(message):
            self.heard.late += 1
            return False
        self.heard.messages += 1
        self._newest = News(message, came_ns, self._stale_s)
        return True

    def _follows(self, message: pb.PrismsFrame | pb.SurroundFrame) -> bool:
        """Whether it comes after the newest one; a service that was started again counts from 0 anew."""
        if self._newest is None:
            return True
        before, after = self._newest.message.publication, message.publication
        return (
            before.boot_id != after.boot_id or after.number > before.number or after.number == 0 or self._newest.stale
        )

    def _refuse(self, what: str) -> None:
        self.heard.foreign += 1
        self.heard.last_error = f"{self.address}: {what}"
