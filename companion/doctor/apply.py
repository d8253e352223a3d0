"""`companion doctor --apply`: proposes parameters of the autopilot, asks, and writes them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

from drivers.base import DriverError

from ..autopilot.parameter_writer import REBOOT, Change, ParameterWriter
from ..autopilot.restart_pending import TEXT as RESTART_TEXT
from ..config.loader import Config
from ..console import print_line
from ..diagnostic import DiagnosticCode
from .finding import Finding
from .service_check import running_service


def apply(config: Config, patience_s: float, agreed: Callable[[list[Change]], bool]) -> Iterator[Finding]:
    """Writes the missing parameters of the autopilot where `agreed` returns True, while no service holds the link."""
    if not config.autopilot.address:
        return
    if running_service(config, patience_s) is not None:
        yield _nothing_written("the service holds the link; stop it first (systemctl stop osape-companion)")
        return
    try:
        with ParameterWriter(config, patience_s) as writer:
            yield from _steps(writer, agreed)
    except DriverError as error:
        yield _nothing_written(str(error))


def _steps(writer: ParameterWriter, agreed: Callable[[list[Change]], bool]) -> Iterator[Finding]:
    try:
        wanted = writer.propose()
    except ValueError as error:
        yield _nothing_written(str(error))
        return
    if not wanted:
        yield Finding("apply", True, "nothing to change")
        return
    if not agreed(wanted):
        yield _nothing_written(f"without a yes. Proposed: {'; '.join(c.text() for c in wanted)}")
        return
    pending = False
    for change, failure in writer.write(wanted):
        pending |= not failure and change.name in REBOOT
        if failure:
            yield Finding("apply", False, f"{change.name}: {failure}", DiagnosticCode.PARAMETERS_NOT_WRITTEN)
        else:
            yield Finding("apply", True, f"written and read back: {change.text()}")
    if pending:
        yield Finding("apply", False, RESTART_TEXT, DiagnosticCode.PARAMETER_ADVICE)


def _nothing_written(cause: str) -> Finding:
    return Finding("apply", False, f"nothing is written: {cause}", DiagnosticCode.PARAMETERS_NOT_WRITTEN)


def confirmed(wanted: list[Change]) -> bool:
    """Prints the list of changes and asks for a typed `yes`."""
    print_line("to be written to the autopilot:")
    for change in wanted:
        print_line(f"    {change.text()}")
    sys.stdout.write("type yes to write them: ")
    sys.stdout.flush()
    return sys.stdin.readline().strip() == "yes"
