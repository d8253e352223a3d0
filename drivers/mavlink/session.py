"""The companion's side of a MAVLink link: bytes and times to samples, and messages to bytes.

It has no input, output or clock; `drivers.mavlink.link` connects it to a transport. Before the first heartbeat of the
autopilot only heartbeats are sent, and only on links whose other end waits for them."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Sequence
from typing import Any

from core.types import AttitudeSample, PoseSample

from .anomalies import LinkAnomaly
from .bandwidth import LinkBudget, budget_of
from .clock_bounds import NS
from .clock_sync import ClockFilter, ClockSource
from .conflicts import ConflictDetector
from .dialect import dialect
from .motion import MOTION, MotionDecoder
from .outbox import OBSTACLE_IDS, Outbox
from .own_vehicle import OwnVehicle
from .parser import Frame, MessageSplitter
from .rates import RateMonitor
from .session_types import (
    ATTITUDE_ID,
    ATTITUDE_QUATERNION_ID,
    LOCAL_POSITION_NED_ID,
    LinkStatus,
    MavlinkParams,
    Vehicle,
)
from .signing import Signing, for_the_log
from .timesync import TimeSync
from .transport import Chunk, Source

_READ = frozenset({dialect.MAVLINK_MSG_ID_HEARTBEAT, dialect.MAVLINK_MSG_ID_COMMAND_ACK})
MOST_SOURCES = 16


class MavlinkSession:
    """State of a link. `receive` and `due` must be called in the order of events, by one thread at a time."""

    def __init__(
        self,
        params: MavlinkParams | None = None,
        on_frame: Callable[[bytes, int], None] | None = None,
        on_message: Callable[[Any, int], None] | None = None,
        signing: Signing | None = None,
        reads: frozenset[int] | None = None,
        expected: Vehicle | None = None,
        on_foreign: Callable[[Frame, int], None] | None = None,
        foreign_ids: frozenset[int] = frozenset(),
    ) -> None:
        """Creates a session without a received autopilot.

        Args:
            params: ids and requested rates.
            on_frame: called with every accepted frame as received, without its signature, and its arrival time, for
                the log.
            on_message: called with every accepted message of the autopilot of the kinds in `reads`, decoded; not with a
                COMMAND_ACK to others.
            signing: with the companion's key. Without a key nothing is signed and unsigned messages are accepted.
            reads: ids of messages for on_message; None: all but motion. Decoding takes most of the time.
            expected: the autopilot of the last run. Any message of it counts before its first heartbeat.
            on_foreign: called with accepted messages of other vehicles, not decoded.
            foreign_ids: ids of messages for on_foreign."""
        self.params = params or MavlinkParams()
        self.clock = ClockFilter()
        self.system_status = dialect.MAV_STATE_STANDBY
        self.counts: Counter[LinkAnomaly] = Counter()
        self.received = 0
        self._on_frame, self._on_message, self._reads = on_frame, on_message, reads
        self._on_foreign, self._foreign_ids = on_foreign, foreign_ids
        self._timesync = TimeSync(self.clock)
        self._conflicts = ConflictDetector(self.params.component_id)
        self.own = OwnVehicle(self.params.system_id, expected, self._conflicts)
        self._motion = MotionDecoder(self.clock, self._timesync.two_clocks_answer, self._conflicts.several_vehicles)
        self.rates = RateMonitor(self.params.rate_requests())
        self._splitters: OrderedDict[Source, MessageSplitter] = OrderedDict()
        self._splitter_counts: Counter[LinkAnomaly] = Counter()
        self._signing = signing or Signing()
        self._place = 0
        self.last_chunk: int | None = None
        self._encoder = dialect.MAVLink(None)
        self._encoder.srcComponent = self.params.component_id
        self._next_heartbeat_ns = 0
        self._clock_restarts = 0
        self._outbox = Outbox()

    # ---- in -----------------------------------------------------------------------------------------------------

    def receive(
        self, chunks: list[Chunk], sources: Sequence[Source] | None = None
    ) -> list[AttitudeSample | PoseSample]:
        """Returns the samples in the received chunks, in order.

        `last_chunk` is then the index of the newest chunk of the autopilot; None: there is none.

        Args:
            chunks: bytes and arrival times.
            sources: sender of each chunk; None: the same for all. A partial message of one sender does not affect
                those of another."""
        samples: list[AttitudeSample | PoseSample] = []
        self.last_chunk = None
        for self._place, (data, arrival_ns) in enumerate(chunks):
            self.own.arrives(arrival_ns)
            splitter = self._splitter(None if sources is None else sources[self._place])
            for frame in splitter.frames(data):
                sample = self._take(frame, arrival_ns)
                if sample is not None:
                    samples.append(sample)
        return samples

    def new_line(self) -> None:
        """Discards partial messages after the transport was opened again."""
        self._splitters.clear()

    def _splitter(self, source: Source) -> MessageSplitter:
        """Returns the splitter of a sender. Only the newest senders have one, because addresses can be forged."""
        splitter = self._splitters.get(source)
        if splitter is None:
            splitter = self._splitters[source] = MessageSplitter(self._splitter_counts)
            if len(self._splitters) > MOST_SOURCES:
                self._splitters.popitem(last=False)
        else:
            self._splitters.move_to_end(source)
        return splitter

    def _take(self, frame: Frame, arrival_ns: int) -> AttitudeSample | PoseSample | None:
        self.received += 1
        vehicle = self.vehicle
        if not self._signing.believes(frame, arrival_ns, vehicle.system_id if vehicle else self.params.system_id):
            return None
        if self._on_frame is not None and (logged := for_the_log(frame)) is not None:
            self._on_frame(logged, arrival_ns)
        if vehicle is None:
            self.own.recognise(frame)
            vehicle = self.vehicle
        own = self.own.is_source(frame)
        if not own:
            self._conflicts.received(frame, vehicle.system_id if vehicle else 0, arrival_ns)
        if frame.id in self._foreign_ids and self._on_foreign is not None:
            if vehicle is None or frame.system != vehicle.system_id:
                self._on_foreign(frame, arrival_ns)
            return None
        if frame.id in MOTION:
            return self._moves(frame, arrival_ns) if own else None
        self._take_other(frame, arrival_ns, from_autopilot=own)
        return None

    def _take_other(self, frame: Frame, arrival_ns: int, *, from_autopilot: bool) -> None:
        """Takes a message that is not motion."""
        if frame.id == dialect.MAVLINK_MSG_ID_TIMESYNC:
            self._timesync.take(frame, arrival_ns, from_autopilot=from_autopilot)
            self._follow_clock()
        if not self._is_read(frame.id):
            if from_autopilot:
                self._note_autopilot(frame.id, arrival_ns)
            return
        message = frame.message()
        if message is None:
            self.counts[LinkAnomaly.UNDECODABLE_MESSAGE] += 1
        else:
            self._read(frame.id, message, arrival_ns)

    def _is_read(self, kind: int) -> bool:
        """True if a message of this kind, other than motion, is used. Others are not decoded, because decoding takes
        most of the time."""
        return kind in _READ or (self._on_message is not None and self._is_for_user(kind))

    def _is_for_user(self, kind: int) -> bool:
        return self._reads is None or kind in self._reads

    def _moves(self, frame: Frame, arrival_ns: int) -> AttitudeSample | PoseSample | None:
        self._note_autopilot(frame.id, arrival_ns)
        if not self._motion.wants(frame.id, arrival_ns):
            return None
        sample = self._motion.decode(frame, arrival_ns)
        self._follow_clock()
        return sample

    def _read(self, kind: int, message: Any, arrival_ns: int) -> None:
        if kind == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            self.own.heartbeat(message, arrival_ns)
        if not self.own.is_source(message):
            return
        self._note_autopilot(kind, arrival_ns)
        self._follow_clock()
        if kind == dialect.MAVLINK_MSG_ID_COMMAND_ACK:
            if not self._is_answer(message):
                return
            self.rates.acknowledged(int(message.command), int(message.result))
        if self._on_message is not None and self._is_for_user(kind):
            self._on_message(message, arrival_ns)

    def _is_answer(self, ack: Any) -> bool:
        """True if a COMMAND_ACK of the autopilot answers a command of this service. Autopilots without target fields send 0."""
        own = self.vehicle is not None and ack.target_system in (0, self.vehicle.system_id)
        return own and ack.target_component in (0, self.params.component_id)

    def _follow_clock(self) -> None:
        """Requests rates and times again after a restart of the autopilot's clock: it has rebooted."""
        if self.clock.restarts != self._clock_restarts:
            self._clock_restarts = self.clock.restarts
            self._restart()

    def _note_autopilot(self, kind: int, arrival_ns: int) -> None:
        """Notes a message of the autopilot."""
        self.last_chunk = self._place
        self.own.received(arrival_ns)
        self.rates.received(kind, arrival_ns)

    def _restart(self) -> None:
        self._timesync.restart()
        self.rates.restart()

    def can_defer_read(self, now_ns: int) -> bool:
        """True if received bytes may wait before they are read.

        They may not while the clock is estimated from arrival times, nor while an answer to TIMESYNC is awaited: the
        time of waiting would count as delay of the link."""
        return self.clock.estimate.source is ClockSource.TIMESYNC and not self._timesync.awaits(now_ns)

    # ---- out ----------------------------------------------------------------------------------------------------

    @property
    def vehicle(self) -> Vehicle | None:
        """The received autopilot, by its newest heartbeat; None: none was received."""
        return self.own.vehicle

    def vehicles(self, now_ns: int) -> dict[int, str]:
        """Returns system id -> kind of the autopilots that may be the own one."""
        return self._conflicts.vehicles(now_ns)

    def connected(self, now_ns: int) -> bool:
        """Returns whether any message of the autopilot arrived recently."""
        return self.own.connected(now_ns)

    def post(self, message: Any, now_ns: int, decided_by: Vehicle | None = None) -> None:
        """Adds a message that the next `due` sends, unless it has waited too long by then (`outbox.VALID_NS`), or a newer
        heartbeat contradicts the one that it was decided by.

        Without a received autopilot it is dropped and counted, except for obstacles and texts to one that `own.fell_silent`."""
        self._outbox.post(message, now_ns, decided_by)

    @property
    def has_posted(self) -> bool:
        """True if a message waits to be sent."""
        return bool(self._outbox)

    def due(self, now_ns: int, sends_first: bool = False) -> list[bytes]:
        """Returns the bytes to send now. sends_first: the other end waits for a first message."""
        messages: list[Any] = []
        if not self.connected(now_ns):
            rejected, silent = self._signing.rejects_autopilot(now_ns), self.own.fell_silent(now_ns)
            texts = {dialect.MAVLINK_MSG_ID_STATUSTEXT}
            ids = texts if rejected else OBSTACLE_IDS | texts if silent else set()
            kept, dropped = self._outbox.take_only(ids, now_ns)
            self.counts[LinkAnomaly.UNSENT_NO_AUTOPILOT] += dropped
            if (sends_first or rejected) and now_ns >= self._next_heartbeat_ns:
                messages.append(self._own_heartbeat(now_ns))
            return [self._pack(m) for m in messages + kept]
        assert self.vehicle is not None
        if now_ns >= self._next_heartbeat_ns:
            messages.append(self._own_heartbeat(now_ns))
        messages.extend(self.rates.due(now_ns, self.vehicle.system_id))
        messages.extend(self._outbox.take(now_ns, self.vehicle))
        messages.extend(self._timesync.due(now_ns))
        return [self._pack(m) for m in messages]

    def _own_heartbeat(self, now_ns: int) -> Any:
        self._next_heartbeat_ns = now_ns + NS
        return dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, self.system_status, 3
        )

    def _pack(self, message: Any) -> bytes:
        # a companion shares the vehicle's system id; before it is known 1, the default of autopilots
        system = self.vehicle.system_id if self.vehicle else self.params.system_id or self._signing.claimed_system
        self._encoder.srcSystem = system or 1
        self._signing.prepare(self._encoder)
        data = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        self._conflicts.sent(data)
        return data

    # ---- status -------------------------------------------------------------------------------------------------

    def budget(self, bytes_per_s: float | None) -> LinkBudget | None:
        """Returns the data rate compared with the capacity of a line; None for a line without a limit."""
        return budget_of(self.params, bytes_per_s, signed=self._signing.on)

    def status(self, now_ns: int) -> LinkStatus:
        """Returns the status for the health report."""
        rate = self.rates.rate_hz
        counts: Counter[LinkAnomaly] = Counter({LinkAnomaly.TIMESYNC_UNPAIRED: self._timesync.unpaired})
        for some in (self.counts, self.own.counts, self._motion.counts, self._splitter_counts, self._signing.counts):
            counts.update(some)
        answered = self._timesync.answers(now_ns)
        attitude_id = ATTITUDE_ID if self._motion.wants(ATTITUDE_ID, now_ns) else ATTITUDE_QUATERNION_ID
        return LinkStatus(
            vehicle=self.vehicle,
            clock=self.clock.estimate_at(now_ns),
            clock_restarts=self.clock.restarts,
            attitude_hz=rate(attitude_id, now_ns),  # of the kind that is used
            position_hz=rate(LOCAL_POSITION_NED_ID, now_ns),
            received=self.received,
            counts={what.value: often for what, often in counts.items() if often},
            signed=self._signing.good(now_ns),
            conflicts=self._conflicts.texts(
                now_ns,
                self.params.system_id,
                connected=self.connected(now_ns),
                two_clocks=self.clock.mixed(now_ns),
                two_vehicles=self._motion.two_vehicles(now_ns),
            ),
            signing_fault=self._signing.fault(now_ns, answered=answered),
            timesync_answered=self._timesync.synchronises(now_ns),
            attitude_repeated=self._motion.attitude_repeated(now_ns),
            stamps_used=self.clock.usable,
            vehicle_uncertain=self._conflicts.several_vehicles(now_ns) or self._motion.two_vehicles(now_ns),
        )
