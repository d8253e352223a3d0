"""One result of `companion doctor`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One checked part."""

    part: str
    ok: bool  # no fault was found
    text: str  # the result, and the remedy of a fault
    code: str = ""  # of DiagnosticCode, empty when ok, and for a mistake that only the doctor finds
