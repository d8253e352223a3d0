"""The one place where dialect and version of MAVLink are chosen: ardupilotmega (contains common), MAVLink 2."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

MAV_AUTOPILOT_INVALID = 8
"""HEARTBEAT.autopilot of everything that is no autopilot: ground stations, cameras, companions."""
MAV_COMP_ID_AUTOPILOT1 = 1

__all__ = ["MAV_AUTOPILOT_INVALID", "MAV_COMP_ID_AUTOPILOT1", "dialect"]
