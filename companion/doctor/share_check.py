"""Checks what is configured to share obstacles with other vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drivers.base import DriverError
from drivers.sharing.zenoh_link import is_authenticated

from ..config.loader import Config
from ..config.share import AUTOPILOT_LINE
from ..diagnostic import DiagnosticCode
from .finding import Finding

PART = "sharing"


def share_findings(config: Config) -> Iterator[Finding]:
    """The links to other vehicles: whether they can be used, and whether they are authenticated."""
    share = config.share
    if not share.enabled:
        return
    if share.tunnel and not config.autopilot.signing_key:
        text = (
            f'tunnel = "{share.tunnel}" without [autopilot] signing_key: every sender on that line can add obstacles; make a '
            "key with `companion keys --signing FILE` and give it to all vehicles"
        )
        yield Finding(PART, False, text, DiagnosticCode.SHARE_NOT_AUTHENTICATED)
    elif share.tunnel:
        yield Finding(PART, True, f'tunnel = "{share.tunnel}", only signed messages are accepted')
    if share.tunnel == AUTOPILOT_LINE and not config.autopilot.system_id:
        text = (
            'tunnel = "autopilot" without [autopilot] system_id: other vehicles are received on the autopilot\'s line, and while it '
            "is not known which one carries this computer all cameras are blind; set it to the id of this vehicle"
        )
        yield Finding(PART, False, text, DiagnosticCode.SEVERAL_VEHICLES)
    if share.zenoh:
        yield _zenoh_finding(Path(share.zenoh))


def _zenoh_finding(path: Path) -> Finding:
    try:
        authenticated = is_authenticated(path)
    except DriverError as error:
        return Finding(PART, False, str(error), DiagnosticCode.SHARE_LINK_CLOSED)
    if not authenticated:
        text = (
            f"{path} has neither users nor TLS with client certificates: every host in this network can add obstacles; set "
            "transport/auth/usrpwd or transport/link/tls/enable_mtls there"
        )
        return Finding(PART, False, text, DiagnosticCode.SHARE_NOT_AUTHENTICATED)
    return Finding(PART, True, f"zenoh with {path}, authenticated")
