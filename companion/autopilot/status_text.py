"""Texts for the ground station (STATUSTEXT): one per change, at most one in two seconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.mavlink.dialect import dialect

NS = 1_000_000_000
MOST_CHARACTERS = 50
LEAST_APART_NS, OPENING_NS = 2 * NS, 10 * NS
CRITICAL, WARNING, INFO = 2, 4, 6
"""MAV_SEVERITY."""


class StatusTexts:
    """Decides which text to send. A state that begins and ends within two seconds is sent once, when it ends."""

    def __init__(self) -> None:
        self._sent: dict[str, bool] = {}
        self._noted: dict[str, str] = {}
        self._repeated: set[str] = set()  # cameras and topics
        self._begun_ns: int | None = None
        self._last_ns: int | None = None

    def repeat(self) -> None:
        """Sends the faults of cameras and notes once more, to an autopilot that is received again."""
        self._repeated = {camera for camera, is_blind in self._sent.items() if is_blind}
        self._repeated |= {topic for topic, text in self._noted.items() if text}

    def due(self, blind: Mapping[str, str], now_ns: int, notes: Mapping[str, str] | None = None) -> Any | None:
        """Returns the message to send now, if any.

        A camera that has never worked is not reported before OPENING_NS, because it takes some seconds to open.

        Args:
            blind: why each camera is blind, as text; empty: it is not.
            now_ns: monotonic.
            notes: other faults, topic -> text, of which the part before the first colon is sent; empty: none."""
        self._begun_ns = now_ns if self._begun_ns is None else self._begun_ns
        if self._last_ns is not None and now_ns - self._last_ns < LEAST_APART_NS:
            return None
        for camera, cause in blind.items():
            is_blind = bool(cause)
            if camera not in self._sent and (not is_blind or now_ns - self._begun_ns < OPENING_NS):
                if not is_blind:
                    self._sent[camera] = False
                continue
            if self._sent.get(camera) != is_blind or camera in self._repeated:
                self._repeated.discard(camera)
                self._sent[camera], self._last_ns = is_blind, now_ns
                text = f"OA: {camera} blind: {cause}" if is_blind else f"OA: {camera} recovered"
                return dialect.MAVLink_statustext_message(CRITICAL if is_blind else INFO, shortened(text).encode())
        return self._note(notes or {}, now_ns)

    def _note(self, notes: Mapping[str, str], now_ns: int) -> Any | None:
        for topic, text in notes.items():
            now, before = text.split(":")[0], self._noted.get(topic, "")
            if now == before and topic not in self._repeated:
                continue
            self._repeated.discard(topic)
            self._noted[topic], self._last_ns = now, now_ns
            text = f"OA: {now}" if now else f"OA: cleared: {before}"
            return dialect.MAVLink_statustext_message(WARNING if now else INFO, shortened(text).encode())
        return None


def mount_note(camera: str, degraded: bool) -> str:
    """Returns the note on a camera's mount. It contains no value, since each change of the estimate would be sent."""
    return f"{camera} mount differs from configuration" if degraded else ""


def shortened(text: str) -> str:
    """Returns as many whole words as fit into MOST_CHARACTERS, in ASCII.

    A word that is too long for the field is left out with all words after it; a text that begins with such a word is
    cut."""
    plain = text.encode("ascii", "replace").decode()
    if len(plain) <= MOST_CHARACTERS:
        return plain
    cut = plain[: MOST_CHARACTERS + 1].rpartition(" ")[0].rstrip(" ,;(")
    return cut or plain[:MOST_CHARACTERS]
