"""Receiving the obstacle stream: the newest message, its age, and queries of free, occupied and unknown space.

    from osape_client import Subscriber

    with Subscriber() as subscriber:
        for message in subscriber.messages():
            if message.stale or not message.valid:
                continue  # nothing may be taken as free
            at_m = message.vehicle_m
            if at_m is not None:
                print(message.space.nearest(at_m)[0][0])

A subscriber connects again by itself: at once when the service is restarted, after 5 s without a message where another program
or a service with other keys answered meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from google.protobuf.message import DecodeError

from .clock import clock_ns, deadline_ns
from .decode import cause_code, model_from_message
from .model import MOST_M, without_free
from .proto import osape_v1_pb2 as pb
from .query.space import PlacedModel, Space
from .receive_time import Delays, age_ns
from .sources import CONFLICT_TEXT, Sources, Verdict
from .stream_subscriber import StreamSubscriber

NS = 1_000_000_000
SCHEMA_VERSION = 1
FRAMES = frozenset({"level", "ned"})
SILENCE_S = 0.5
"""A blind service sends too. After this time without a message its last cause says nothing about now."""
TIMEOUT_S = 0.4
"""Default age at which a message becomes stale. The service itself reports a camera as unavailable after 0.3 s."""


@dataclass(frozen=True, slots=True)
class UnavailableCamera:
    """A camera without a valid frame: nothing may be taken as free in its view. code: for programs
    (docs/reference/diagnostics.md of the service); text: for people."""

    camera: str
    code: str
    text: str


@dataclass(frozen=True, eq=False)
class Message:
    """One message. content: osape.v1.PrismsFrame of one camera, or SurroundFrame of several. received_ns: the earliest time
    at which it can have arrived, by `clock.clock_ns`; timeout_s: the age at which it becomes stale;
    refused: why later messages were not used, in words; empty: none was refused."""

    content: pb.PrismsFrame | pb.SurroundFrame
    received_ns: int
    timeout_s: float = TIMEOUT_S
    refused: str = ""

    @property
    def frame(self) -> str:
        """The frame of all coordinates: "ned", or "level" without a position (docs/reference/frames.md of the service)."""
        return str(self.content.frame)

    @property
    def _frames(self) -> Sequence[pb.PrismsFrame]:
        """The message of each camera."""
        return [self.content] if isinstance(self.content, pb.PrismsFrame) else self.content.cameras

    @property
    def vehicle_m(self) -> tuple[float, float, float] | None:
        """Position of the vehicle at the newest valid exposure, in `frame`: the origin in "level". None: the message does not
        contain it."""
        if self.frame == "level":
            return 0.0, 0.0, 0.0
        placed = [part for part in self._frames if part.valid and part.HasField("pose")]
        if self.frame != "ned" or not placed:
            return None
        at = max(placed, key=lambda part: part.t_exposure_ns).pose.position_ned_m
        return at.x, at.y, at.z

    @property
    def valid(self) -> bool:
        """False: the camera is unavailable; of several cameras: a required one is, or all are. Others may be unavailable while
        this is True, see `unavailable`: nothing may be taken as free in their view."""
        return bool(self.content.valid)

    @property
    def unavailable(self) -> tuple[UnavailableCamera, ...]:
        """The cameras without a valid frame, with the reason."""
        return tuple(
            UnavailableCamera(part.camera, cause_code(part.cause), str(part.cause_text))
            for part in self._frames
            if not part.valid
        )

    @property
    def cause(self) -> str:
        """Why nothing may be taken as free, in words; empty while the message is valid and the service sends. Of several cameras the
        causes of the unavailable ones."""
        if self.refused:
            return self.refused
        silence_s = (clock_ns() - self.received_ns) / NS
        if silence_s > max(self.timeout_s, SILENCE_S):
            return f"no message for {silence_s:.1f} s; does the service run?"
        if isinstance(self.content, pb.PrismsFrame):
            return str(self.content.cause_text)
        return "; ".join(f"{c.camera}: {c.text}" for c in self.unavailable)

    @property
    def age_s(self) -> float:
        """Upper bound of the present age of the exposure, of several cameras the newest one. On another machine it lacks the least
        time on the network."""
        return age_ns(self.content.publication, _exposure_ns(self.content), self.received_ns) / NS

    @property
    def oldest_age_s(self) -> float:
        """As `age_s`, of several cameras the oldest valid exposure."""
        return self.age_s + max((self._lag_s(part) for part in self._frames if part.valid), default=0.0)

    def _lag_s(self, part: pb.PrismsFrame) -> float:
        """Time from the exposure of one camera to the newest one."""
        return max(0, _exposure_ns(self.content) - part.t_exposure_ns) / NS

    @property
    def stale(self) -> bool:
        """Whether it is too old to be used. A stopped service is detected by this alone."""
        return not self.age_s <= self.timeout_s

    @property
    def space(self) -> Space:
        """Queries of this message. While it is stale nothing is free or open, and of several cameras nothing that only a camera
        with an exposure older than `timeout_s` measured; obstacles and ground remain: call it for each query. Unavailable cameras
        contribute neither free nor occupied space. If the parts of a message do not fit together, or it is of an unknown frame,
        everything is unknown."""
        stale, age_s = self.stale, self.age_s
        old = tuple(stale or not age_s + lag_s <= self.timeout_s for lag_s, _ in self._models)
        if old not in self._spaces:
            parts = zip(old, self._models, strict=True)
            self._spaces[old] = Space(
                [
                    replace(placed, model=without_free(placed.model)) if no_free else placed
                    for no_free, (_, placed) in parts
                ]
            )
        return self._spaces[old]

    @cached_property
    def _spaces(self) -> dict[tuple[bool, ...], Space]:
        """By which of the models are too old; with time more of them are."""
        return {}

    @cached_property
    def _models(self) -> list[tuple[float, PlacedModel]]:
        """The time from the exposure of each camera to the newest one, s, and its model."""
        if self.frame not in FRAMES:
            return []
        models = []
        for frame in self._frames:
            try:
                model = model_from_message(frame) if frame.valid else None
            except ValueError:
                return []
            if model is not None:
                if not frame.HasField("transform") or frame.frame != self.frame:
                    return []  # cut short, so that the position of the camera is missing, or of another frame
                at = frame.transform.translation_m
                if not all(abs(value) <= MOST_M for value in (at.x, at.y, at.z)):
                    return []
                models.append((self._lag_s(frame), PlacedModel(model, (at.x, at.y, at.z))))
        return models


def _exposure_ns(content: pb.PrismsFrame | pb.SurroundFrame) -> int:
    """The exposure that the age of a message refers to; 0: none."""
    return content.t_exposure_ns if isinstance(content, pb.PrismsFrame) else content.t_ns


@dataclass(slots=True)
class ReceiveStats:
    """Counts of received messages. undecodable: not a message of this schema; out_of_order: not newer than an earlier one;
    conflicting: not used because two services publish to the address; last_error: the address and cause of the last undecodable or
    conflicting one."""

    messages: int = 0
    undecodable: int = 0
    out_of_order: int = 0
    conflicting: int = 0
    last_error: str = ""


class Subscriber(StreamSubscriber):
    """Receives the obstacle stream of the service; only the newest message is kept.

    address: None: the service on this machine; all_cameras: receive all cameras as one message. With several cameras a message
    is otherwise of one of them, whichever was published last. timeout_s: age at which a message becomes stale; keys: folder of
    this client's CURVE keys, for a service on another machine. Raises KeyFileError. Not thread-safe: use one subscriber per
    thread."""

    def __init__(
        self,
        address: str | None = None,
        *,
        all_cameras: bool = False,
        timeout_s: float = TIMEOUT_S,
        keys: Path | None = None,
    ) -> None:
        super().__init__("surround" if all_cameras else "prisms", address, keys)
        self._kind = pb.SurroundFrame if all_cameras else pb.PrismsFrame
        self._timeout_s = timeout_s
        self.stats = ReceiveStats()
        self._delays = Delays()
        self._sources = Sources()
        self._newest: Message | None = None

    def latest(self) -> Message | None:
        """The newest message, without waiting; None before the first. Check `stale`: it may be an old one."""
        while self._receive(0):
            pass
        return self._newest

    def wait(self, timeout_s: float) -> Message | None:
        """The next message; None when none comes within timeout_s, a year at most."""
        end_ns = deadline_ns(timeout_s)
        while True:
            left_ms = max(0, (end_ns - clock_ns()) // 1_000_000)
            if self._receive(left_ms):
                return self._newest
            if clock_ns() >= end_ns:
                return None

    def messages(self, silence_s: float = 1.0) -> Iterator[Message]:
        """Each message as it comes. After silence_s without one the last message is repeated; its age then shows that nothing
        comes."""
        while True:
            message = self.wait(silence_s) or self._newest
            if message is not None:
                yield message

    def subscribe(self, on_message: Callable[[Message], bool | None], silence_s: float = 1.0) -> None:
        """Calls on_message with each of `messages` until it returns False."""
        for message in self.messages(silence_s):
            if on_message(message) is False:
                return

    def _receive(self, timeout_ms: int) -> bool:
        """Receives one message. False: none came, or it was not used."""
        received = self._socket.take(timeout_ms)
        if received is None:
            return False
        data, received_ns = received
        content = self._kind()
        try:
            content.ParseFromString(data)
        except DecodeError as error:
            self._count_undecodable(f"{len(data)} bytes are not a {self._kind.DESCRIPTOR.name} ({error})")
            return False
        if content.schema_version != SCHEMA_VERSION:
            self._count_undecodable(
                f"schema version {content.schema_version}; this client reads {SCHEMA_VERSION}: update osape-client"
            )
            return False
        if not content.HasField("publication"):  # without it the age is not known
            self._count_undecodable(f"{len(data)} bytes are cut short: the part that is written last is missing")
            return False
        verdict = self._sources.take(content.publication, _exposure_ns(content), received_ns)
        if verdict is Verdict.CONFLICT:
            self._refuse_all()
            return False
        if verdict is Verdict.LATE or not self._is_newer(content):
            self.stats.out_of_order += 1
            return False
        self.stats.messages += 1
        arrival_ns = self._delays.arrival_ns(content.publication, _exposure_ns(content), received_ns)
        self._newest = Message(content, arrival_ns, self._timeout_s)
        return True

    def _is_newer(self, content: pb.PrismsFrame | pb.SurroundFrame) -> bool:
        """Whether it was published after the newest one; a restarted service counts from 0 again."""
        if self._newest is None:
            return True
        before, after = self._newest.content.publication, content.publication
        return (
            before.boot_id != after.boot_id
            or before.start_ns != after.start_ns
            or after.number > before.number
            or after.number == 0
            or self._newest.stale
        )

    def _refuse_all(self) -> None:
        """Two services publish: makes the newest message stale, which may be that of another vehicle."""
        self.stats.conflicting += 1
        self.stats.last_error = f"{self.address}: {CONFLICT_TEXT}"
        if self._newest is not None:
            self._newest = replace(self._newest, timeout_s=0.0, refused=CONFLICT_TEXT)

    def _count_undecodable(self, error: str) -> None:
        self.stats.undecodable += 1
        self.stats.last_error = f"{self.address}: {error}"
