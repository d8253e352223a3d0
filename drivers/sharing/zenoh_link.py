"""Packets between vehicles over zenoh: Wi-Fi, meshes and routers. Authentication and encryption are zenoh's own, in its
configuration file (TLS, user and password).

A sample on `osape/TEAM/VEHICLE` is a CRC-32 and one packet. Congested links drop samples instead of delaying them."""

from __future__ import annotations

import json
import threading
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from ..base import BadData, DriverError
from ..optional_library import optional_module
from ..watched_thread import WatchedThread
from .link import Deliver, ReceivedPacket

NAME: Final = "zenoh"
REQUIREMENT: Final = "eclipse-zenoh>=1.10"
CRC_BYTES: Final = 4
OVERHEAD_BYTES: Final = CRC_BYTES + 46
"""Of a sample: checksum, key, and zenoh's and TCP's own headers, about."""
PACKET_BYTES: Final = 1400
AGAIN_S: Final = 5.0
MOST_DIGITS: Final = 3


def checked(packet: bytes) -> bytes:
    """A packet with its checksum."""
    return zlib.crc32(packet).to_bytes(CRC_BYTES, "little") + packet


def unchecked(sample: bytes) -> bytes | None:
    """The packet of a sample; None where the checksum is wrong."""
    packet = sample[CRC_BYTES:]
    fits = len(sample) > CRC_BYTES and zlib.crc32(packet) == int.from_bytes(sample[:CRC_BYTES], "little")
    return packet if fits else None


def sender_of(key: str) -> int | None:
    """The number of the vehicle at the end of a key; None where there is none."""
    number = key.rpartition("/")[2]
    is_number = number.isdecimal() and len(number) <= MOST_DIGITS and 0 < int(number) < 256
    return int(number) if is_number else None


def is_authenticated(config: Path) -> bool:
    """Whether a zenoh configuration mentions users or TLS with certificates of both sides. Raises BadData."""
    zenoh = _library()
    settings = _config(zenoh, config)

    def value(key: str) -> Any:
        return json.loads(settings.get_json(key))

    user, dictionary = value("transport/auth/usrpwd/user"), value("transport/auth/usrpwd/dictionary_file")
    return bool(user or dictionary or value("transport/link/tls/enable_mtls"))


class ZenohLink:
    """A `TeamLink`. team: name of the team, a part of the key; config: zenoh's configuration file (JSON5)."""

    name = NAME
    overhead_bytes = OVERHEAD_BYTES
    packet_bytes = PACKET_BYTES

    def __init__(self, team: str, config: Path, deliver: Deliver) -> None:
        self._team, self._config, self._deliver = team, config, deliver
        self._session: Any = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._fault = "not opened yet"
        self._refused: Counter[str] = Counter()
        self._thread = WatchedThread(self._run, "team zenoh")

    @property
    def fault(self) -> str:
        return self._thread.failure or self._fault

    @property
    def refused(self) -> dict[str, int]:
        return dict(self._refused)

    def open(self) -> None:
        self._thread.start()

    def send(self, packets: Sequence[bytes], vehicle: int) -> None:
        with self._lock:
            if self._session is None:
                return
            zenoh = _library()
            for packet in packets:
                try:
                    self._session.put(
                        f"osape/{self._team}/{vehicle}",
                        checked(packet),
                        congestion_control=zenoh.CongestionControl.DROP,
                    )
                except zenoh.ZError as error:
                    self._fault = f"zenoh: a packet was not sent ({error})"
                    return
            self._fault = ""

    def confirm(self, packet: ReceivedPacket) -> None:
        """Nothing to do: zenoh manages its peers."""

    def close(self) -> None:
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(5.0)

    def _run(self) -> None:
        """Opens the session, tries again while that fails, and closes it in the end."""
        while not self._stop.is_set() and not self._opened():
            self._stop.wait(AGAIN_S)
        self._stop.wait()
        with self._lock:
            session, self._session = self._session, None
        if session is not None:
            session.close()

    def _opened(self) -> bool:
        try:
            zenoh = _library()
            settings = _config(zenoh, self._config)
        except DriverError as error:
            self._fault = str(error)
            return False
        session: Any = None
        try:
            session = zenoh.open(settings)
            session.declare_subscriber(f"osape/{self._team}/*", self._take)
        except zenoh.ZError as error:
            if session is not None:
                session.close()
            self._fault = f"zenoh: the session cannot be opened ({error}); check {self._config}"
            return False
        with self._lock:
            self._session, self._fault = session, ""
        return True

    def _take(self, sample: Any) -> None:
        """Called from a thread of the library."""
        arrival_ns = time.monotonic_ns()
        if len(sample.payload) > CRC_BYTES + PACKET_BYTES:  # before it is copied
            self._refused["too_long"] += 1
            return
        packet = unchecked(sample.payload.to_bytes())
        sender = sender_of(str(sample.key_expr))
        if packet is None or sender is None:
            self._refused["checksum" if packet is None else "bad_key"] += 1
            return
        self._deliver(ReceivedPacket(NAME, packet, arrival_ns, sender))


def _library() -> Any:
    return optional_module("zenoh", "zenoh: the library is not installed", REQUIREMENT)


def _config(zenoh: Any, path: Path) -> Any:
    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        raise BadData(f"zenoh: {path} is no configuration of zenoh ({error}); correct it") from error
