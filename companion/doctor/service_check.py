"""Reads the health report of a running service."""

from __future__ import annotations

import time

from drivers.base import DriverError
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.run_folder import run_folder

from ..config.loader import Config
from ..diagnostic import DiagnosticCode
from ..live.health_stream import address_in_use, newest_health
from ..live.load_text import load_text
from .finding import Finding


def running_service(config: Config, patience_s: float) -> list[Finding] | None:
    """The diagnostics of the running service, once it has started; None when no service runs.

    A service that runs but sends no report is a finding of its own, since it holds the cameras and the link."""
    address = config.publish.address("health", run_folder())
    try:
        if not address or not address_in_use(address):
            return None
        health = _started_health(address, patience_s)
    except PermissionError:
        text = f"{address} may not be read by this user: run the command with sudo, or join the socket's group"
        return [Finding("service", False, text, DiagnosticCode.SERVICE_UNREACHABLE)]
    except DriverError:
        text = (
            f"a process holds {address} but sent no health report within {patience_s:g} s; check it with "
            "`systemctl status osape-companion`"
        )
        return [Finding("service", False, text, DiagnosticCode.SERVICE_UNREACHABLE)]
    return _service_findings(health) + _load_findings(health)


def _service_findings(health: pb.Health) -> list[Finding]:
    if not health.diagnostics:
        return [Finding("service", True, "running: OK (details: `companion status`)")]
    return [Finding("service", False, f"{d.code}: {d.text}", d.code) for d in health.diagnostics]


def _load_findings(health: pb.Health) -> list[Finding]:
    """That this computer does not keep up with the cameras."""
    text = load_text(health)
    return [Finding("computer", False, text)] if text else []


def _started_health(address: str, patience_s: float) -> pb.Health:
    """The first report after the start, or the newest one after `patience_s`. Raises DriverError when none arrives."""
    end_s = time.monotonic() + patience_s
    health = newest_health(address, patience_s)
    while health.state == pb.Health.STATE_STARTING and time.monotonic() < end_s:
        health = newest_health(address, patience_s)
    return health
