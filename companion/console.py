"""What commands write: results on stdout, errors and progress on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any


def print_line(text: str = "") -> None:
    """A line for the reader of the command's output."""
    sys.stdout.write(text + "\n")


def print_json(what: Mapping[str, Any]) -> None:
    """The one object that `--json` promises. Numbers that JSON lacks (nan, inf) are the caller's to replace by None."""
    sys.stdout.write(json.dumps(what, indent=2, allow_nan=False) + "\n")


def fail(text: str) -> None:
    """An error: what happened and what to do."""
    sys.stderr.write(f"companion: error: {text}\n")


def warn(text: str) -> None:
    """Something the reader should know that is no error."""
    sys.stderr.write(f"companion: warning: {text}\n")


@contextmanager
def progress(label: str) -> Iterator[Callable[[float], None]]:
    """A bar on stderr when that is a terminal; call what it gives with the share done, 0..1."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda share: bar.update(task, completed=share)
