"""The one place where dialect and version of MAVLink are chosen: ardupilotmega (contains common), MAVLink 2."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

__all__ = ["dialect"]
