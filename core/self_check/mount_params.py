"""Parameters of the mount check."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class MountCheckParams:
    """Parameters of the mount check. Raises ValueError if one is out of range."""

    enabled: bool = switch(
        True, "compare the configured mount of each camera with the ground and the walls it measures", safety=True
    )
    degraded_deg: float = critical(1.0, 0.5, 5.0, "deg", "error of the mount from which the service is degraded")
    invalid_deg: float = critical(3.0, 1.0, 10.0, "deg", "error of the mount from which frames are invalid")
    unverified_deg: float = critical(
        4.0, 1.0, 20.0, "deg", "apparent slope of the ground from which frames are invalid until the mount is verified"
    )
    interval_s: float = critical(0.1, 0.0, 1.0, "s", "least time between two measurements, after the first ten")
    terrain_deg_per_sqrt_s: float = critical(
        0.1, 0.01, 5.0, "deg/sqrt(s)", "how fast the slope of the terrain is expected to change"
    )

    def __post_init__(self) -> None:
        check("mount_check", self)
        if self.degraded_deg > self.invalid_deg:
            raise ValueError(
                f"[mount_check] degraded_deg = {self.degraded_deg:g} must not exceed invalid_deg = {self.invalid_deg:g}"
            )
