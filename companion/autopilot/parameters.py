"""Reads the autopilot's parameters that decide if it brakes. `parameter_advice` interprets them; nothing is written
here."""

from __future__ import annotations

import math
import struct
import threading
from dataclasses import dataclass, replace
from typing import Any

from drivers.mavlink.dialect import dialect
from drivers.mavlink.session_types import ARDUPILOT, PX4

NS = 1_000_000_000
RC_OPTIONS = tuple(f"RC{n}_OPTION" for n in range(1, 17))
WANTED = {
    PX4: ("CP_DIST", "CP_DELAY", "CP_GO_NO_DATA", "MPC_POS_MODE", "COM_OBS_AVOID"),
    ARDUPILOT: (
        "AVOID_MARGIN", "PRX1_TYPE", "AVOID_ENABLE", "AVOID_BEHAVE", "AVOID_BACKUP_SPD", "OA_TYPE", "PRX1_MIN", "PRX1_MAX",
        "PRX2_TYPE", "PRX1_ORIENT", "PRX1_YAW_CORR", "PRX_IGN_GND", "PRX_FILT", "AVOID_ALT_MIN", "AVOID_ACCEL_MAX",
        "AVOID_BACKUP_DZ", "AVOID_BACKZ_SPD", *RC_OPTIONS,
    ),
}  # fmt: skip
GUARD = {PX4: ("MPC_YAW_MODE", "RTL_HDG_MD"), ARDUPILOT: ("WP_YAW_BEHAVIOR", "FLTMODE_GCSBLOCK")}
"""Parameters read on request: the direction of the nose in the modes that the guard watches, and modes that ArduCopter
refuses to commands."""
OPTIONAL = frozenset(
    {
        "COM_OBS_AVOID",
        "RTL_HDG_MD",
        "FLTMODE_GCSBLOCK",
        *RC_OPTIONS,
        "PRX2_TYPE",
        "PRX1_MIN",
        "PRX1_MAX",
        "PRX1_ORIENT",
        "PRX1_YAW_CORR",
        "PRX_IGN_GND",
        "PRX_FILT",
        "AVOID_ALT_MIN",
        "AVOID_ACCEL_MAX",
        "AVOID_BACKUP_DZ",
        "AVOID_BACKZ_SPD",
    }
)
"""Parameters that not every firmware has: no answer for them is not reported."""
AT_ONCE = 6
"""Greatest number of requests at a time, so that a slow link is not filled."""
ASK_AGAIN_NS = NS
TRIES = 5
"""Requests for a parameter. If none is answered, the firmware does not have it, or the link loses messages."""
RENEW_NS = 10 * NS
"""Interval at which parameters are read again: they can be changed in flight."""
SURE_NS, ASK_TO_BE_SURE_NS = NS, 4 * NS // 10
"""A value counts once it, and no other value, was received for SURE_NS: forged answers contradict those of the
autopilot. Until then the value before counts, and the parameter is requested more often."""
CONTRADICTION_NS, CONTRADICTIONS = 30 * NS, 3
"""This many changes within CONTRADICTION_NS are reported as a contradiction."""
INTEGER_FORMATS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of integers, whose bytes PX4 puts into the float, and their formats of `struct`."""


@dataclass(frozen=True, slots=True)
class Known:
    """State of one parameter."""

    value: float | None = None  # the value that counts; None: none yet
    tries: int = 0  # requests since the last answer
    asked_ns: int = 0  # instant of the last request
    candidate: float | None = None  # the newest answer
    since_ns: int = 0  # when the newest answer was first received
    before: float | None = None  # the answer before it
    changes: tuple[int, ...] = ()  # instants of the newest changes


class ParameterReader:
    """Requests and reads parameters. `due` returns requests, `take` gets every message of the autopilot. Thread-safe."""

    def __init__(self, guard: bool = False) -> None:
        """Starts without an autopilot. guard: GUARD is read as well."""
        self._lock = threading.Lock()
        self._guard = guard
        self._kind, self._system_id = "", 0
        self._known: dict[str, Known] = {}

    def begin(self, kind: str, system_id: int = 1) -> None:
        """Sets the received autopilot; a change of it restarts the reading."""
        with self._lock:
            if (kind, system_id) != (self._kind, self._system_id):
                self._kind, self._system_id = kind, system_id
                names = WANTED.get(kind, ()) + (GUARD.get(kind, ()) if self._guard else ())
                self._known = {name: Known() for name in names}

    def take(self, message: Any, now_ns: int) -> None:
        """Handles PARAM_VALUE of requested parameters and ignores other messages."""
        if message.get_type() != "PARAM_VALUE":
            return
        with self._lock:
            name = str(message.param_id)
            known = self._known.get(name)
            value = value_of(message, self._kind)
            if known is not None and math.isfinite(value):
                self._known[name] = _answered(known, value, now_ns)

    def due(self, now_ns: int, system_id: int) -> list[Any]:
        """Returns the requests to send now."""
        requests: list[Any] = []
        with self._lock:
            # longest unasked first: more parameters than AT_ONCE permits in ASK_AGAIN_NS would leave the last ones out
            for name, known in sorted(self._known.items(), key=lambda item: item[1].asked_ns):
                wait_ns = RENEW_NS if known.value is not None and known.tries == 0 else ASK_AGAIN_NS
                if known.value != known.candidate:
                    wait_ns = ASK_TO_BE_SURE_NS
                if known.tries >= TRIES:
                    wait_ns = RENEW_NS
                if (known.asked_ns and now_ns - known.asked_ns < wait_ns) or len(requests) >= AT_ONCE:
                    continue
                self._known[name] = replace(known, tries=known.tries + 1, asked_ns=now_ns)
                requests.append(request_of(system_id, name))
        return requests

    def value(self, name: str) -> float | None:
        """Returns the value that counts; None: no answer, or only contradictory ones."""
        with self._lock:
            known = self._known.get(name)
            return None if known is None else known.value

    def silent(self) -> tuple[str, ...]:
        """Returns parameters that were requested TRIES times and never answered, except OPTIONAL ones."""
        with self._lock:
            names = (name for name, k in self._known.items() if k.value is None and k.tries >= TRIES)
            return tuple(name for name in names if name not in OPTIONAL)

    @property
    def kind(self) -> str:
        """Kind of the autopilot whose parameters these are."""
        return self._kind

    def contradictions(self, now_ns: int) -> list[str]:
        """Returns the parameters with contradictory values, as text."""
        with self._lock:
            return [
                f"{name} is received as {k.before:g} and as {k.candidate:g}: another sender uses the autopilot's ids; "
                + (f"{k.value:g} is used" if k.value is not None else "neither is used")
                for name, k in self._known.items()
                if _contradictory(k, now_ns)
            ]

    @property
    def settled(self) -> bool:
        """True if each parameter was answered, contradicted, or requested TRIES times without an answer."""
        with self._lock:
            return all(
                k.value is not None or k.tries >= TRIES or len(k.changes) >= CONTRADICTIONS
                for k in self._known.values()
            )

    def values(self) -> dict[str, float]:
        """Returns name -> value of the parameters that have one."""
        with self._lock:
            return {name: k.value for name, k in self._known.items() if k.value is not None}


def _answered(known: Known, value: float, now_ns: int) -> Known:
    """Returns the state of a parameter after an answer."""
    if value != known.candidate:
        changes = (*known.changes, now_ns)[-CONTRADICTIONS:]
        return replace(known, tries=0, candidate=value, before=known.candidate, since_ns=now_ns, changes=changes)
    sure = now_ns - known.since_ns >= SURE_NS
    return replace(known, tries=0, value=value if sure else known.value)


def _contradictory(known: Known, now_ns: int) -> bool:
    """True if several changes of a value were received within CONTRADICTION_NS."""
    changes = known.changes
    return len(changes) >= CONTRADICTIONS and now_ns - changes[0] < CONTRADICTION_NS


def request_of(system_id: int, name: str) -> Any:
    """Returns the request for a parameter."""
    return dialect.MAVLink_param_request_read_message(system_id, dialect.MAV_COMP_ID_AUTOPILOT1, name.encode(), -1)


def value_of(message: Any, kind: str) -> float:
    """Returns the value of a PARAM_VALUE. PX4 puts the bytes of integers into the float, ArduPilot their value."""
    if kind == PX4 and message.param_type in INTEGER_FORMATS:
        form = INTEGER_FORMATS[message.param_type]
        return float(struct.unpack_from(form, struct.pack("<f", message.param_value))[0])
    return float(message.param_value)


def param_value_of(value: float, kind: str, param_type: int) -> float:
    """Returns the param_value of a PARAM_SET, the inverse of `value_of`. param_type: MAV_PARAM_TYPE."""
    if kind == PX4 and param_type in INTEGER_FORMATS:
        packed = struct.pack(INTEGER_FORMATS[param_type], int(value)).ljust(4, b"\0")
        return float(struct.unpack("<f", packed)[0])
    return value
