"""Parameters of the class *open*: space presumed free on stated evidence. See docs/explanation/open-space.md."""

from __future__ import annotations

from dataclasses import dataclass

from .param_field import check, choice, critical, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenSkyParams:
    """Which evidence makes unmeasured, textureless pixels count as open. Raises ValueError naming the field, its value and its
    range."""

    mode: str = choice(
        "off",
        ("off", "presume"),
        "presume: unmeasured sky counts as presumed free where the evidence below holds; off: it stays unknown",
        safety=True,
    )
    mount_measured: bool = switch(
        False,
        "roll and pitch of each camera were measured with `companion doctor --mount`: level ground in view "
        "then confirms them, without a turn",
        safety=True,
    )
    open_max_range_m: float = critical(15.0, 1.0, 25.0, "m", "greatest horizontal range of presumed free space")
    upper_border: bool = switch(
        True, "a column is open only where its textureless pixels reach the upper border of the image", safety=True
    )
    neighbours: bool = switch(
        True, "a column is open only up to what is measured in the columns beside it", safety=True
    )
    floating: bool = switch(
        True, "a column is open only up to measured objects nearby that have no connection to the ground", safety=True
    )
    horizon_deg: float = critical(1.5, 0.0, 10.0, "deg", "an edge this close to the horizon counts as the horizon")
    gap_deg: float = critical(
        1.5, 0.0, 10.0, "deg", "greatest height of the unmeasured edge between textureless and measured pixels below"
    )
    continued_deg: float = critical(
        12.0, 0.0, 20.0, "deg", "greatest height of smooth ground between that edge and the measured pixels below"
    )
    least_rise_deg: float = critical(5.0, 0.0, 45.0, "deg", "least height of the textureless pixels above that edge")
    reach_deg: float = critical(
        2.0, 0.0, 20.0, "deg", "columns within this angle count as beside a column; larger: less open space"
    )
    floating_reach_m: float = critical(
        1.0, 0.0, 20.0, "m", "assumed unmeasured extent of a partly measured object without connection to the ground"
    )

    open_share: float = critical(
        0.95, 0.5, 1.0, "", "least share of an open cell's pixels that see through it; at least free_share"
    )

    def __post_init__(self) -> None:
        check("open_sky", self)

    @property
    def presumes(self) -> bool:
        """Whether anything is presumed open."""
        return self.mode == "presume"
