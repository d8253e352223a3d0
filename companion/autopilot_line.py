"""The autopilot's line by the configuration: what is asked for, sent and signed."""

from __future__ import annotations

from pathlib import Path

from drivers.mavlink import MavlinkParams
from drivers.mavlink_signing import Signing
from drivers.signing_clock import SigningClock
from drivers.signing_key import load_key

from .config import Config
from .config_live import AutopilotConfig

CLOCK_FILE = "signing-clock"


def params_of(config: Config) -> MavlinkParams:
    """Who we are on the line, what we ask for, and how often we tell of obstacles."""
    a = config.autopilot
    return MavlinkParams(
        system_id=a.system_id, component_id=a.component_id, attitude_hz=a.attitude_hz, position_hz=a.position_hz,
        obstacles_hz=config.avoid.rate_hz if config.avoid.send else 0.0,
    )  # fmt: skip


def signing_of(autopilot: AutopilotConfig, state: Path) -> Signing:
    """Signatures with the configured key, their timestamps kept in the state folder; none without a key. Raises
    DeviceNotFound and BadData for a key that cannot be used."""
    if not autopilot.signing_key:
        return Signing()
    return Signing(load_key(Path(autopilot.signing_key)), SigningClock(state / CLOCK_FILE))
