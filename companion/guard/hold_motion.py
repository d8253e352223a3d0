"""Detects that a vehicle in a stop mode flies again. PX4's Hold is also the mode of a Go-to, so the mode does not
show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NS = 1_000_000_000
STANDS_M_S: Final = 0.4
"""A slower vehicle counts as stopped."""
FALL_M_S: Final = 0.5
"""The vehicle has begun to brake when its speed has decreased by this much."""
RISE_M_S, RISE_NS = 1.0, NS
"""The vehicle flies again when it is faster than its lowest speed by RISE_M_S for RISE_NS."""


@dataclass(slots=True)
class HoldMotion:
    """Follows the speed in a stop mode. `flies_again` must be called at each step."""

    _highest_m_s: float = 0.0
    _lowest_m_s: float | None = None
    _since_ns: int | None = None

    def stands(self) -> None:
        """The vehicle has come to rest."""
        self._lowest_m_s = 0.0

    def flies_again(self, speed_m_s: float | None, now_ns: int) -> bool:
        """True if the speed has risen again after it fell. speed_m_s: None, not known."""
        if speed_m_s is None:
            return False
        self._highest_m_s = max(self._highest_m_s, speed_m_s)
        if self._lowest_m_s is not None:
            self._lowest_m_s = min(self._lowest_m_s, speed_m_s)
        elif speed_m_s <= self._highest_m_s - FALL_M_S:
            self._lowest_m_s = speed_m_s
        if self._lowest_m_s is None or speed_m_s <= self._lowest_m_s + RISE_M_S:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns >= RISE_NS
