"""One result of `companion doctor`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One checked part. ok: no fault was found; text: the result, and the remedy of a fault; code: of DiagnosticCode, empty
    when ok, and for a mistake that only the doctor finds."""

    part: str
    ok: bool
    text: str
    code: str = ""
