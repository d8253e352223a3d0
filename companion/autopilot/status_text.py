"""Texts for the ground station (STATUSTEXT): one per change, at most one in two seconds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from core.types.model import InvalidCause
from drivers.mavlink.dialect import dialect

from ..pipeline.sync import DropCause

NS = 1_000_000_000
MOST_CHARACTERS = 50
SHORT: Final = {
    DropCause.ATTITUDE_STALE.text: "newest attitude too old",
    DropCause.FRAME_TOO_OLD.text: "exposure before all attitudes",
    DropCause.GAP_TOO_WIDE.text: "gap or conflict of attitudes",
    DropCause.NO_RATES.text: "attitude without body rates",
    DropCause.CLOCK_UNCERTAIN.text: "turns too fast for its clock",
    DropCause.DUPLICATE_FRAME.text: "exposure handled already",
    DropCause.LATE_FRAME.text: "exposures not in order",
    DropCause.WRONG_SIZE.text: "wrong image size",
    InvalidCause.TOO_STEEP.text: "camera tilted too far",
    InvalidCause.NON_FINITE.text: "values not finite",
    InvalidCause.MOUNT_ERROR.text: "mount wrong in roll or pitch",
    InvalidCause.MOUNT_UNVERIFIED.text: "mount unverified, turn vehicle",
}
"""Causes of a blind camera that would be cut, and what is sent in their place."""
LEAST_APART_NS, OPENING_NS = 2 * NS, 10 * NS


class StatusTexts:
    """Decides which text to send. What begins and ends between two texts is not sent. A camera or topic that changes all the time
    leaves room for others."""

    def __init__(self) -> None:
        self._sent: dict[str, bool] = {}
        self._noted: dict[str, str] = {}
        self._repeated: set[str] = set()  # cameras and topics
        self._sent_ns: dict[str, int] = {}  # the newest text of each camera and topic
        self._begun_ns: int | None = None
        self._last_ns: int | None = None
        self._last_was_note = True

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
        opening = now_ns - self._begun_ns < OPENING_NS
        for is_note in (not self._last_was_note, self._last_was_note):
            news = self._note(notes or {}) if is_note else self._change(blind, opening)
            if news is not None:
                name, severity, text = news
                self._repeated.discard(name)
                self._sent_ns[name] = self._last_ns = now_ns
                self._last_was_note = is_note
                return text_message(severity, f"OA: {text}")
        return None

    def _change(self, blind: Mapping[str, str], opening: bool) -> tuple[str, int, str] | None:
        """Returns (camera, severity, text) of a camera that became blind or recovered; None: none did."""
        for camera in self._longest_unsent(blind):
            is_blind = bool(blind[camera])
            if camera not in self._sent and (not is_blind or opening):
                if not is_blind:
                    self._sent[camera] = False
                continue
            if self._sent.get(camera) != is_blind or camera in self._repeated:
                self._sent[camera] = is_blind
                if is_blind:
                    return (
                        camera,
                        dialect.MAV_SEVERITY_CRITICAL,
                        f"{camera} blind: {SHORT.get(blind[camera], blind[camera])}",
                    )
                return camera, dialect.MAV_SEVERITY_INFO, f"{camera} recovered"
        return None

    def _note(self, notes: Mapping[str, str]) -> tuple[str, int, str] | None:
        """Returns (topic, severity, text) of a note that changed; None: none did."""
        for topic in self._longest_unsent(notes):
            now, before = notes[topic].split(":")[0], self._noted.get(topic, "")
            if now != before or topic in self._repeated:
                self._noted[topic] = now
                if now:
                    return topic, dialect.MAV_SEVERITY_WARNING, now
                return topic, dialect.MAV_SEVERITY_INFO, f"cleared: {before}"
        return None

    def _longest_unsent(self, names: Iterable[str]) -> list[str]:
        return sorted(names, key=lambda name: self._sent_ns.get(name, 0))


def mount_note(camera: str, degraded: bool) -> str:
    """Returns the note on a camera's mount. It contains no value, since each change of the estimate would be sent."""
    return f"{camera} mount differs from configuration" if degraded else ""


def text_message(severity: int, text: str) -> Any:
    """Returns the STATUSTEXT of a text, shortened to what it holds. severity: MAV_SEVERITY."""
    return dialect.MAVLink_statustext_message(severity, shortened(text).encode())


def shortened(text: str) -> str:
    """Returns as many whole words as fit into MOST_CHARACTERS, in ASCII.

    A word that is too long for the field is left out with all words after it; a text that begins with such a word is
    cut."""
    plain = text.encode("ascii", "replace").decode()
    if len(plain) <= MOST_CHARACTERS:
        return plain
    cut = plain[: MOST_CHARACTERS + 1].rpartition(" ")[0].rstrip(" ,;(")
    return cut or plain[:MOST_CHARACTERS]
