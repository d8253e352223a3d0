"""Parameters of the reports of neighbours: the part of `[share]` that `NeighbourMap` needs."""

from __future__ import annotations

from dataclasses import dataclass

from ..param_field import check, number, switch


@dataclass(frozen=True, slots=True, kw_only=True)
class SharingParams:
    """Parameters of the map of neighbours. Raises ValueError naming the field, its value and its range."""

    expire_s: float = number(60.0, 2.0, 600.0, "s", "a plane that its sender has not repeated for this time expires")
    mover_expire_s: float = number(
        2.0, 0.2, 10.0, "s", "a moving obstacle or vehicle not repeated for this time expires"
    )
    max_delay_s: float = number(
        2.0, 0.1, 30.0, "s", "packets delayed by more than this against the fastest are refused"
    )
    most_planes: int = number(4096, 64, 65536, "", "greatest number of planes of one neighbour; the oldest are dropped")
    most_neighbours: int = number(
        16, 1, 254, "", "greatest number of vehicles whose packets are accepted; further ones are refused and counted"
    )
    position_sigma_m: float = number(
        1.5, 0.05, 50.0, "m", "assumed error of the position of a local origin on Earth, horizontally"
    )
    height_sigma_m: float = number(2.0, 0.05, 50.0, "m", "assumed error of its altitude")
    heading_sigma_deg: float = number(2.0, 0.1, 30.0, "deg", "assumed error of its direction of north")
    max_sigma_m: float = number(
        4.0, 0.1, 50.0, "m", "obstacles of a neighbour whose place is less certain than this are withheld"
    )
    align: bool = switch(True, "refine the place of a neighbour's frame by planes that both vehicles have observed")

    def __post_init__(self) -> None:
        check("share", self)
