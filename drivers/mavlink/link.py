"""Runs a MAVLink session in a thread of its own: reads, writes, and opens the link again when it is lost.

Waking the thread for each message costs ten times as much as reading it. Once the clocks are synchronised, messages
are therefore read together, the last time shortly before a frame is expected. `catch_up` reads at once what has
arrived."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from core.types import AttitudeSample, PoseSample

from ..base import DriverError
from ..watched_thread import WatchedThread
from .address import Address
from .anomalies import LinkAnomaly
from .bandwidth import LinkBudget
from .open_transport import Opening
from .session import MavlinkSession
from .session_types import LinkStatus, Vehicle
from .transport import Chunk, Transport

NS = 1_000_000_000
READ_S = 0.01
"""Longest wait for bytes while each chunk is read on arrival."""
PAUSE_S = 0.042
"""Time between two reads of a link on which messages may wait: the greatest delay of reading, and of messages that
the session sends by itself. Posted messages are sent at once. It is slightly more than half a frame interval at 12
Hz."""
LONGEST_PAUSE_S = 0.11
"""The same while little data arrives and `catch_up` will read it."""
LEAD_NS = 3_000_000
"""The link is read this long before a frame is expected, so that little is left to read when it arrives."""
LEAST_APART_NS = 5_000_000
"""With more frequent calls of `catch_up` the next frame cannot be predicted."""
MUCH_BYTES = 2048
"""After a read of this many bytes the next one follows at once: the buffer of a serial line holds 4096."""
LITTLE_BYTES = 1024
"""Below this number of bytes a read may pause for LONGEST_PAUSE_S: the next bytes stay well below that buffer."""
STUCK_NS = NS
"""After this time with a backlog the line is reported."""
FEW_BYTES, MOST_WAIT_S = 4096, 0.005
"""Limits of bytes and time of one `catch_up`; an autopilot sends a tenth of it in a pause."""
FIRST_BACKOFF_S, LONGEST_BACKOFF_S = 0.25, 5.0
LONGEST_CLOSE_S = 1.0
"""Longest wait for a transport to close at the end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkState:
    """State of a link."""

    alive_ns: int  # time of the last cycle of the thread
    open: bool = False  # the link is open
    error: str = ""  # why it is not, as text
    warning: str = ""  # that it is slow or does not send, as text
    flood: str = ""  # that datagrams are dropped, as text
    losses: int = 0  # how often it was lost


class PollScheduler:
    """Predicts the next `catch_up` from the last two, to read shortly before it."""

    def __init__(self) -> None:
        self._last_ns = self._apart_ns = 0

    def asked(self, now_ns: int) -> None:
        """Records a call of `catch_up`."""
        self._last_ns, self._apart_ns = now_ns, now_ns - self._last_ns

    def pause_s(self, now_ns: int, *, little: bool = False) -> float:
        """Returns the time until the next read.

        It is at most PAUSE_S and at least half of it, and chosen such that one of the following reads comes LEAD_NS
        before the next expected `catch_up`. little: little data arrives; LONGEST_PAUSE_S is then the limit."""
        last_ns, apart_ns = self._last_ns, self._apart_ns
        if not LEAST_APART_NS <= apart_ns <= NS or now_ns - last_ns > 2 * apart_ns:
            return PAUSE_S
        ahead_s = (last_ns + apart_ns - LEAD_NS - now_ns) / NS
        while ahead_s < 0.5 * PAUSE_S:
            ahead_s += apart_ns / NS
        return ahead_s / math.ceil(ahead_s / (LONGEST_PAUSE_S if little else PAUSE_S))


class MavlinkLink:
    """Runs a session until closed.

    `deliver` is called after each read that brought bytes, with the samples in order of arrival. It runs in the
    link's thread or in that of the caller of `catch_up`, and must not block."""

    def __init__(
        self,
        address: Address,
        session: MavlinkSession,
        deliver: Callable[[list[AttitudeSample | PoseSample]], None],
    ) -> None:
        self._address = address
        self._session = session
        self._deliver = deliver
        self._lock = threading.Lock()
        self._turn = threading.Lock()
        self._transport: Transport | None = None
        self._left: list[Chunk] = []
        self._broken: DriverError | None = None
        self._poll_scheduler = PollScheduler()
        self._backlog_since_ns: int | None = None
        self._stop = threading.Event()
        self._wake_event = threading.Event()
        self.budget: LinkBudget | None = None
        self._state = LinkState(alive_ns=time.monotonic_ns(), error="not opened yet")
        self._thread = WatchedThread(self._run, "mavlink")

    def open(self) -> None:
        """Starts the thread. The link may be opened later."""
        self._thread.start()

    def close(self) -> None:
        """Stops the thread and closes the link. May be called twice.

        If an exception has ended the thread, messages posted since are sent from here: the autopilot must learn that
        the service is blind."""
        self._stop.set()
        self._wake_event.set()
        if self._thread.ident is not None:
            self._thread.join(2.0)
        if self._thread.failure and self._transport is not None:
            with self._turn:
                transport, self._transport = self._transport, None
                try:
                    self._send_posted(transport)
                finally:
                    transport.close()

    @property
    def failure(self) -> str:
        """Exception that ended the thread, as text; empty: none."""
        return self._thread.failure

    @property
    def state(self) -> LinkState:
        """State of the link."""
        return self._state

    def post(self, message: Any, decided_by: Vehicle | None = None) -> None:
        """Sends a message with the next cycle of the thread, if an autopilot is received. Distances and commands that wait
        for too long are dropped, see `outbox.VALID_NS`, and a message where a newer heartbeat contradicts the one that it was
        decided by."""
        with self._lock:
            self._session.post(message, time.monotonic_ns(), decided_by)
        self._wake_event.set()

    def catch_up(self) -> None:
        """Reads and delivers what has arrived, in the caller's thread.

        Without an open link it does nothing. Errors, and amounts that take long to parse such as noise, are left to
        the link's thread, because no frame may wait for them. It opens the link again after an error."""
        self._poll_scheduler.asked(time.monotonic_ns())
        if not self._turn.acquire(timeout=MOST_WAIT_S):
            return
        try:
            if self._transport is None or self._left:
                return
            self._left = self._transport.read()
            if _bytes(self._left) > FEW_BYTES:
                self._wake_event.set()
            elif self._left:
                self._round(self._transport)
        except DriverError as failure:
            self._broken = failure
            self._wake_event.set()
        finally:
            self._turn.release()

    def set_system_status(self, status: int) -> None:
        """Sets the MAV_STATE of the heartbeat, the state of the pipeline."""
        with self._lock:
            self._session.system_status = status

    def status(self) -> LinkStatus:
        """Returns the status of the session, and the number of datagrams dropped as a flood since the link was
        opened."""
        transport = self._transport
        dropped = transport.flood.dropped if transport is not None and transport.flood is not None else 0
        with self._lock:
            status = self._session.status(time.monotonic_ns())
        return replace(status, counts=status.counts | {LinkAnomaly.FLOOD_DROPPED.value: dropped}) if dropped else status

    def _update_state(self, **changes: Any) -> None:
        """Changes the state, and reports that the thread is alive."""
        self._state = replace(self._state, alive_ns=time.monotonic_ns(), **changes)

    def _run(self) -> None:
        backoff_s = FIRST_BACKOFF_S
        self._update_state(error="opening")
        while not self._stop.is_set():
            transport: Transport | None = None
            try:
                transport = self._opened()
                if transport is None:
                    break
                opened_ns = time.monotonic_ns()
                self._talk(transport)
                self._update_state(open=False)
            except DriverError as failure:
                self._update_state(open=False, error=str(failure), warning="", flood="")
                if transport is not None:
                    self._update_state(losses=self._state.losses + 1)
                    if time.monotonic_ns() - opened_ns > LONGEST_BACKOFF_S * NS:
                        backoff_s = FIRST_BACKOFF_S
            # not after another exception: `close` then needs the line for the last message
            if transport is not None:
                with self._turn:
                    self._transport, self._left = None, []
                self._close(transport)
            if not self._stop.is_set():
                self._wait(backoff_s)
                backoff_s = min(2.0 * backoff_s, LONGEST_BACKOFF_S)

    def _opened(self) -> Transport | None:
        """Opens the transport. Raises DriverError. None: the link was closed meanwhile.

        The name of a host may take many seconds to resolve. It is opened in a thread of its own, so that this one is seen
        to be alive."""
        opening = Opening(self._address)
        opening.start()
        while not opening.done.wait(0.1):
            self._update_state()
            if self._stop.is_set():
                opening.abandon()
                return None
        return opening.result()

    def _close(self, transport: Transport) -> None:
        """Closes a transport, in a thread of its own: the kernel may wait long for a serial device that takes no bytes. The
        device cannot be opened again before."""
        closing = WatchedThread(transport.close, "mavlink close")
        closing.start()
        while closing.is_alive() and not self._stop.is_set():
            closing.join(0.1)
            self._update_state()
        closing.join(LONGEST_CLOSE_S)

    def _talk(self, transport: Transport) -> None:
        self.budget = self._session.budget(transport.bytes_per_s)
        warning = self.budget.warning() if self.budget is not None else ""
        self._update_state(open=True, error="", warning=warning)
        with self._lock:
            self._session.new_line()
        with self._turn:
            self._transport, self._broken, self._backlog_since_ns = transport, None, None
        size = 0
        while not self._stop.is_set():
            if size < MUCH_BYTES:
                self._await(transport, little=size < LITTLE_BYTES)
            with self._turn:
                if self._broken is not None:  # a write may fail once only, after a part of a message
                    raise self._broken
                size = self._round(transport)
            now_ns = time.monotonic_ns()
            flood = transport.flood.text(now_ns) if transport.flood is not None else ""
            stuck = self._stuck_text(transport, now_ns)
            self._update_state(warning=stuck or warning, flood=flood)
        self._send_posted(transport)

    def _send_posted(self, transport: Transport) -> None:
        """Sends the posted messages before the link is closed."""
        with self._lock:
            if self._session.has_posted:
                for data in self._session.due(time.monotonic_ns(), transport.sends_first):
                    transport.write(data)

    def _await(self, transport: Transport, *, little: bool) -> None:
        """Waits until there is something to do: for a pause if received bytes may wait, otherwise until the first
        byte. little: little data came with the last read."""
        now_ns = time.monotonic_ns()
        if self._session.can_defer_read(now_ns):
            self._wake_event.wait(self._poll_scheduler.pause_s(now_ns, little=little))
            self._wake_event.clear()
        elif not self._session.has_posted or self._backlog_since_ns is not None:
            transport.wait(READ_S)

    def _round(self, transport: Transport) -> int:
        """Reads, delivers the samples and sends what is due; returns the number of bytes read. Bytes that `catch_up`
        has left come first. Only one thread may call this at a time."""
        chunks, self._left = self._left or transport.read(), []
        with self._lock:
            samples = self._session.receive(chunks, transport.sources)
        if chunks:
            self._deliver(samples)  # before anything is sent: a line that breaks then takes nothing along
        with self._lock:
            if self._session.last_chunk is not None:
                transport.answer(self._session.last_chunk)
            if not self._has_backlog(transport):
                for data in self._session.due(time.monotonic_ns(), transport.sends_first):
                    transport.write(data)
        return _bytes(chunks)

    def _has_backlog(self, transport: Transport) -> bool:
        """Returns whether so much waits in the buffer of the line that distances would arrive old."""
        if transport.waiting_bytes <= transport.backlog_bytes:
            self._backlog_since_ns = None
            return False
        self._backlog_since_ns = self._backlog_since_ns or time.monotonic_ns()
        return True

    def _stuck_text(self, transport: Transport, now_ns: int) -> str:
        """Returns that the line has had a backlog for STUCK_NS, as text; empty: it has not."""
        since_ns = self._backlog_since_ns
        if since_ns is None or now_ns - since_ns < STUCK_NS:
            return ""
        return (
            f"the line takes no messages: {transport.waiting_bytes} bytes have waited in its buffer for "
            f"{(now_ns - since_ns) / NS:.0f} s; {transport.backlog_remedy}"
        )

    def _wait(self, seconds: float) -> None:
        """Waits between two attempts to open the link."""
        until_ns = time.monotonic_ns() + round(seconds * NS)
        while time.monotonic_ns() < until_ns and not self._stop.wait(0.1):
            self._update_state()


def _bytes(chunks: list[Chunk]) -> int:
    return sum(len(data) for data, _ in chunks)
