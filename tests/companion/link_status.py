"""Status of a link to an autopilot."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers.mavlink.clock_sync import ClockEstimate, ClockSource
from drivers.mavlink.session_types import LinkStatus, Vehicle


def link_status(vehicle: Vehicle | None, **changes: Any) -> LinkStatus:
    """A link without a fault, whose clock is known by arrival times. changes: other values of its fields."""
    status = LinkStatus(
        vehicle=vehicle,
        clock=ClockEstimate(ClockSource.ENVELOPE),
        clock_restarts=0,
        attitude_hz=100.0,
        position_hz=30.0,
        received=1,
        counts={},
    )
    return replace(status, **changes)
