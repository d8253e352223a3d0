"""The autopilot's parameters that decide whether it brakes: asked for, and what they mean in words. Nothing is
written here."""

from __future__ import annotations

import math
import struct
import threading
from dataclasses import dataclass, replace
from typing import Any

from drivers.mavlink.dialect import MAV_COMP_ID_AUTOPILOT1, dialect

from ..pipeline.latency import LatencyStage

NS = 1_000_000_000
PX4, ARDUPILOT = "PX4", "ArduPilot"
WANTED = {
    PX4: ("CP_DIST", "CP_DELAY", "CP_GO_NO_DATA", "MPC_POS_MODE"),
    ARDUPILOT: ("PRX1_TYPE", "AVOID_ENABLE", "AVOID_MARGIN", "AVOID_BEHAVE", "AVOID_BACKUP_SPD", "OA_TYPE"),
}
ASK_AGAIN_NS = NS
TRIES = 5
"""So often a parameter is asked for; one that is never told does not exist in that firmware, or the line is bad."""
RENEW_NS = 10 * NS
"""People change parameters in flight: they are read again so often."""
SURE_NS, ASK_TO_BE_SURE_NS = NS, 4 * NS // 10
"""A value counts once it was told for so long and no other: forged answers and those of the autopilot contradict each
other. Till then what counted before counts, and it is asked for more often."""
CONTRADICTION_NS, CONTRADICTIONS = 30 * NS, 3
"""So many changes in so long are nobody's wish."""
WHOLE = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}
"""MAV_PARAM_TYPE of whole numbers, as PX4 puts their bytes into the float."""


@dataclass(frozen=True, slots=True)
class Known:
    """One parameter. value: what counts, None: nothing yet; tries: requests since it was told last; candidate: what was
    told last, since_ns: for how long and no other; before: what was told before that; changes: when, the newest few."""

    value: float | None = None
    tries: int = 0
    asked_ns: int = 0
    candidate: float | None = None
    since_ns: int = 0
    before: float | None = None
    changes: tuple[int, ...] = ()


class ParameterReader:
    """`due` for the requests to send, `take` with every message of the autopilot. Safe to use from two threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kind, self._system_id = "", 0
        self._known: dict[str, Known] = {}

    def begin(self, kind: str, system_id: int = 1) -> None:
        """An autopilot of this kind is there; another one than before begins anew."""
        with self._lock:
            if (kind, system_id) != (self._kind, self._system_id):
                self._kind, self._system_id = kind, system_id
                self._known = {name: Known() for name in WANTED.get(kind, ())}

    def take(self, message: Any, now_ns: int) -> None:
        """PARAM_VALUE of a parameter that was asked for; all else is passed over."""
        if message.get_type() != "PARAM_VALUE":
            return
        with self._lock:
            name = str(message.param_id)
            known = self._known.get(name)
            value = value_of(message, self._kind)
            if known is not None and math.isfinite(value):
                self._known[name] = _told(known, value, now_ns)

    def due(self, now_ns: int, system_id: int) -> list[Any]:
        """Requests to send now."""
        requests = []
        with self._lock:
            for name, known in self._known.items():
                wait_ns = RENEW_NS if known.value is not None and known.tries == 0 else ASK_AGAIN_NS
                if known.value != known.candidate:
                    wait_ns = ASK_TO_BE_SURE_NS
                if known.tries >= TRIES:
                    wait_ns = RENEW_NS
                if known.asked_ns and now_ns - known.asked_ns < wait_ns:
                    continue
                self._known[name] = replace(known, tries=known.tries + 1, asked_ns=now_ns)
                requests.append(
                    dialect.MAVLink_param_request_read_message(system_id, MAV_COMP_ID_AUTOPILOT1, name.encode(), -1)
                )
        return requests

    def value(self, name: str) -> float | None:
        """What counts; None: nothing was told, or nothing without contradiction."""
        with self._lock:
            known = self._known.get(name)
            return None if known is None else known.value

    def silent(self) -> tuple[str, ...]:
        """Parameters that were asked for TRIES times and never told."""
        with self._lock:
            return tuple(name for name, k in self._known.items() if k.value is None and k.tries >= TRIES)

    @property
    def kind(self) -> str:
        """Of the autopilot whose parameters these are."""
        return self._kind

    def contradictions(self, now_ns: int) -> list[str]:
        """Which parameters are told now so, now otherwise, in words."""
        with self._lock:
            return [
                f"{name} is told as {k.before:g} and as {k.candidate:g}: somebody else speaks as the autopilot; "
                + (f"{k.value:g} counts" if k.value is not None else "neither counts")
                for name, k in self._known.items()
                if _contradictory(k, now_ns)
            ]

    @property
    def settled(self) -> bool:
        """Whether each parameter was told, or asked for in vain, or contradicted."""
        with self._lock:
            return all(
                k.value is not None or k.tries >= TRIES or len(k.changes) >= CONTRADICTIONS
                for k in self._known.values()
            )

    def values(self) -> dict[str, float]:
        """Those that count."""
        with self._lock:
            return {name: k.value for name, k in self._known.items() if k.value is not None}


def _told(known: Known, value: float, now_ns: int) -> Known:
    """What is known after an answer."""
    if value != known.candidate:
        changes = (*known.changes, now_ns)[-CONTRADICTIONS:]
        return replace(known, tries=0, candidate=value, before=known.candidate, since_ns=now_ns, changes=changes)
    sure = now_ns - known.since_ns >= SURE_NS
    return replace(known, tries=0, value=value if sure else known.value)


def _contradictory(known: Known, now_ns: int) -> bool:
    changes = known.changes
    return len(changes) >= CONTRADICTIONS and now_ns - changes[0] < CONTRADICTION_NS


def value_of(message: Any, kind: str) -> float:
    """The value of a PARAM_VALUE. PX4 puts the bytes of whole numbers into the float, ArduPilot their value."""
    if kind == PX4 and message.param_type in WHOLE:
        form = WHOLE[message.param_type]
        return float(struct.unpack_from(form, struct.pack("<f", message.param_value))[0])
    return float(message.param_value)


def advice(kind: str, values: dict[str, float], silent: tuple[str, ...], max_distance_m: float) -> list[str]:
    """What these parameters mean for somebody who expects the vehicle to brake, and what to change: the worst first."""
    said = [
        f"the autopilot did not tell {name}: this firmware may not have it, or the line loses messages"
        for name in silent
    ]
    if kind == PX4:
        return [*_px4_advice(values, max_distance_m), *said]
    if kind == ARDUPILOT:
        return [*_ardupilot_advice(values, max_distance_m), *said]
    return said


def _px4_advice(v: dict[str, float], max_distance_m: float) -> list[str]:
    said = []
    if v.get("CP_DIST", 1.0) <= 0.0:
        said.append(
            f"PX4 will not brake: CP_DIST = {v['CP_DIST']:g} switches collision prevention off; set it to the distance to keep, such as 3 m"
        )
    elif v.get("CP_DIST", 0.0) >= max_distance_m:
        said.append(
            f"PX4 would never fly on: CP_DIST = {v['CP_DIST']:g} m is not less than [avoid] max_distance_m = {max_distance_m:g} m"
        )
    if v.get("CP_GO_NO_DATA", 0.0) > 0.0:
        said.append(
            "PX4 flies where no camera looks: CP_GO_NO_DATA = 1; with 0 it moves only where it was told something"
        )
    if v.get("MPC_POS_MODE", 4.0) not in (0.0, 3.0, 4.0):
        said.append(
            f"MPC_POS_MODE = {v['MPC_POS_MODE']:g}: collision prevention works in Position mode with 0 or 4 (newer PX4: 4)"
        )
    return said


def _ardupilot_advice(v: dict[str, float], max_distance_m: float) -> list[str]:
    said = []
    if v.get("PRX1_TYPE", 2.0) != 2.0:
        said.append(
            f"ArduPilot does not listen: PRX1_TYPE = {v['PRX1_TYPE']:g}; set it to 2 (MAVLink) and start the autopilot again"
        )
    if not int(v.get("AVOID_ENABLE", 7.0)) & 2:
        said.append(
            f"ArduPilot will not brake: AVOID_ENABLE = {v['AVOID_ENABLE']:g} is without 2 (proximity sensors); 7 is all"
        )
    if v.get("AVOID_MARGIN", 2.0) / 0.92 >= max_distance_m:
        said.append(
            f"AVOID_MARGIN = {v['AVOID_MARGIN']:g} m leaves no room below [avoid] max_distance_m = {max_distance_m:g} m"
        )
    if v.get("AVOID_BEHAVE", 1.0) == 0.0:
        said.append("AVOID_BEHAVE = 0: in LOITER it slides along obstacles instead of stopping; 1 stops")
    if v.get("AVOID_BACKUP_SPD", 0.0) > 0.0:
        said.append(
            f"AVOID_BACKUP_SPD = {v['AVOID_BACKUP_SPD']:g} m/s: nearer than AVOID_MARGIN it backs away, where nobody may be looking; 0 lets it stand"
        )
    if v.get("OA_TYPE", 0.0) > 0.0:
        said.append(
            f"OA_TYPE = {v['OA_TYPE']:g}: in AUTO, GUIDED and RTL a path planner goes round what it is told of, when blind round the wall to where nobody looks; 0 switches it off"
        )
    return said


def delay_advice(
    kind: str, values: dict[str, float], latency: tuple[LatencyStage, float, float, float] | None
) -> list[str]:
    """What to say of CP_DELAY by what was measured. latency: (stage, p50, p95, p99) in ms from exposure to telling; it and
    the line's own time, some milliseconds, are what PX4 cannot know."""
    if kind != PX4 or latency is None or "CP_DELAY" not in values:
        return []
    p99_s = latency[3] / 1000.0
    if values["CP_DELAY"] >= p99_s:
        return []
    return [
        f"PX4 brakes too late: CP_DELAY = {values['CP_DELAY']:g} s, but of what it is told one in a hundred is older than "
        f"{p99_s:.2f} s; set it to {math.ceil(20.0 * (p99_s + 0.02)) / 20.0:g}"
    ]
