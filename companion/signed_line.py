"""What is signed on the autopilot's line, by the configuration."""

from __future__ import annotations

from pathlib import Path

from drivers.mavlink_signing import Signing
from drivers.signing_clock import SigningClock
from drivers.signing_key import load_key

from .config_live import AutopilotConfig

CLOCK_FILE = "signing-clock"


def signing_of(autopilot: AutopilotConfig, state: Path) -> Signing:
    """Signatures with the configured key, their timestamps kept in the state folder; none without a key. Raises
    DeviceNotFound and BadData for a key that cannot be used."""
    if not autopilot.signing_key:
        return Signing()
    return Signing(load_key(Path(autopilot.signing_key)), SigningClock(state / CLOCK_FILE))
