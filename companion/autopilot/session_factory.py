"""Creates the MAVLink session of a configuration: requested messages, output and signing."""

from __future__ import annotations

from pathlib import Path

from drivers.mavlink.session_types import MavlinkParams
from drivers.mavlink.signing import Signing
from drivers.mavlink.signing_clock import SigningClock
from drivers.mavlink.signing_key import load_key

from ..config.loader import Config
from ..config.service import AutopilotConfig
from ..config.share import AUTOPILOT_LINE

CLOCK_FILE = "signing-clock"
POINTS_A_CAMERA, MOST_POINTS = 30, 104
"""Number of points by which the load of the link is judged. Of a camera 90 degrees wide: 18 sectors, and three faces
in four layers. Of all around: 72 sectors, and eight faces."""


def params_of(config: Config) -> MavlinkParams:
    """Returns own ids, requested messages and the rate of the obstacle output."""
    a, share = config.autopilot, config.share
    is_shared = share.enabled and share.tunnel == AUTOPILOT_LINE
    others = len(share.member_numbers()) or 1  # of an open team at least one
    return MavlinkParams(
        system_id=a.system_id,
        component_id=a.component_id,
        attitude_hz=a.attitude_hz,
        position_hz=a.position_hz,
        obstacles_hz=config.avoid.rate_hz if config.avoid.send else 0.0,
        obstacle_points=min(MOST_POINTS, POINTS_A_CAMERA * len(config.cameras)) if config.avoid.points else 0,
        distance_sensors=config.avoid.upward + config.avoid.downward,
        tunnel_bytes_per_s=share.tunnel_bytes_per_s if is_shared else 0.0,
        neighbours=others if is_shared else 0,
    )


def signing_of(autopilot: AutopilotConfig, state: Path) -> Signing:
    """Returns the signatures with the configured key; none without a key. Their timestamps are kept in the state
    folder.

    Raises DeviceNotFound and BadData for a key that cannot be used."""
    if not autopilot.signing_key:
        return Signing()
    return Signing(load_key(Path(autopilot.signing_key)), SigningClock(state / CLOCK_FILE))
