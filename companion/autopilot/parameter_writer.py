"""`companion doctor --apply`: the one place where parameters of an autopilot are written, and only so: listed, with a yes,
while it is disarmed, each read back."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from drivers.mavlink.dialect import MAV_COMP_ID_AUTOPILOT1, dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.transport import parse_address

from ..config.loader import Config
from ..paths import folders
from .parameters import ARDUPILOT, PX4, WHOLE, ParameterReader, value_of
from .session_factory import params_of, signing_of

NS = 1_000_000_000
FRESH_NS = 2 * NS
"""A heartbeat must be this new to say that it is disarmed."""
STILL_S = 2.5
"""And for so long none may say otherwise, before anything is proposed."""
TRIES, ANSWER_S = 3, 1.0
LEAST_DELAY_S = 0.15
"""No chain of camera, computer and line is quicker than that."""
REBOOT = frozenset({"PRX1_TYPE"})


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter, what it is and what it is to be, and why, in words."""

    name: str
    now: float
    to: float
    why: str

    def words(self) -> str:
        """For the list that is said yes to."""
        again = "; start the autopilot again afterwards" if self.name in REBOOT else ""
        return f"{self.name}: {self.now:g} -> {self.to:g} ({self.why}{again})"


def changes(kind: str, values: dict[str, float], config: Config) -> list[Change]:
    """What to write so that an autopilot with these parameters brakes. Those it did not tell are left alone, and what is
    good already, and what is a matter of taste."""
    wanted: list[tuple[str, bool, float, str]] = []
    keep_m = min(3.0, 0.5 * config.avoid.max_distance_m)
    v = values.get
    if kind == PX4:
        worst_s = config.service.stale_s + 1.0 / config.avoid.rate_hz
        dist = v("CP_DIST", keep_m)
        wanted = [
            ("CP_DIST", not 0.0 < dist < config.avoid.max_distance_m, keep_m, "the distance to keep, in m; 0 is off"),
            ("CP_GO_NO_DATA", v("CP_GO_NO_DATA", 0.0) != 0.0, 0.0, "it moves only where it was told something"),
            ("MPC_POS_MODE", v("MPC_POS_MODE", 4.0) not in (0.0, 3.0, 4.0), 4.0, "the mode that brakes"),
            (
                "CP_DELAY",
                v("CP_DELAY", 1.0) < LEAST_DELAY_S,
                round(worst_s + 0.03, 2),
                "our latency at its worst, in s",
            ),
        ]
    elif kind == ARDUPILOT:
        enable = int(v("AVOID_ENABLE", 7.0))
        margin_bad = v("AVOID_MARGIN", 2.0) + 0.2 >= config.avoid.max_distance_m
        wanted = [
            ("PRX1_TYPE", v("PRX1_TYPE", 2.0) != 2.0, 2.0, "it listens to MAVLink"),
            ("AVOID_ENABLE", not enable & 2, float(enable | 2), "it brakes for what it is told"),
            ("AVOID_MARGIN", margin_bad, min(2.0, keep_m), "room below [avoid] max_distance_m, in m"),
            ("AVOID_BEHAVE", v("AVOID_BEHAVE", 1.0) != 1.0, 1.0, "it stops instead of sliding along"),
            ("AVOID_BACKUP_SPD", v("AVOID_BACKUP_SPD", 0.0) > 0.0, 0.0, "it stands where it would back away blindly"),
        ]
    return [Change(name, values[name], to, why) for name, bad, to, why in wanted if bad and name in values]


class ParameterWriter:
    """On a line of its own: `propose`, then `write` what was said yes to. Usable as a context manager."""

    def __init__(self, config: Config, patience_s: float) -> None:
        self._config, self._patience_s = config, patience_s
        self._reader = ParameterReader()
        self._lock = threading.Lock()
        self._told: dict[str, tuple[float, int]] = {}
        self._armed_ns: int | None = None
        self._signing = signing_of(config.autopilot, folders().state)
        session = MavlinkSession(params_of(config), on_message=self._take, signing=self._signing)
        self._link = MavlinkLink(parse_address(config.autopilot.address), session, lambda samples: None)

    def __enter__(self) -> ParameterWriter:
        self._link.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._link.close()
        self._signing.close()

    def propose(self) -> list[Change]:
        """What to change, as soon as the parameters are known. Raises ValueError where nothing may be written."""
        begun_s = time.monotonic()
        while time.monotonic() - begun_s < self._patience_s:
            vehicle = self._link.status().vehicle
            if vehicle is not None:
                self._reader.begin(vehicle.autopilot, vehicle.system_id)
                for request in self._reader.due(time.monotonic_ns(), vehicle.system_id):
                    self._link.post(request)
                if self._reader.settled and time.monotonic() - begun_s > STILL_S:
                    break
            time.sleep(0.05)
        kind, _ = self._writable()
        return changes(kind, self._reader.values(), self._config)

    def write(self, wanted: list[Change]) -> Iterator[tuple[Change, str]]:
        """Each change with what went wrong, in words; empty: it was written, and read back so."""
        for change in wanted:
            try:
                yield change, self._written(change)
            except ValueError as error:
                yield change, f"not written: {error}"

    def _written(self, change: Change) -> str:
        value = 0.0
        for _ in range(TRIES):
            _, system = self._writable()
            with self._lock:
                kind_of_number = self._told[change.name][1]
            self._link.post(self._set(change, kind_of_number, system))
            time.sleep(0.2)
            with self._lock:
                del self._told[change.name]  # what counts is what it tells when it is asked again
            name = change.name.encode()
            self._link.post(dialect.MAVLink_param_request_read_message(system, MAV_COMP_ID_AUTOPILOT1, name, -1))
            answer = self._answer(change.name)
            with self._lock:
                self._told.setdefault(change.name, (change.now, kind_of_number))
            if answer is not None and abs(answer - change.to) < 1e-4:
                return ""
            value = change.now if answer is None else answer
        return f"it still tells {value:g}: written {TRIES} times and not taken; set it from the ground station"

    def _answer(self, name: str) -> float | None:
        end_s = time.monotonic() + ANSWER_S
        while time.monotonic() < end_s:
            with self._lock:
                if name in self._told:
                    return self._told[name][0]
            time.sleep(0.02)
        return None

    def _set(self, change: Change, kind_of_number: int, system: int) -> Any:
        value = change.to
        if self._reader.kind == PX4 and kind_of_number in WHOLE:  # its bytes in the float's place
            value = struct.unpack("<f", struct.pack(WHOLE[kind_of_number], int(change.to)).ljust(4, b"\0"))[0]
        return dialect.MAVLink_param_set_message(
            system, MAV_COMP_ID_AUTOPILOT1, change.name.encode(), value, kind_of_number
        )

    def _take(self, message: Any, arrival_ns: int) -> None:
        self._reader.take(message, arrival_ns)
        if message.get_type() == "HEARTBEAT" and int(message.base_mode) & 128:
            self._armed_ns = arrival_ns
        if message.get_type() == "PARAM_VALUE":
            with self._lock:
                value = value_of(message, self._reader.kind)
                self._told[str(message.param_id)] = (value, int(message.param_type))

    def _writable(self) -> tuple[str, int]:
        """The autopilot's kind and system id. Raises ValueError where nothing may be written to it."""
        status, now_ns = self._link.status(), time.monotonic_ns()
        vehicle = status.vehicle
        if vehicle is None or now_ns - vehicle.heartbeat_ns > FRESH_NS:
            raise ValueError("no heartbeat of an autopilot that is believed: is it on, and sending here?")
        if vehicle.armed or (self._armed_ns is not None and now_ns - self._armed_ns < 10 * NS):
            raise ValueError("it is ARMED, or was a moment ago: parameters are written while it is disarmed only")
        trouble = status.signing_trouble or next(iter(status.conflicts.values()), "")
        if trouble:
            raise ValueError(f"target system is ambiguous: {trouble}")
        return vehicle.autopilot, vehicle.system_id


def apply(config: Config, patience_s: float, agreed: Callable[[list[Change]], bool]) -> Iterator[tuple[bool, str]]:
    """Proposes, asks `agreed`, writes: (as it should be, words) of each step. Raises DriverError for the line's key."""
    with ParameterWriter(config, patience_s) as writer:
        try:
            wanted = writer.propose()
        except ValueError as error:
            yield False, f"nothing is written: {error}"
            return
        if not wanted:
            yield True, "nothing to change"
            return
        if not agreed(wanted):
            yield False, f"nothing is written: without a yes. Proposed: {'; '.join(c.words() for c in wanted)}"
            return
        for change, failure in writer.write(wanted):
            yield not failure, f"{change.name}: {failure}" if failure else f"written and read back: {change.words()}"
