"""Addresses of ZeroMQ streams: their form, who can reach them, and which of them the service opens."""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING

from drivers.mavlink.address import is_host

if TYPE_CHECKING:
    from .loader import Config

RUN = "{run}"
"""Stands for the run folder of the service in an address."""
FORMS = "ipc://PATH or tcp://HOST:PORT, an IPv6 HOST in brackets"


def is_endpoint(address: str) -> bool:
    """True if an address is ipc://PATH or tcp://HOST:PORT, without another placeholder than `{run}`, and not abstract."""
    kind, _, place = address.replace(RUN, "").partition("://")
    host, _, port = place.rpartition(":")
    if kind == "tcp":
        return is_host(host) and port.isascii() and port.isdecimal() and 0 < int(port) < 65536
    return kind == "ipc" and bool(place) and "{" not in place and not place.startswith("@")


def forms_text(address: str) -> str:
    """The forms of an address, and why this one is none of them where it looks like one."""
    if "{" in address.replace(RUN, ""):
        return f"{FORMS}; {RUN} is the only placeholder"
    if address.startswith("ipc://@"):
        return f"{FORMS}; an abstract address (@) has no permissions: every user of the computer could connect"
    return FORMS


def beyond_loopback(address: str) -> bool:
    """Whether other machines can reach a ZeroMQ address."""
    if not address.startswith("tcp://"):
        return False
    host = address.removeprefix("tcp://").rpartition(":")[0].strip("[]")
    if host == "localhost":
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True  # *, an interface's name, a host's name


def opened_streams(config: Config) -> tuple[str, ...]:
    """Names of the streams that the service opens: those with an address and with content."""
    has_content = {
        "surround": len(config.cameras) > 1,
        "tracks": config.tracking.enabled,
        "neighbours": config.share.enabled,
    }
    names = ("prisms", "health", "surround", "tracks", "world", "world_requests", "neighbours", "depth")
    return tuple(n for n in names if has_content.get(n, True) and getattr(config.publish, n))


def without_keys_text(stream: str, address: str) -> str:
    """Why a stream is not opened that other machines could reach without keys, and what to do."""
    return (
        f"stream {stream}: {address} can be reached from other machines and needs keys: make them with `companion keys` and "
        "set their directory in [publish] keys"
    )
