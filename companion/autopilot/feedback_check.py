"""Checks that the autopilot uses the obstacles it is sent: PX4 sends its map back, ArduPilot one DISTANCE_SENSOR per
face."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.ardupilot_faces import FACES, face_of
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from .ardupilot_advice import MAVLINK_SENSOR
from .obstacle_distance import BODY_FRD, UNKNOWN
from .parameter_fault import AutopilotFacts
from .polar_histogram import SECTORS
from .px4_advice import position_mode_fault

NS = 1_000_000_000
PATIENCE_NS = 5 * NS
"""Time for which obstacles were sent without an answer, before it is reported."""
FORGETS_NS, LONGEST_STEP_NS = 10 * NS, NS // 5
"""The time restarts if no obstacle was sent for FORGETS_NS; a pause between two messages counts as LONGEST_STEP_NS at
most."""
PRESENT_NS = 2 * NS
"""Time for which what was sent, and what was echoed, counts. ArduPilot sends nothing for a face without an obstacle."""
SLACK_CM = 60
"""Tolerance between sent and echoed distances: an echo may belong to one or two messages before, at some metres per
second."""
SECTOR_DEG = 360.0 / SECTORS
FIRST_FACE_ID = 10
"""Least id of the DISTANCE_SENSOR of a face (PROXIMITY_SENSOR_ID_START of ArduPilot); its range finders have lower ones."""
CAUSES = {
    PX4: "is CP_DIST above 0, and is MAV_n_MODE of its link Onboard?",
    ARDUPILOT: "is PRX1_TYPE = 2, and was the autopilot restarted since?",
}
"""What to check if no known fault explains it."""


class EchoCheck:
    """Compares sent obstacles (`sent`) with messages of the autopilot (`take`); `fault` returns the result.
    Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._sent: list[tuple[int, NDArray[np.uint16]]] = []  # (instant, obstacles, (72,) cm), of PRESENT_NS
        self._waited_ns = self._sent_ns = self._obstacle_ns = 0
        self._differs: dict[int | None, tuple[int, int]] = {}  # by face: instants of the first and newest other echo

    def sent(self, values: NDArray[np.uint16], clear_cm: int, now_ns: int) -> None:
        """Records values that were sent. Only a message with an obstacle is answered by both autopilots."""
        with self._lock:
            self._sent = [(t, cm) for t, cm in self._sent if now_ns - t < PRESENT_NS]
            self._sent.append((now_ns, np.where(values < clear_cm, values, np.uint16(UNKNOWN))))
            if now_ns - self._obstacle_ns > FORGETS_NS:
                self._waited_ns = 0
            if (values < clear_cm).any():  # obstacles may appear and disappear, as at the edge of the view
                self._waited_ns += min(now_ns - self._sent_ns, LONGEST_STEP_NS)
                self._obstacle_ns = now_ns
            self._sent_ns = now_ns

    def pause(self) -> None:
        """Restarts the check: the autopilot does not send obstacles back in its present mode."""
        with self._lock:
            self._sent.clear()
            self._differs.clear()
            self._waited_ns = 0

    def take(self, message: Any, now_ns: int) -> None:
        """Takes a message of the autopilot."""
        face, obstacles = echoed_face(message), echoed_cm(message)
        if not obstacles:
            return
        with self._lock:
            self._waited_ns = 0
            sent = np.array([values for _, values in self._sent], np.int64).reshape(-1, SECTORS)
            if not self._sent or all(_was_sent(sent[:, elements], cm, face) for elements, cm in obstacles):
                self._differs.pop(face, None)
                return
            since_ns, newest_ns = self._differs.get(face, (now_ns, now_ns))
            self._differs[face] = (since_ns if now_ns - newest_ns < PRESENT_NS else now_ns, now_ns)

    def fault(self, kind: str, now_ns: int, cause: str = "") -> str:
        """Returns why the obstacles seem not to be used, as text; empty: they are used, or there is nothing to
        compare.

        cause: the likely cause, as text; empty: none is known."""
        with self._lock:
            if self._waited_ns > PATIENCE_NS and kind in CAUSES:
                return f"autopilot does not use the obstacles: {cause or CAUSES[kind]}"
            present = (since_ns for since_ns, newest_ns in self._differs.values() if now_ns - newest_ns < PRESENT_NS)
            if any(now_ns - since_ns > PATIENCE_NS for since_ns in present):
                return "autopilot reports other obstacles: not those that were sent; is a second sensor or companion connected?"
            return ""


def likely_cause(vehicle: Vehicle, facts: AutopilotFacts, signing_fault: str) -> str:
    """Returns the known fault that explains why obstacles are not used or not echoed, as text; empty: none is known."""
    values = facts.values
    if signing_fault:
        return signing_fault
    if vehicle.mavlink_1:
        set_to = "MAV_PROTO_VER = 2" if vehicle.autopilot == PX4 else "SERIALn_PROTOCOL = 2"
        return f"the autopilot uses MAVLink 1 on this link, which has no such messages; set {set_to}"
    if vehicle.autopilot == PX4 and values.get("CP_DIST", 1.0) <= 0.0:
        return f"CP_DIST = {values['CP_DIST']:g} switches collision prevention off"
    if vehicle.autopilot == PX4 and (fault := position_mode_fault(facts)):
        return fault
    if vehicle.autopilot == ARDUPILOT and MAVLINK_SENSOR not in (
        values.get("PRX1_TYPE", MAVLINK_SENSOR),
        values.get("PRX2_TYPE"),
    ):
        return f"PRX1_TYPE = {values['PRX1_TYPE']:g}; set it to 2 and restart the autopilot"
    return ""


def echoed_cm(message: Any) -> list[tuple[list[int], int]]:
    """Returns the obstacles of an echo: (elements of a sent message that may have caused it, cm). Empty: no echo, or without an
    obstacle."""
    if message.get_type() == "OBSTACLE_DISTANCE":
        known = [(k, int(v)) for k, v in enumerate(message.distances) if v != UNKNOWN and v < message.max_distance]
        return [(_elements(message, k), cm) for k, cm in known]
    if (face := echoed_face(message)) is not None and message.current_distance < message.max_distance:
        return [([i for i in range(SECTORS) if face_of(SECTOR_DEG * i) == face], int(message.current_distance))]
    return []


def _was_sent(sent_cm: NDArray[np.int64], cm: int, face: int | None) -> bool:
    """Whether a distance is one of those sent, (messages, elements); of a face, whose nearest one is echoed, the nearest of a
    message."""
    compared = sent_cm if face is None else sent_cm.min(axis=1)
    return bool((np.abs(compared - cm) <= SLACK_CM).any())


def _elements(message: Any, k: int) -> list[int]:
    """The elements at the direction of value k of PX4's map, and those beside it; all where that is not in the body frame."""
    at_deg = float(message.angle_offset) + k * float(message.increment_f or message.increment)
    if message.frame != BODY_FRD or not math.isfinite(at_deg):
        return list(range(SECTORS))
    nearest = round(at_deg / SECTOR_DEG)
    return [(nearest + i) % SECTORS for i in (-1, 0, 1)]


def echoed_face(message: Any) -> int | None:
    """Returns the face that a DISTANCE_SENSOR of ArduPilot is of; None: another message, or of a range finder."""
    is_face = message.get_type() == "DISTANCE_SENSOR" and message.orientation < FACES and message.id >= FIRST_FACE_ID
    return int(message.orientation) if is_face else None
