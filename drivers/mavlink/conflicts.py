"""Detects other senders that use the ids of the autopilot or of this service, or that also send obstacles.

Only signing prevents them; without signing they are reported."""

from __future__ import annotations

import struct
from collections import OrderedDict, deque
from typing import Any

from .clock_bounds import NS
from .dialect import dialect
from .outbox import SCAN_IDS
from .parser import Frame
from .session_types import ARDUPILOT

RECENT_NS = 10 * NS
"""A conflict is reported for this time after the last message that caused it."""
SEVERAL_NS = 60 * NS
"""For this time after the last heartbeat of a second vehicle it is not known which vehicle carries this computer. The own one may have
fallen silent and still receive; and the cameras must not see and be blind in turns with each heartbeat of a vehicle far away."""
_TO_ORIENTATION = struct.Struct("<I3H3B")
"""The fields of DISTANCE_SENSOR up to its MAV_SENSOR_ORIENTATION."""
HORIZONTAL = dialect.MAV_SENSOR_ROTATION_YAW_315
VERTICAL = frozenset({dialect.MAV_SENSOR_ROTATION_PITCH_90, dialect.MAV_SENSOR_ROTATION_PITCH_270})
"""Greatest MAV_SENSOR_ORIENTATION of the eight around the vehicle, beginning at 0, and those up and down. ArduPilot uses a DISTANCE_SENSOR
around the vehicle as it uses OBSTACLE_DISTANCE, PX4 each one that looks neither up nor down."""
_SENT, _MOST = 256, 16


class ConflictDetector:
    """Detects conflicts. `sent` gets what is sent, `received` what arrives."""

    def __init__(self, component_id: int) -> None:
        self._component = component_id
        self._sent: deque[bytes] = deque(maxlen=_SENT)
        self._rivals: OrderedDict[tuple[int, int], int] = OrderedDict()
        self._own_system = 0
        self._doubles_ns: int | None = None
        self._left_out: OrderedDict[int, int] = OrderedDict()
        self._vehicles: OrderedDict[int, int] = OrderedDict()
        self._kinds: dict[int, str] = {}  # of the vehicles, by system id
        self._kind = ""
        self._contradiction_ns: int | None = None
        self._contradicting = ""

    def sent(self, frame: bytes) -> None:
        """Records a frame of this service; a router may send it back."""
        self._sent.append(frame)

    def received(self, frame: Frame, system: int, now_ns: int) -> None:
        """Takes a received message. system: that of the vehicle, 0: not known yet.

        Autopilots take obstacles from any system: also those of another vehicle on the line, and the map of its PX4."""
        source = (frame.system, frame.component)
        if not system or source == (system, dialect.MAV_COMP_ID_AUTOPILOT1):
            return
        ours = source == (system, self._component)
        if not ours and not self._is_obstacle(frame):
            return
        # packets to other vehicles may be sent on another line; a second service also sends heartbeats
        if ours and (frame.id == dialect.MAVLINK_MSG_ID_TUNNEL or frame.data in self._sent):
            return
        if ours:
            self._doubles_ns = now_ns
        else:
            self._own_system = system
            _remember(self._rivals, source, now_ns)

    def _is_obstacle(self, frame: Frame) -> bool:
        """Returns whether the autopilot takes obstacles around the vehicle from a message."""
        if frame.id != dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR:
            return frame.id in SCAN_IDS
        orientation = frame.fields(_TO_ORIENTATION)[-1]
        return orientation <= HORIZONTAL or (self._kind != ARDUPILOT and orientation not in VERTICAL)

    def left_out(self, system: int, now_ns: int) -> None:
        """Records an autopilot that is ignored because its system id is not the configured one."""
        _remember(self._left_out, system, now_ns)

    def vehicle(self, system: int, kind: str, now_ns: int) -> None:
        """Records a heartbeat of an autopilot whose system id the configuration does not exclude."""
        _remember(self._vehicles, system, now_ns)
        self._kinds[system] = kind

    def still_counts(self, system: int, kind: str, now_ns: int) -> None:
        """Records an autopilot that counts, received or not. kind: without a heartbeat of it."""
        self._kinds.setdefault(system, kind)
        _remember(self._vehicles, system, now_ns)

    def several_vehicles(self, now_ns: int) -> bool:
        """Returns whether several autopilots were received whose system ids the configuration does not exclude: it is not known which
        one carries this computer."""
        return len(self._vehicles) > 1 and len(self._recent_vehicles(now_ns)) > 1

    def vehicles(self, now_ns: int) -> dict[int, str]:
        """Returns system id -> kind of the autopilots that were received recently, without those that the configuration excludes."""
        return {system: self._kinds[system] for system in self._recent_vehicles(now_ns)}

    def _recent_vehicles(self, now_ns: int) -> list[int]:
        return sorted(s for s, at_ns in self._vehicles.items() if now_ns - at_ns < SEVERAL_NS)

    def kind(self, kind: str, now_ns: int) -> str:
        """Returns the kind to use for an autopilot whose heartbeat reports `kind`.

        It contains both names while heartbeats contradict each other, and those of all vehicles that may be the own one, so that only
        what is safe for each kind is sent."""
        if self._kind and kind != self._kind:
            self._contradiction_ns, self._contradicting = now_ns, _either([kind, self._kind])
        self._kind = kind
        return self.kind_of_all(self._contradicting if _recent(self._contradiction_ns, now_ns) else kind, now_ns)

    def kind_of_all(self, kind: str, now_ns: int) -> str:
        """Returns a kind with those of all vehicles that may be the own one."""
        return _either([kind, *(self._kinds[system] for system in self._recent_vehicles(now_ns))])

    def texts(
        self, now_ns: int, configured: int, *, connected: bool, two_clocks: bool = False, two_vehicles: bool = False
    ) -> dict[str, str]:
        """Returns topic -> conflict, as text.

        configured: the only accepted system id, 0: any; connected: an autopilot is received; two_clocks: its timestamps
        contradict each other; two_vehicles: a second vehicle sends with its ids, so that no attitude is used."""
        texts_by_topic: dict[str, str] = {}
        if two_vehicles:
            texts_by_topic["two autopilots"] = (
                "two vehicles use the same ids: it is not known whose an attitude is, and none is used; give each vehicle another "
                "system id"
            )
        if _recent(self._contradiction_ns, now_ns):
            texts_by_topic["two autopilots"] = (
                f"contradictory heartbeats: {self._contradicting}; a second sender uses the autopilot's ids; only what is "
                "safe for both is sent; sign the link, or give each vehicle another system id"
            )
        if two_clocks and not two_vehicles:
            texts_by_topic["two clocks"] = (
                "contradictory autopilot timestamps: those that do not fit are not used, and none while TIMESYNC is not answered; a "
                "second vehicle has the same ids, or copies arrive late by another route; give each vehicle another system id, and "
                "forward the autopilot's messages by one route"
            )
        for system, component in [s for s, at_ns in self._rivals.items() if _recent(at_ns, now_ns)]:
            own = system == self._own_system
            sender = f"component {component}" if own else f"system {system}"
            remedy = (
                "switch off one of the two"
                if own
                else "switch it off, or do not forward its messages to this autopilot"
            )
            texts_by_topic["two companions"] = (
                f"{sender} sends obstacles too: a clear sector of one erases an obstacle of the other; {remedy} "
                f"(system {system}, component {component})"
            )
        if _recent(self._doubles_ns, now_ns):
            texts_by_topic["two services"] = (
                f"another sender uses component {self._component}: a second companion has the same ids; switch it off, or set "
                "another [autopilot] component_id"
            )
        vehicles = self._recent_vehicles(now_ns)
        if not configured and len(vehicles) > 1:
            texts_by_topic["several vehicles"] = (
                f"several vehicles, set system_id: systems {', '.join(map(str, vehicles))}; it is not known which one carries this "
                "computer, no attitude is used; set [autopilot] system_id to it and restart the service"
            )
        others = sorted(s for s, at_ns in self._left_out.items() if _recent(at_ns, now_ns))
        if configured and others and not connected:
            texts_by_topic["system id"] = (
                f"only system {others[0]} is received: [autopilot] system_id = {configured} leaves it out; set it to 0, or to the "
                "vehicle's"
            )
        return texts_by_topic


def _either(kinds: list[str]) -> str:
    """Returns the names in several kinds, as one kind."""
    return " or ".join(sorted({name for kind in kinds for name in kind.split(" or ")}))


def _remember(seen: OrderedDict[Any, int], key: Any, now_ns: int) -> None:
    """Keeps the newest entries only, because a sender with many ids must not fill the memory."""
    seen.pop(key, None)
    seen[key] = now_ns
    if len(seen) > _MOST:
        seen.popitem(last=False)


def _recent(at_ns: int | None, now_ns: int) -> bool:
    return at_ns is not None and now_ns - at_ns < RECENT_NS
