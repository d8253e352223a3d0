"""Checks the link to the autopilot: heartbeat, rates, clock, signatures and parameters."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from drivers.base import DriverError
from drivers.mavlink.address import parse_address
from drivers.mavlink.clock_sync import ClockSource
from drivers.mavlink.link import MavlinkLink
from drivers.mavlink.session import MavlinkSession
from drivers.mavlink.session_types import ARDUPILOT, PX4, LinkStatus, Vehicle

from ..autopilot.clock_note import LARGE_BOUND_NS
from ..autopilot.conflict_codes import conflict_diagnostics
from ..autopilot.firmware_version import VersionReader
from ..autopilot.no_heartbeat import no_heartbeat_remedy
from ..autopilot.parameter_advice import advice
from ..autopilot.parameter_fault import AutopilotFacts
from ..autopilot.parameters import RC_OPTIONS, ParameterReader
from ..autopilot.restart_pending import TEXT as RESTART_TEXT
from ..autopilot.restart_pending import ProximityPresence
from ..autopilot.session_factory import params_of, signing_of
from ..config.loader import Config
from ..config.service import AutopilotConfig
from ..diagnostic import DiagnosticCode
from ..guard.heading_advice import heading_advice, look_all_around
from ..guard.stop_advice import stop_advice
from ..live.diagnostics import (
    MIN_ATTITUDE_HZ,
    MIN_RATE_SHARE,
    REPEATED_TEXT,
    attitude_rate_low,
    clock_uncertain_text,
)
from ..paths import FolderError, folders
from .finding import Finding
from .wait import wait_until

NS = 1_000_000_000
RATE_WINDOW_NS = 3 * NS
"""Rates are measured over two seconds."""


NOT_CHECKED = {
    PX4: 'MAV_x_FORWARD, since the number of this port is not known: the ground station receives the texts "OA: ..." only where it '
    "is 1 for this port and for that of the ground station",
    ARDUPILOT: "PRX2_... of another proximity sensor, and whether the ground station or a switch has turned proximity avoidance "
    "off (MAV_CMD_DO_AUX_FUNCTION with function 40), which ArduPilot does not report",
}
"""What braking and its texts depend on, and this command cannot tell."""


def autopilot_findings(config: Config, patience_s: float) -> Iterator[Finding]:
    """The link, the autopilot's heartbeat, attitude and clock, and its parameters."""
    a = config.autopilot
    if not a.address:
        text = "none is configured: set [autopilot] address"
        yield Finding("autopilot", False, text, DiagnosticCode.NO_AUTOPILOT_CONFIGURED)
        return
    try:
        signing = signing_of(a, folders().state)
    except FolderError as error:
        yield Finding("folders", False, str(error), DiagnosticCode.RECORDING_FAULT)
        return
    except DriverError as error:
        yield Finding("signing", False, str(error), DiagnosticCode.SIGNING_FAULT)
        return
    readers = _Readers(guard=config.guard.enabled)
    session = MavlinkSession(params_of(config), on_message=readers.take, signing=signing)
    link = MavlinkLink(parse_address(a.address), session, lambda samples: None)
    link.open()
    try:
        status = _observed_status(link, readers, patience_s)
    finally:
        link.close()
        signing.close()
    if status.signing_fault:
        yield Finding("signing", False, status.signing_fault, DiagnosticCode.SIGNING_FAULT)
    elif status.signed:
        yield Finding("signing", True, "both ends sign with the same key")
    if link.budget is not None:
        text, warning = link.budget.text(), link.budget.warning()
        code = DiagnosticCode.LINK_SLOW if warning else ""
        yield Finding("link", not warning, f"{text}: {warning}" if warning else text, code)
    yield from link_findings(config, link, status)
    for conflict in conflict_diagnostics(status.conflicts):
        yield Finding("autopilot", False, conflict.text, conflict.code)
    if status.vehicle is not None:
        yield from _parameter_findings(config, status.vehicle.autopilot, readers)


class _Readers:
    """Reads the parameters, the firmware's version and the presence of the proximity sensor."""

    def __init__(self, guard: bool) -> None:
        """guard: read the parameters that the guard depends on, too."""
        self.parameters = ParameterReader(guard=guard)
        self.version, self.proximity = VersionReader(), ProximityPresence()

    def take(self, message: Any, arrival_ns: int) -> None:
        """Handles a message of the autopilot."""
        self.parameters.take(message, arrival_ns)
        self.version.take(message)
        self.proximity.take(message)

    def due(self, vehicle: Vehicle, now_ns: int) -> list[Any]:
        """The requests to send now."""
        system = vehicle.system_id
        self.parameters.begin(vehicle.autopilot, system)
        self.version.begin(vehicle.autopilot, system)
        return [r for reader in (self.parameters, self.version, self.proximity) for r in reader.due(now_ns, system)]

    @property
    def settled(self) -> bool:
        """Whether everything is known, or was requested often enough."""
        return self.parameters.settled and self.version.settled and self.proximity.settled


def _parameter_findings(config: Config, autopilot: str, readers: _Readers) -> Iterator[Finding]:
    parameters, version = readers.parameters, readers.version.version
    values = parameters.values()
    facts = AutopilotFacts(kind=autopilot, values=values, silent=parameters.silent(), version=version)
    firmware = f"{autopilot} v{version}" if version else f"{autopilot}, version not reported"
    yield Finding("firmware", True, firmware)
    shown = {name: value for name, value in values.items() if value or name not in RC_OPTIONS}
    text = ", ".join(f"{name} = {value:g}" for name, value in shown.items()) or "no parameter was received"
    unused = not config.avoid.send  # without obstacle output nothing depends on them
    known = bool(values) or unused
    yield Finding("parameters", known, text, "" if known else DiagnosticCode.PARAMETERS_UNKNOWN)
    if readers.proximity.restart_pending(facts):
        yield _advice("parameters", unused, RESTART_TEXT)
    if autopilot in NOT_CHECKED and not unused:
        yield Finding("to check by hand", True, NOT_CHECKED[autopilot])
    for line in advice(facts, config.avoid):
        yield _advice("parameters", unused, line)
    if config.guard.enabled:
        around = look_all_around([c.mount.yaw_rad for c in config.cameras])
        for line in heading_advice(facts, config.guard):
            yield _advice("guard", around, line)
        for line in stop_advice(facts):
            yield _advice("guard", False, line)
    for line in parameters.contradictions(time.monotonic_ns()):
        yield Finding("parameters", False, line, DiagnosticCode.PARAMETER_CONTRADICTION)


def _advice(part: str, ok: bool, text: str) -> Finding:
    return Finding(part, ok, text, "" if ok else DiagnosticCode.PARAMETER_ADVICE)


def _observed_status(link: MavlinkLink, readers: _Readers, patience_s: float) -> LinkStatus:
    """The link's status as soon as clock, rates, parameters and version are known, at the latest after `patience_s`."""

    def complete() -> bool:
        status, now_ns = link.status(), time.monotonic_ns()
        if status.vehicle is None:
            return False
        for request in readers.due(status.vehicle, now_ns):
            link.post(request)
        synchronised = status.clock.source is ClockSource.TIMESYNC and status.attitude_hz > 0.0
        return synchronised and readers.settled and now_ns > settled_ns

    settled_ns = time.monotonic_ns() + RATE_WINDOW_NS
    wait_until(complete, patience_s)
    return link.status()


def link_findings(config: Config, link: MavlinkLink, status: LinkStatus) -> Iterator[Finding]:
    """The link, the heartbeat, the attitude's rate and the clock. link: may be closed by now, without an error."""
    if error := link.state.error:
        yield Finding("autopilot", False, f"the link is not open: {error}", DiagnosticCode.LINK_CLOSED)
        return
    if status.vehicle is None:
        remedy = no_heartbeat_remedy(config.autopilot.address, status)
        if any(c.kind == "simulated" and not c.follow for c in config.cameras):
            remedy = "start `companion simulate-autopilot -c FILE` with this configuration"
        text = f"no heartbeat on {config.autopilot.address}: {remedy}"
        yield Finding("autopilot", False, text, DiagnosticCode.NO_HEARTBEAT)
        return
    v = status.vehicle
    text = f"{v.autopilot}, system {v.system_id}, {'ARMED' if v.armed else 'disarmed'}"
    if not config.autopilot.system_id:
        text += (
            f"; by the first heartbeat: if this is your vehicle, set [autopilot] system_id = {v.system_id}, so that another one "
            "is never taken for it"
        )
    yield Finding("autopilot", True, text)
    yield _attitude_finding(status, config.autopilot)
    clock = status.clock
    if clock.bound_ns is not None and clock.bound_ns > LARGE_BOUND_NS:
        yield Finding("clock", False, clock_uncertain_text(clock.bound_ns), DiagnosticCode.CLOCK_UNCERTAIN)
    elif clock.source is ClockSource.TIMESYNC and clock.bound_ns is not None:
        yield Finding("clock", True, f"synchronised within {clock.bound_ns / 1e6:.2f} ms")
    else:
        text = "the autopilot does not answer TIMESYNC: the delay of the link becomes an error of the attitude's time"
        yield Finding("clock", False, text, DiagnosticCode.NO_TIMESYNC)


def _attitude_finding(status: LinkStatus, autopilot: AutopilotConfig) -> Finding:
    requested_hz = autopilot.attitude_hz
    if status.attitude_repeated:
        return Finding("attitude", False, REPEATED_TEXT, DiagnosticCode.ATTITUDE_REPEATED)
    if 0.0 < status.attitude_hz < MIN_ATTITUDE_HZ:
        low = attitude_rate_low(status.attitude_hz, requested_hz)
        return Finding("attitude", False, low.line(), low.code)
    text = f"{status.attitude_hz:.0f} Hz of {requested_hz:g} Hz requested, position {status.position_hz:.0f} Hz"
    if status.attitude_hz >= MIN_RATE_SHARE * requested_hz:
        return Finding("attitude", True, text)
    remedy = "raise the stream rate of the autopilot, or end other programs on this computer"
    if autopilot.address.startswith("serial:"):
        remedy = "raise the stream rate of this port, or use a faster link (921600 baud)"
    return Finding("attitude", False, f"{text}: {remedy}", DiagnosticCode.ATTITUDE_RATE_LOW)
