"""Codes of the conflicts with other senders on the autopilot's link (`LinkStatus.conflicts`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ..diagnostic import Diagnostic, DiagnosticCode

CONFLICT_CODES: Final = {
    "two autopilots": DiagnosticCode.DUPLICATE_AUTOPILOT,
    "two clocks": DiagnosticCode.DUPLICATE_AUTOPILOT,
    "two companions": DiagnosticCode.DUPLICATE_OBSTACLE_SOURCE,
    "two services": DiagnosticCode.DUPLICATE_COMPONENT,
    "several vehicles": DiagnosticCode.SEVERAL_VEHICLES,
    "system id": DiagnosticCode.SYSTEM_ID_MISMATCH,
}
"""Code of each topic."""


def conflict_diagnostics(conflicts: Mapping[str, str]) -> list[Diagnostic]:
    """Returns a diagnostic per conflict. conflicts: topic -> text."""
    return [Diagnostic(CONFLICT_CODES[topic], "", text) for topic, text in conflicts.items()]
