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

    def line(self) -> str:
        """The printed line: with the code, which leads to the table of remedies, unless the text begins with it."""
        code = f" [{self.code}]" if self.code and not self.text.startswith(self.code) else ""
        return f"{'ok ' if self.ok else ' ! '} {self.part}: {self.text}{code}"
