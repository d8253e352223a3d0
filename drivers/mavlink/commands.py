"""Commands to the autopilot as MAVLink messages: requests for messages, flight mode and speed.

Each is a COMMAND_LONG with the system id and the component id of one autopilot as target; none is a broadcast. The
effects are taken from the sources of PX4 (Commander, Navigator) and ArduCopter (GCS_MAVLink_Copter.cpp):

- MAV_CMD_DO_SET_MODE (176): param1 is MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, param2 the mode; PX4 has a sub mode in
  param3.
- MAV_CMD_DO_REPOSITION (192) with MAV_DO_REPOSITION_FLAGS_CHANGE_MODE and no coordinates (NaN): PX4 changes to Hold
  at the point where it comes to rest. ArduCopter changes to GUIDED and needs coordinates; it is not sent there.
- MAV_CMD_DO_CHANGE_SPEED (178): param1 = 1 is ground speed, param2 in m/s, greater than 0. PX4 ignores param1, and
  accepts the command in every mode, also in Offboard, where it has no effect. ArduCopter accepts it in AUTO, GUIDED
  and RTL."""

from __future__ import annotations

import math
from typing import Any, Final

from .dialect import dialect

DO_SET_MODE: Final = dialect.MAV_CMD_DO_SET_MODE
DO_CHANGE_SPEED: Final = dialect.MAV_CMD_DO_CHANGE_SPEED
DO_REPOSITION: Final = dialect.MAV_CMD_DO_REPOSITION
SET_MESSAGE_INTERVAL: Final = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
REQUEST_MESSAGE: Final = dialect.MAV_CMD_REQUEST_MESSAGE
CHANGE_MODE_FLAG: Final = dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
NO_CHANGE: Final = -1.0
"""DO_CHANGE_SPEED param3: unchanged throttle; DO_REPOSITION param1: default speed."""
PX4_AUTO, PX4_AUTO_LOITER = 4, 3
"""Main mode and sub mode of Hold."""
COPTER_BRAKE, COPTER_LOITER = 17, 5


def request_message(system_id: int, message_id: int) -> Any:
    """Returns a request for one message."""
    return _command(system_id, REQUEST_MESSAGE, message_id)


def request_capabilities(system_id: int) -> Any:
    """Returns a request for AUTOPILOT_VERSION to firmware that does not know REQUEST_MESSAGE."""
    return _command(system_id, dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1)


def px4_mode_number(main: int, sub: int) -> int:
    """Returns the custom_mode of a heartbeat of PX4."""
    return main << 16 | sub << 24


def px4_main_and_sub(custom_mode: int) -> tuple[int, int]:
    """Returns main and sub mode in the custom_mode of a heartbeat of PX4."""
    return (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF


def set_px4_hold(system_id: int) -> Any:
    """Returns the command for Hold: PX4 brakes and keeps its position and height."""
    return _command(system_id, DO_SET_MODE, dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, PX4_AUTO, PX4_AUTO_LOITER)


def px4_reposition_here(system_id: int) -> Any:
    """Returns the command for Hold at the point where the vehicle comes to rest, with unchanged height and yaw."""
    nan = math.nan
    return _command(system_id, DO_REPOSITION, NO_CHANGE, CHANGE_MODE_FLAG, 0.0, nan, nan, nan, nan)


def set_copter_mode(system_id: int, mode: int) -> Any:
    """Returns the command for a mode of ArduCopter."""
    return _command(system_id, DO_SET_MODE, dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode)


def change_speed(system_id: int, speed_m_s: float) -> Any:
    """Returns the command for the greatest horizontal speed of the mission. Raises ValueError unless it is greater
    than 0."""
    if not speed_m_s > 0.0:
        raise ValueError(f"speed {speed_m_s!r} m/s: must be greater than 0; an autopilot takes 0 for the default speed")
    return _command(system_id, DO_CHANGE_SPEED, dialect.SPEED_TYPE_GROUNDSPEED, speed_m_s, NO_CHANGE)


def set_message_interval(system_id: int, message_id: int, hz: float) -> Any:
    """Returns a request for a message at a rate."""
    return _command(system_id, SET_MESSAGE_INTERVAL, message_id, 1e6 / hz)


def _command(system_id: int, command: int, *params: float) -> Any:
    if not 1 <= system_id <= 255:
        raise ValueError(f"target system {system_id}: must be 1 to 255; 0 would be all vehicles")
    numbers = (*params, *[0.0] * (7 - len(params)))
    return dialect.MAVLink_command_long_message(system_id, dialect.MAV_COMP_ID_AUTOPILOT1, command, 0, *numbers)
