"""Receiving the tracked obstacles of a camera: the newest message and its age.

with TracksSubscriber() as subscriber:
    received = subscriber.wait(1.0)
    if received is not None and not received.stale:
        print(received.tracks.objects)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from google.protobuf.message import DecodeError

from .clock import clock_ns, deadline_ns
from .proto import osape_v1_pb2 as pb
from .receive_time import Delays, age_ns
from .sources import CONFLICT_TEXT, Sources, Verdict
from .stream_subscriber import StreamSubscriber, check_complete
from .tracks import Tracks, tracks_from_message

NS = 1_000_000_000
SCHEMA_VERSION = 1


@dataclass(frozen=True, eq=False)
class ReceivedTracks:
    """One message. received_ns: the earliest time at which it can have arrived, by `clock.clock_ns`."""

    content: pb.Tracks
    received_ns: int
    timeout_s: float

    @property
    def age_s(self) -> float:
        """Upper bound of the present age of the exposure. On another machine it lacks the least time on the
        network."""
        return age_ns(self.content.publication, self.content.t_exposure_ns, self.received_ns) / NS

    @property
    def stale(self) -> bool:
        """Whether it is too old to be used."""
        return not self.age_s <= self.timeout_s

    @cached_property
    def tracks(self) -> Tracks:
        """The tracks. Raises ValueError where the parts of the message do not fit together."""
        return tracks_from_message(self.content)


class TracksSubscriber(StreamSubscriber):
    """Receives the stream `tracks`; only the newest message is kept, of whichever camera. Messages of another schema, and
    those without the part that is written last, are counted in `undecodable`, those that are not used because two services publish to
    the address in `conflicting`; `last_error` is the address and the cause of the last one. Not thread-safe.

    address: None: the service on this machine; timeout_s: age at which a message becomes stale; keys: folder of this
    client's CURVE keys. Raises KeyFileError."""

    def __init__(self, address: str | None = None, *, timeout_s: float = 0.4, keys: Path | None = None) -> None:
        super().__init__("tracks", address, keys)
        self.undecodable, self.conflicting, self.last_error = 0, 0, ""
        self._delays, self._sources = Delays(), Sources()
        self._timeout_s = timeout_s

    def wait(self, timeout_s: float) -> ReceivedTracks | None:
        """The next message; None when none comes within timeout_s, a year at most."""
        end_ns = deadline_ns(timeout_s)
        while True:
            received = self._socket.take(max(0, (end_ns - clock_ns()) // 1_000_000))
            if received is not None:
                content = self._decoded(received[0])
                if content is not None and self._is_usable(content, received[1]):
                    arrival_ns = self._delays.arrival_ns(content.publication, content.t_exposure_ns, received[1])
                    return ReceivedTracks(content, arrival_ns, self._timeout_s)
            if clock_ns() >= end_ns:
                return None

    def _decoded(self, data: bytes) -> pb.Tracks | None:
        """None: another message, which is counted."""
        content = pb.Tracks()
        try:
            content.ParseFromString(data)
            check_complete(content, SCHEMA_VERSION)
        except (DecodeError, ValueError) as error:
            self.undecodable += 1
            self.last_error = f"{self.address}: {error}"
            return None
        return content

    def _is_usable(self, content: pb.Tracks, received_ns: int) -> bool:
        """False: of a service that has ended, or of one of two."""
        verdict = self._sources.take(content.publication, content.t_exposure_ns, received_ns)
        if verdict is Verdict.CONFLICT:
            self.conflicting += 1
            self.last_error = f"{self.address}: {CONFLICT_TEXT}"
        return verdict is Verdict.USED
