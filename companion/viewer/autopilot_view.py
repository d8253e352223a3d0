"""State of the autopilot as the page shows it: mode, armed, obstacle distances sent and echoed."""

from __future__ import annotations

import math
from typing import Any

from osape_client.proto import osape_v1_pb2 as pb

UNKNOWN_CM = 65535
BETWEEN_HEARTBEATS_NS = 1_000_000_000
"""Usual age of a heartbeat."""


def autopilot_data(health: pb.Health | None, t_ns: int) -> dict[str, Any] | None:
    """For the page; None without a report or a heartbeat. t_ns: for the ages, on the clock of the report, which may be that of
    another computer.

    sent, echoed: None, or {cm: by direction, null: unknown, first, step: degrees, clear: cm from which on nothing is seen,
    body: from the heading, age_s}."""
    if health is None or not health.autopilot.autopilot:
        return None
    a = health.autopilot
    return {
        "kind": a.autopilot,
        "mode": a.flight_mode,
        "armed": a.armed,
        "age_s": round((t_ns - health.t_ns + max(0, a.heartbeat_age_ns - BETWEEN_HEARTBEATS_NS)) / 1e9, 2),
        "sent": _sectors(a.obstacles_sent, t_ns) if a.HasField("obstacles_sent") else None,
        "echoed": _sectors(a.obstacles_echoed, t_ns) if a.HasField("obstacles_echoed") else None,
    }


def _sectors(s: pb.ObstacleSectors, t_ns: int) -> dict[str, Any] | None:
    """None where their directions are not finite."""
    if not (math.isfinite(s.first_deg) and math.isfinite(s.step_deg)):
        return None
    return {
        "cm": [None if cm == UNKNOWN_CM else cm for cm in s.cm],
        "first": s.first_deg,
        "step": s.step_deg,
        "clear": s.clear_cm,
        "body": s.body_frame,
        "age_s": round((t_ns - s.t_ns) / 1e9, 2),
    }
