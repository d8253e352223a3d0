"""Output of commands: results on stdout, errors and progress on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final

_LISTED: Final = 10


def print_line(text: str = "") -> None:
    """Prints one line of the result."""
    sys.stdout.write(text + "\n")


def print_json(what: Mapping[str, Any]) -> None:
    """Prints the object of `--json`. The caller replaces nan and inf, which JSON does not have, by None."""
    sys.stdout.write(json.dumps(what, indent=2, allow_nan=False) + "\n")


def counted(number: int, noun: str) -> str:
    """The number with its noun: "1 clip", "2 clips"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def first_damages(texts: Sequence[str]) -> list[str]:
    """The first ten damages of a file, and the number of the others: a disk that fails gives thousands."""
    listed = list(texts[:_LISTED])
    return listed + [f"and {counted(len(texts) - _LISTED, 'more damage')} (--json lists all)"] * (len(texts) > _LISTED)


def fail(text: str) -> None:
    """Prints an error with its cause and remedy."""
    sys.stderr.write(f"companion: error: {text}\n")


def warn(text: str) -> None:
    """Prints a warning."""
    sys.stderr.write(f"companion: warning: {text}\n")


@contextmanager
def progress(label: str) -> Iterator[Callable[[float], None]]:
    """A progress bar on stderr where that is a terminal. Yields a function that takes the completed share, 0..1."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda share: bar.update(task, completed=share)
