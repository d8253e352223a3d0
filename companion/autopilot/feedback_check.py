"""Checks that the autopilot uses the obstacles it is sent: PX4 sends its map back, ArduPilot one DISTANCE_SENSOR per
face."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.mavlink.ardupilot_faces import FACES, face_of
from drivers.mavlink.session_types import ARDUPILOT, PX4, Vehicle

from .obstacle_distance import UNKNOWN
from .parameter_advice import MAVLINK_SENSOR, AutopilotFacts, position_mode_fault

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
        self._sent: list[tuple[int, list[int]]] = []  # (instant, nearest obstacle of each face), of PRESENT_NS
        self._waited_ns = self._sent_ns = self._obstacle_ns = 0
        self._differs: dict[int | None, tuple[int, int]] = {}  # by face: instants of the first and newest other echo

    def sent(self, values: NDArray[np.uint16], clear_cm: int, now_ns: int) -> None:
        """Records values that were sent. Only a message with an obstacle is answered by both autopilots."""
        with self._lock:
            self._sent = [(t, faces) for t, faces in self._sent if now_ns - t < PRESENT_NS]
            self._sent.append((now_ns, faces_cm(values)))
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
        nearest_echoed = nearest_sent(message)
        if nearest_echoed is None:
            return
        face, nearest = nearest_echoed
        with self._lock:
            self._waited_ns = 0
            sent = [min(faces) if face is None else faces[face] for _, faces in self._sent]
            if not sent or any(abs(cm - nearest) <= SLACK_CM for cm in sent):
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


def nearest_sent(message: Any) -> tuple[int | None, int] | None:
    """Returns (face, nearest obstacle in cm) of an echo; face None: of all. None: no echo, or without an obstacle."""
    if message.get_type() == "OBSTACLE_DISTANCE":
        known = [int(v) for v in message.distances if v != UNKNOWN and v < message.max_distance]
        return (None, min(known)) if known else None
    if (face := echoed_face(message)) is not None and message.current_distance < message.max_distance:
        return face, int(message.current_distance)
    return None


def echoed_face(message: Any) -> int | None:
    """Returns the face that a DISTANCE_SENSOR of ArduPilot is of; None: another message, or of a range finder."""
    is_face = message.get_type() == "DISTANCE_SENSOR" and message.orientation < FACES and message.id >= FIRST_FACE_ID
    return int(message.orientation) if is_face else None


def faces_cm(values: NDArray[np.uint16]) -> list[int]:
    """Returns the least of values (72,) in each of ArduPilot's eight faces."""
    faces = [UNKNOWN] * FACES
    for i, cm in enumerate(values.tolist()):
        face = face_of(5.0 * i)
        faces[face] = min(faces[face], cm)
    return faces
