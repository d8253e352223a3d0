"""Detects other senders that use the autopilot's ids or ours, or that also send obstacles. Only signing prevents them;
without it they are reported."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Any

from .clock_sync import NS
from .dialect import MAV_COMP_ID_AUTOPILOT1

RECENT_NS = 10 * NS
"""A conflict is reported for this time after the last message that caused it."""
SEVERAL_NS = 60 * NS
"""For this time after the last heartbeat of a second vehicle it is open which of them carries this computer."""
OBSTACLES = frozenset({330, 11037})
"""OBSTACLE_DISTANCE, OBSTACLE_DISTANCE_3D."""
_SENT, _MOST = 256, 16


class ConflictDetector:
    """`sent` receives what is sent, `heard` what arrives, `texts` gives the conflicts."""

    def __init__(self, component_id: int) -> None:
        self._component = component_id
        self._sent: deque[bytes] = deque(maxlen=_SENT)
        self._rivals: OrderedDict[tuple[int, int], int] = OrderedDict()
        self._doubles_ns: int | None = None
        self._left_out: OrderedDict[int, int] = OrderedDict()
        self._vehicles: OrderedDict[int, int] = OrderedDict()
        self._replaced = False
        self._kind = ""
        self._contradiction_ns: int | None = None
        self._contradicting = ""

    def sent(self, frame: bytes) -> None:
        """A frame of ours; a router may bring it back."""
        self._sent.append(frame)

    def heard(self, message: Any, system: int, now_ns: int) -> None:
        """A message that came. system: the vehicle's; 0: not known yet."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source[1] == MAV_COMP_ID_AUTOPILOT1 or not system or source[0] != system:
            return
        ours = source[1] == self._component
        if not ours and message.get_msgId() not in OBSTACLES:
            return
        if ours and bytes(message.get_msgbuf()) in self._sent:
            return
        if ours:
            self._doubles_ns = now_ns
        else:
            _remember(self._rivals, source, now_ns)

    def left_out(self, system: int, now_ns: int) -> None:
        """An autopilot that is not listened to, since its system id is not the configured one."""
        _remember(self._left_out, system, now_ns)

    def vehicle(self, system: int, now_ns: int) -> None:
        """A heartbeat of an autopilot whose system id the configuration does not exclude."""
        _remember(self._vehicles, system, now_ns)

    def kind(self, kind: str, now_ns: int) -> str:
        """What to call an autopilot whose heartbeat says `kind`: both names while heartbeats contradict each other, so that
        it is sent what is safe for either."""
        if self._kind and kind != self._kind:
            self._contradiction_ns, self._contradicting = now_ns, " or ".join(sorted({kind, self._kind}))
        self._kind = kind
        return self._contradicting if _recent(self._contradiction_ns, now_ns) else kind

    def another(self) -> None:
        """Another vehicle is listened to from now on."""
        self._kind, self._contradiction_ns = "", None
        self._replaced = True

    def texts(self, now_ns: int, configured: int, *, heard: bool) -> dict[str, str]:
        """Topic -> what is wrong, in words. configured: the only system id listened to, 0: any; heard: an autopilot is."""
        said: dict[str, str] = {}
        if _recent(self._contradiction_ns, now_ns):
            said["two autopilots"] = (
                f"{self._contradicting}: heartbeats contradict each other: a second sender uses the autopilot's ids; "
                "only what is safe for both is sent; sign the link, or give each vehicle another system id"
            )
        for system, component in [s for s, at_ns in self._rivals.items() if _recent(at_ns, now_ns)]:
            said["two companions"] = (
                f"component {component} sends obstacles to the autopilot too: a clear sector of one erases an obstacle of the "
                f"other; switch off one of the two (system {system})"
            )
        if _recent(self._doubles_ns, now_ns):
            said["two of us"] = (
                f"another sender uses component {self._component}: a second companion with the same ids; switch it off, or set "
                "another [autopilot] component_id"
            )
        vehicles = sorted(s for s, at_ns in self._vehicles.items() if now_ns - at_ns < SEVERAL_NS)
        if not configured and (len(vehicles) > 1 or self._replaced):
            said["several vehicles"] = (
                f"autopilots of several system ids were received ({', '.join(map(str, vehicles)) or 'none now'}): it is not known "
                "which one carries this computer; set [autopilot] system_id to it and restart the service"
            )
        others = sorted(s for s, at_ns in self._left_out.items() if _recent(at_ns, now_ns))
        if configured and others and not heard:
            said["system id"] = (
                f"only system {others[0]} is received: [autopilot] system_id = {configured} leaves it out; set it to 0, or to the "
                "vehicle's"
            )
        return said


def _remember(seen: OrderedDict[Any, int], key: Any, now_ns: int) -> None:
    """The newest few alone: whoever makes up ids must not fill the memory."""
    seen.pop(key, None)
    seen[key] = now_ns
    if len(seen) > _MOST:
        seen.popitem(last=False)


def _recent(at_ns: int | None, now_ns: int) -> bool:
    return at_ns is not None and now_ns - at_ns < RECENT_NS
