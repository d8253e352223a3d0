"""Random flights of an autopilot whose bytes reach the service over a faulty line. The true attitude and position at each exposure are
known: they come from sums of sines, not from the code under test."""

from __future__ import annotations

import heapq
import itertools
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from companion.config.sync import SyncParams
from companion.pipeline.sync import AttitudeAt, PoseAt, Synchroniser
from drivers.mavlink.dialect import dialect
from drivers.mavlink.parser import MessageSplitter
from drivers.mavlink.session import MavlinkSession

START_S = 1000.0
SLEW_S = 3.0
WRAP_S = 2**32 / 1000.0
Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Of a flight.

    attitude_id: 0: both messages, each at its own rate. route_s: half of the messages take a second route, which needs so much
    longer. burst_s: messages of the autopilot wait for the next multiple of this time. request_s: added to the delay of requests.
    slew: rate by which the clock of the companion computer is corrected during a few seconds. second_after_s: a second vehicle
    uses the same ids; it started so much later. zero_rates: none are filled in."""

    hz: float
    position_hz: float
    attitude_id: int
    answers: bool
    delay_s: float
    jitter_s: float
    bytes_per_s: float
    loss: float
    copies: float
    in_order: bool
    stalls: int
    reboot: bool
    jumps: int
    up_s: float
    route_s: float = 0.0
    burst_s: float = 0.0
    request_s: float = 0.0
    slew: float = 0.0
    frame_hz: float = 20.0
    seconds: float = 20.0
    second_after_s: float | None = None
    zero_rates: bool = False


def random_conditions(rng: random.Random, **fixed: Any) -> Conditions:
    answers = rng.random() < 0.8
    drawn: dict[str, Any] = {
        "hz": rng.choice([4, 10, 25, 50, 100]),
        "position_hz": rng.choice([3, 10, 30]),
        "attitude_id": rng.choice([30, 31]),
        "answers": answers,
        "delay_s": rng.choice([0.0005, 0.003, 0.02, 0.1] if answers else [0.0005, 0.003, 0.02]),
        "jitter_s": rng.choice([0.0005, 0.005, 0.03] if answers else [0.0005, 0.005]),
        "bytes_per_s": rng.choice([5_760, 11_520, 92_160]),
        "loss": rng.choice([0.0, 0.02, 0.2]),
        "copies": rng.choice([0.0, 0.0, 0.02]),
        "in_order": rng.random() < 0.6,
        "stalls": rng.choice([0, 1, 3]),
        "reboot": rng.random() < 0.2,
        "jumps": rng.choice([0, 2]),
        "up_s": rng.choice([3.0, 100.0, WRAP_S - 10.0, WRAP_S + 50.0]),
    }
    return Conditions(**drawn | fixed)


def harder_conditions(rng: random.Random) -> dict[str, Any]:
    """One or two of what routers, a slow way up, or a corrected clock add. Where messages keep their order, those of a second route
    delay the others; without answers to TIMESYNC such a delay cannot be detected."""
    drawn: dict[str, Any] = {
        "attitude_id": 0,
        "route_s": rng.choice([0.03, 0.2, 1.0, 3.0]),
        "burst_s": rng.choice([0.1, 0.5]),
        "request_s": rng.choice([0.1, 0.4, 1.0, 4.0]),
        "slew": rng.choice([-500e-6, -100e-6, 100e-6, 500e-6]),
    }
    return {"in_order": False} | {name: drawn[name] for name in rng.sample(list(drawn), rng.choice([1, 2]))}


class Waves:
    """A sum of sines with its derivative."""

    def __init__(self, rng: random.Random, *waves: tuple[float, float], mean: float = 0.0) -> None:
        self._mean = mean
        self._waves = [(rng.uniform(0.3, 1.0) * a, rng.uniform(0.5, 1.0) * w, rng.uniform(0.0, 6.3)) for a, w in waves]

    def __call__(self, t_s: float) -> float:
        return self._mean + sum(a * math.sin(w * t_s + phase) for a, w, phase in self._waves)

    def rate(self, t_s: float) -> float:
        return sum(a * w * math.cos(w * t_s + phase) for a, w, phase in self._waves)


@dataclass
class Vehicle:
    """The motion of a vehicle, and how its autopilot estimates heading and position: with jumps."""

    rng: random.Random
    start_s: float
    drift: float
    jumps: list[tuple[float, float, Triple]] = field(default_factory=list)  # time, turn, shift

    def __post_init__(self) -> None:
        rng = self.rng
        self.angles = (
            Waves(rng, (0.25, 3.0), (0.06, 9.0)),
            Waves(rng, (0.25, 3.0), (0.06, 9.0)),
            Waves(rng, (1.2, 0.8), (0.3, 2.5), mean=rng.uniform(-3.0, 3.0)),
        )
        self.places = tuple(Waves(rng, (8.0, 0.6), (0.5, 2.5)) for _ in range(3))

    def boot_s(self, t_s: float) -> float:
        return (t_s - self.start_s) * (1.0 + self.drift)

    def euler(self, t_s: float, estimated_at_s: float) -> Triple:
        """As estimated, with the jumps up to an instant."""
        roll, pitch, yaw = (w(t_s) for w in self.angles)
        return (
            roll,
            pitch,
            math.remainder(yaw + sum(turn for at, turn, _ in self.jumps if at <= estimated_at_s), math.tau),
        )

    def rates(self, t_s: float) -> Triple:
        roll, pitch, _ = (w(t_s) for w in self.angles)
        d_roll, d_pitch, d_yaw = (w.rate(t_s) for w in self.angles)
        return (
            d_roll - d_yaw * math.sin(pitch),
            d_pitch * math.cos(roll) + d_yaw * math.sin(roll) * math.cos(pitch),
            d_yaw * math.cos(roll) * math.cos(pitch) - d_pitch * math.sin(roll),
        )

    def place(self, t_s: float, estimated_at_s: float) -> list[float]:
        shifts = [shift for at, _, shift in self.jumps if at <= estimated_at_s]
        return [w(t_s) + sum(s[k] for s in shifts) for k, w in enumerate(self.places)]


def quaternion(euler: Triple) -> tuple[float, float, float, float]:
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in euler)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def apart_deg(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return math.degrees(2.0 * math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b, strict=True))))))


@dataclass(frozen=True)
class Exposure:
    """What was used for a frame. attitude_deg, position_m: errors; None: nothing was used."""

    t_s: float
    attitude_deg: float | None
    position_m: float | None
    conflicts: tuple[str, ...]


class RandomFlight:
    """Events in order of time. `fly` returns what was used for each frame."""

    def __init__(self, seed: int, **fixed: Any) -> None:
        self._rng = rng = random.Random(seed)
        self.conditions = c = random_conditions(rng, **fixed)
        self._end_s = START_S + c.seconds
        starts = [START_S - c.up_s] + ([] if c.second_after_s is None else [START_S - c.up_s + c.second_after_s])
        self._vehicles = [Vehicle(rng, start_s, rng.uniform(-75e-6, 75e-6)) for start_s in starts]
        self._encoders = [dialect.MAVLink(None, 1, 1) for _ in starts]
        self._splitters = [MessageSplitter() for _ in starts]
        self._session, self._sync = MavlinkSession(), Synchroniser(SyncParams())
        self._events: list[tuple[float, int, str, Any]] = []
        self._number = itertools.count()
        self._free_s = [START_S] * 2 * len(starts)  # of each line, down and up
        self._last_s = [START_S] * 2 * len(starts)
        self._off_until_s = 0.0
        self._slew_s = START_S + rng.uniform(6.0, 12.0) if c.slew else 0.0
        self.found: list[Exposure] = []
        self._plan()

    def _plan(self) -> None:
        c, rng = self.conditions, self._rng
        for k in range(len(self._vehicles)):
            for kind, hz in (("position", c.position_hz), ("heartbeat", 1.0)):
                for t_s in self._times(hz):
                    self._at(t_s, kind, k)
            for number in (c.attitude_id,) if c.attitude_id else (30, 31):
                for t_s in self._times(c.hz if number == c.attitude_id else rng.choice([4, 10, 50])):
                    self._at(t_s, "attitude", (k, number))
        for t_s in self._times(c.frame_hz):
            self._at(t_s + rng.uniform(0.03, 0.15), "frame", t_s)
        for t_s in self._times(100.0):
            self._at(t_s, "send", None)
        for _ in range(c.stalls):
            self._at(START_S + rng.uniform(4.0, c.seconds), "stall", rng.choice([0.15, 0.4, 1.2, 3.0]))
        for _ in range(c.jumps):
            self._jump(START_S + rng.uniform(6.0, c.seconds), rng.choice([-1, 1]) * rng.choice([0.03, 0.1, 0.6, 2.5]))
        if c.reboot:
            self._at(START_S + rng.uniform(8.0, 12.0), "reboot", rng.choice([0.3, 2.0, 6.0]))

    def _times(self, hz: float) -> Iterator[float]:
        phase = self._rng.random()
        return (START_S + (n + phase) / hz for n in range(int(self.conditions.seconds * hz)))

    def _jump(self, t_s: float, turn: float) -> None:
        shift = (self._rng.uniform(-4.0, 4.0), self._rng.uniform(-4.0, 4.0), 0.0)
        self._vehicles[0].jumps.append((t_s, turn, shift))

    def _at(self, t_s: float, kind: str, what: Any) -> None:
        heapq.heappush(self._events, (t_s, next(self._number), kind, what))

    def fly(self) -> list[Exposure]:
        while self._events:
            t_s, _, kind, what = heapq.heappop(self._events)
            if t_s < self._end_s:
                getattr(self, f"_{kind}")(t_s, what)
        return self.found

    @property
    def heading_jumps(self) -> int:
        """Number of jumps of the heading that the service detected."""
        return self._sync.headings.number

    # ---- the vehicles and their lines -----------------------------------------------------------------------------

    def _sent(self, k: int, t_s: float, message: Any) -> None:
        if k == 0 and t_s < self._off_until_s:
            return
        data = bytes(message.pack(self._encoders[k]))
        self._encoders[k].seq = (self._encoders[k].seq + 1) % 256
        for arrival_s in self._arrivals(k, t_s, len(data)):
            self._at(arrival_s, "received", data)

    def _arrivals(self, line: int, t_s: float, size: int) -> list[float]:
        c, rng = self.conditions, self._rng
        if rng.random() < c.loss:
            return []
        self._free_s[line] = max(t_s, self._free_s[line]) + size / c.bytes_per_s
        arrival_s = self._free_s[line] + c.delay_s + rng.expovariate(1.0 / c.jitter_s)
        if c.route_s:
            arrival_s += rng.choice([0.0, c.route_s])
        if line >= len(self._vehicles):
            arrival_s += c.request_s
        elif c.burst_s:
            arrival_s = math.ceil(arrival_s / c.burst_s) * c.burst_s
        if c.in_order:
            arrival_s = self._last_s[line] = max(arrival_s, self._last_s[line])
        return [arrival_s] + [arrival_s + rng.choice([0.002, 0.05, 0.5, 3.0])] * (rng.random() < c.copies)

    def _boot_ms(self, k: int, t_s: float) -> int:
        return int(self._vehicles[k].boot_s(t_s) * 1000.0) % 2**32

    def _attitude(self, t_s: float, sender: tuple[int, int]) -> None:
        (k, number), c = sender, self.conditions
        v = self._vehicles[k]
        rates = (0.0, 0.0, 0.0) if c.zero_rates else v.rates(t_s)
        roll, pitch, yaw = (a + self._rng.gauss(0.0, 1e-5) for a in v.euler(t_s, t_s))
        if number == 30:
            self._sent(k, t_s, dialect.MAVLink_attitude_message(self._boot_ms(k, t_s), roll, pitch, yaw, *rates))
            return
        sign = self._rng.choice([-1.0, 1.0])
        q = [sign * part for part in quaternion((roll, pitch, yaw))]
        self._sent(k, t_s, dialect.MAVLink_attitude_quaternion_message(self._boot_ms(k, t_s), *q, *rates))

    def _position(self, t_s: float, k: int) -> None:
        v = self._vehicles[k]
        velocity = [w.rate(t_s) for w in v.places]
        place = v.place(t_s, t_s)
        self._sent(k, t_s, dialect.MAVLink_local_position_ned_message(self._boot_ms(k, t_s), *place, *velocity))

    def _heartbeat(self, t_s: float, k: int) -> None:
        self._sent(k, t_s, dialect.MAVLink_heartbeat_message(2, 12, 128, 0, 4, 3))

    def _stall(self, t_s: float, duration_s: float) -> None:
        self._free_s = [max(free_s, t_s + duration_s) for free_s in self._free_s]

    def _reboot(self, t_s: float, duration_s: float) -> None:
        self._off_until_s = t_s + duration_s
        self._vehicles[0].start_s = self._off_until_s - 0.5
        self._jump(t_s, 1.0)

    def _asked(self, t_s: float, request: tuple[int, bytes]) -> None:
        k, data = request
        for message in self._splitters[k].feed(data):
            if message.get_type() == "TIMESYNC" and message.tc1 == 0 and self.conditions.answers:
                boot_ns = int(self._vehicles[k].boot_s(t_s) * 1e6) * 1000
                self._sent(k, t_s, dialect.MAVLink_timesync_message(tc1=boot_ns, ts1=message.ts1))

    def _lateness_s(self, exposure_s: float, most_s: float) -> list[float]:
        """Lateness of each estimate that was in force at most so long before or after an exposure, and as long as stamps may be
        wrong: by the delay of the line."""
        most_s += self.conditions.delay_s + self.conditions.burst_s
        jumps = (at - exposure_s for at, _, _ in self._vehicles[0].jumps)
        return [-most_s, *(late_s for late_s in jumps if abs(late_s) <= most_s), most_s]

    def _mono_ns(self, t_s: float) -> int:
        """The clock of the companion computer, which is corrected for SLEW_S."""
        corrected_s = min(max(0.0, t_s - self._slew_s), SLEW_S) if self.conditions.slew else 0.0
        return int((t_s + self.conditions.slew * corrected_s) * 1e9)

    # ---- the service ----------------------------------------------------------------------------------------------

    def _send(self, t_s: float, _: None) -> None:
        number = len(self._vehicles)
        for data in self._session.due(self._mono_ns(t_s)):
            for k in range(number):
                for arrival_s in self._arrivals(number + k, t_s, len(data)):
                    self._at(arrival_s, "asked", (k, data))

    def _received(self, t_s: float, data: bytes) -> None:
        for sample in self._session.receive([(data, self._mono_ns(t_s))]):
            self._sync.add(sample)

    def _frame(self, t_s: float, exposure_s: float) -> None:
        """An estimate from before a jump may be carried to the exposure: by 0.05 s, a position by 0.2 s, and as stamps are rounded."""
        v, t_ns = self._vehicles[0], self._mono_ns(exposure_s)
        attitude, pose = self._sync.attitude_at(t_ns), self._sync.pose_at(t_ns)
        attitude_deg = position_m = None
        if isinstance(attitude, AttitudeAt):
            attitude_deg = min(
                apart_deg(attitude.q_ned_frd_wxyz, quaternion(v.euler(exposure_s, exposure_s + late_s)))
                for late_s in self._lateness_s(exposure_s, 0.055)
            )
        if isinstance(pose, PoseAt):
            position_m = min(
                math.dist(pose.position_ned_m, v.place(exposure_s, exposure_s + late_s))
                for late_s in self._lateness_s(exposure_s, 0.21)
            )
        conflicts = self._session.status(self._mono_ns(t_s)).conflicts
        self.found.append(Exposure(t_s - START_S, attitude_deg, position_m, tuple(conflicts)))
