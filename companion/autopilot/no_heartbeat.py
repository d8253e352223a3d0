"""What to do where no heartbeat arrives, by the kind of the link and by what arrives in its place."""

from __future__ import annotations

from typing import Final

from drivers.mavlink.anomalies import LinkAnomaly
from drivers.mavlink.session_types import LinkStatus

NOISE_BYTES: Final = 100
"""More than a port gives while it is plugged in, and fewer than an autopilot sends in some seconds."""


def no_heartbeat_remedy(address: str, status: LinkStatus) -> str:
    """The observation and the remedy, without numbers that change. address: of [autopilot]."""
    if status.received:
        return "messages arrive, none of an autopilot: check what is connected, and that a router passes HEARTBEAT"
    noise = status.counts.get(LinkAnomaly.NOISE_BYTES.value, 0) > NOISE_BYTES
    if not address.startswith("serial:"):
        return (
            "other data than MAVLink arrives: check the address"
            if noise
            else "check that the autopilot is on and sends to this address"
        )
    if noise:
        return "bytes arrive and none are MAVLink: set the baud rate of the address and of the port (SERIALn_BAUD, SER_..._BAUD) alike, and MAVLink on it"
    return "no bytes arrive: check power, that TX and RX are crossed, and that the port sends MAVLink (SERIALn_PROTOCOL = 2, MAV_n_CONFIG)"
