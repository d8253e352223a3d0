"""Words to the people at the ground station: STATUSTEXT, one for each change, never a stream of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.mavlink_dialect import dialect

NS = 1_000_000_000
MOST_CHARACTERS = 50
LEAST_APART_NS = 2 * NS
CRITICAL, INFO = 2, 6
"""MAV_SEVERITY."""


class StatusTexts:
    """`due` with how each camera is now. A state that comes and goes within two seconds is told once, as it ends."""

    def __init__(self) -> None:
        self._told: dict[str, bool] = {}
        self._last_ns: int | None = None

    def due(self, blind: Mapping[str, str], now_ns: int) -> Any | None:
        """The message to send now, if any. blind: why each camera is blind, in words; empty: it sees.

        At the start only blindness that lasts is a change: cameras take some seconds to open."""
        if self._last_ns is None:
            self._last_ns = now_ns + 8 * NS
        if now_ns - self._last_ns < LEAST_APART_NS:
            return None
        for camera, cause in blind.items():
            is_blind = bool(cause)
            if self._told.get(camera, False) != is_blind:
                self._told[camera], self._last_ns = is_blind, now_ns
                text = f"OA: {camera} blind: {cause}" if is_blind else f"OA: {camera} sees again"
                return dialect.MAVLink_statustext_message(CRITICAL if is_blind else INFO, shortened(text).encode())
        return None


def shortened(text: str) -> str:
    """At most 50 bytes of plain characters, cut at a word where there is one."""
    plain = text.encode("ascii", "replace").decode()
    if len(plain) <= MOST_CHARACTERS:
        return plain
    cut = plain[: MOST_CHARACTERS + 1].rsplit(" ", 1)[0]
    return cut if len(cut) > MOST_CHARACTERS // 2 else plain[:MOST_CHARACTERS]
