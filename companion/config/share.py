"""The section `[share]`: obstacles shared with other vehicles."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import check, number, switch, text
from core.sharing.params import SharingParams

from .service import check_line

AUTOPILOT_LINE = "autopilot"
"""`[share] tunnel`: over the link to the autopilot, which forwards the messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShareConfig(SharingParams):
    """Links to other vehicles, and what is sent. Raises ValueError naming the field, its value and its range."""

    enabled: bool = switch(False, "exchange obstacles with other vehicles; needs [publish] world and a position")
    vehicle: int = number(0, 0, 255, "", "own number in the team, unique; 0: the MAVLink system id of the vehicle")
    members: str = text("", "numbers of the vehicles whose packets are accepted, such as 2,3,5; empty: all")
    origin: str = text(
        "",
        "latitude, longitude (deg) and altitude above mean sea level (m) of the origin of ned; empty: GPS_GLOBAL_ORIGIN of the autopilot",
    )
    tunnel: str = text(
        "", "line for MAVLink TUNNEL messages: autopilot, or an address as in [autopilot] address; empty: none"
    )
    tunnel_bytes_per_s: float = number(300.0, 100.0, 20_000.0, "B/s", "greatest rate of the data in TUNNEL messages")
    zenoh: str = text("", "configuration file of zenoh (JSON5), with its TLS or users; empty: none")
    zenoh_team: str = text("team", "name of the team in zenoh's keys")
    zenoh_bytes_per_s: float = number(20_000.0, 150.0, 1e6, "B/s", "greatest rate of the data over zenoh")
    refresh_s: float = number(
        20.0, 1.0, 300.0, "s", "each plane is sent again after this time; less than expire_s of all others"
    )
    least_hits: int = number(3, 1, 50, "", "a plane is sent when this many frames have observed it")
    range_m: float = number(150.0, 10.0, 1000.0, "m", "planes within this distance of the vehicle are sent")
    send_planes: int = number(2000, 10, 20_000, "", "greatest number of planes that are sent, the nearest ones")

    def __post_init__(self) -> None:
        check("share", self)
        if self.refresh_s >= self.expire_s:
            raise ValueError(
                f"[share] refresh_s = {self.refresh_s:g} must be less than expire_s = {self.expire_s:g}: planes would "
                "expire before they are repeated"
            )
        if self.tunnel != AUTOPILOT_LINE:
            check_line("[share] tunnel", self.tunnel)
        self.member_numbers()
        self.fixed_origin()
        if not self.zenoh_team or any(c in "/*$#?" for c in self.zenoh_team):
            raise ValueError(f'[share] zenoh_team = "{self.zenoh_team}": expected a name without / * $ # ?')

    def member_numbers(self) -> frozenset[int]:
        """The numbers of `members`."""
        numbers = [part.strip() for part in self.members.split(",") if part.strip()]
        if not all(n.isdecimal() and 0 < int(n) < 256 for n in numbers):
            raise ValueError(f'[share] members = "{self.members}": expected numbers 1..255, such as 2,3,5')
        return frozenset(map(int, numbers))

    def fixed_origin(self) -> tuple[float, float, float] | None:
        """(latitude_deg, longitude_deg, altitude_m) of `origin`; None where it is empty."""
        if not self.origin.strip():
            return None
        try:
            lat, lon, alt = (float(part) for part in self.origin.split(","))
        except ValueError as error:
            raise ValueError(
                f'[share] origin = "{self.origin}": expected latitude, longitude, altitude, such as 47.3977, 8.5456, 488'
            ) from error
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and abs(alt) <= 20_000.0):
            raise ValueError(
                f'[share] origin = "{self.origin}": not a place on Earth; expected latitude -90..90, longitude -180..180, altitude'
            )
        return lat, lon, alt
