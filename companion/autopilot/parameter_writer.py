"""The only place that writes parameters of an autopilot, for `companion doctor --apply`.

The changes are proposed, written while the vehicle is disarmed, and read back."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from drivers.mavlink.address import parse_address
from drivers.mavlink.dialect import dialect
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.own_vehicle import SILENT_NS
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import PX4

from ..config.loader import Config
from ..paths import folders
from .firmware_version import VersionReader
from .parameter_advice import parameter_faults
from .parameter_fault import AutopilotFacts
from .parameters import ParameterReader, param_value_of, request_of, value_of
from .session_factory import params_of, signing_of

NS = 1_000_000_000
FRESH_NS = 2 * NS
"""Greatest age of a heartbeat that proves that the vehicle is disarmed."""
STILL_S = 2.5
"""No heartbeat may report an armed vehicle for this time before changes are proposed."""
TRIES, ANSWER_S = 3, 1.0
LEAST_DELAY_S = 0.15
"""Least latency of any chain of camera, computer and link."""
REBOOT = frozenset({"PRX1_TYPE"})
"""Parameters that take effect after a restart of the autopilot."""


@dataclass(frozen=True, slots=True)
class Change:
    """A parameter with its present value, its new value and the reason, as text."""

    name: str
    now: float
    to: float
    why: str

    def text(self) -> str:
        """Returns a line for the list that must be confirmed."""
        again = "; restart the autopilot afterwards" if self.name in REBOOT else ""
        return f"{self.name}: {self.now:g} -> {self.to:g} ({self.why}{again})"


def changes(facts: AutopilotFacts, config: Config) -> list[Change]:
    """Returns the parameters to write so that the autopilot brakes.

    Parameters that were not read, that are correct, or that are a matter of preference are not changed."""
    found = parameter_faults(facts, config.avoid)
    wanted = [Change(f.name, facts.values[f.name], f.to, f.effect) for f in found if f.to is not None]
    delay_s = facts.values.get("CP_DELAY", math.inf) if facts.kind == PX4 else math.inf
    if delay_s < LEAST_DELAY_S:
        largest_s = config.service.timeout_s + 1.0 / config.avoid.rate_hz
        wanted.append(
            Change("CP_DELAY", delay_s, round(largest_s + 0.03, 2), "the largest latency of the service, in s")
        )
    return wanted


class ParameterWriter:
    """Writes parameters on a link of its own: `propose`, then `write` the confirmed changes. Usable as a context
    manager."""

    def __init__(self, config: Config, patience_s: float) -> None:
        self._config, self._patience_s = config, patience_s
        self._reader, self._version = ParameterReader(), VersionReader()
        self._lock = threading.Lock()
        self._received: dict[str, tuple[float, int]] = {}
        self._armed_ns: int | None = None
        self._received_ns = self._silences = 0
        self._target: tuple[str, int, int] = ("", 0, 0)
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
        """Returns the changes as soon as the parameters are known. Raises ValueError if nothing may be written."""
        begun_s = time.monotonic()
        while time.monotonic() - begun_s < self._patience_s:
            vehicle = self._link.status().vehicle
            if vehicle is not None:
                self._reader.begin(vehicle.autopilot, vehicle.system_id)
                self._version.begin(vehicle.autopilot, vehicle.system_id)
                now_ns, system = time.monotonic_ns(), vehicle.system_id
                for request in (*self._reader.due(now_ns, system), *self._version.due(now_ns, system)):
                    self._link.post(request)
                if self._reader.settled and self._version.settled and time.monotonic() - begun_s > STILL_S:
                    break
            time.sleep(0.05)
        self._target = self._writable()
        return changes(
            AutopilotFacts(kind=self._target[0], values=self._reader.values(), version=self._version.version),
            self._config,
        )

    def write(self, wanted: list[Change]) -> Iterator[tuple[Change, str]]:
        """Yields each change with its failure, as text; empty: it was written and read back."""
        for change in wanted:
            try:
                yield change, self._written(change)
            except ValueError as error:
                yield change, f"not written: {error}"

    def _written(self, change: Change) -> str:
        value = 0.0
        for _ in range(TRIES):
            if self._writable() != self._target:
                raise ValueError("the autopilot was silent, replaced or restarted since the list was made; start again")
            kind, system, _ = self._target
            with self._lock:
                param_type = self._received[change.name][1]
            target, to = (system, dialect.MAV_COMP_ID_AUTOPILOT1), param_value_of(change.to, kind, param_type)
            self._link.post(dialect.MAVLink_param_set_message(*target, change.name.encode(), to, param_type))
            time.sleep(0.2)
            with self._lock:
                del self._received[change.name]  # the answer to the next request decides
            self._link.post(request_of(system, change.name))
            answer = self._answer(change.name)
            with self._lock:
                self._received.setdefault(change.name, (change.now, param_type))
            if answer is not None and abs(answer - change.to) < 1e-4:
                return ""
            value = change.now if answer is None else answer
        return f"it still reports {value:g}: written {TRIES} times and not accepted; set it from the ground station"

    def _answer(self, name: str) -> float | None:
        end_s = time.monotonic() + ANSWER_S
        while time.monotonic() < end_s:
            with self._lock:
                if name in self._received:
                    return self._received[name][0]
            time.sleep(0.02)
        return None

    def _take(self, message: Any, arrival_ns: int) -> None:
        self._silences += arrival_ns - self._received_ns > SILENT_NS
        self._received_ns = arrival_ns
        self._reader.take(message, arrival_ns)
        self._version.take(message)
        if message.get_type() == "HEARTBEAT" and int(message.base_mode) & dialect.MAV_MODE_FLAG_SAFETY_ARMED:
            self._armed_ns = arrival_ns
        if message.get_type() == "PARAM_VALUE":
            with self._lock:
                value = value_of(message, self._reader.kind)
                self._received[str(message.param_id)] = (value, int(message.param_type))

    def _writable(self) -> tuple[str, int, int]:
        """The autopilot's kind and system id, and a number that changes where another one may have taken its place. Raises
        ValueError where nothing may be written to it."""
        status, now_ns = self._link.status(), time.monotonic_ns()
        vehicle = status.vehicle
        if vehicle is None or now_ns - vehicle.heartbeat_ns > FRESH_NS:
            raise ValueError("no accepted heartbeat of an autopilot; check that it is on and sends to this address")
        if vehicle.armed or (self._armed_ns is not None and now_ns - self._armed_ns < 10 * NS):
            raise ValueError("it is ARMED, or was a moment ago: parameters are written while it is disarmed only")
        fault = status.signing_fault or next(iter(status.conflicts.values()), "")
        if fault:
            raise ValueError(f"target system is ambiguous: {fault}")
        return vehicle.autopilot, vehicle.system_id, status.clock_restarts + self._silences
