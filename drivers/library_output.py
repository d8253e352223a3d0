"""Collects what a library prints: the standard output belongs to the result of a command (`--json`)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout


@contextmanager
def collected_output() -> Iterator[io.StringIO]:
    """Yields the text that Python code prints within the block."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text):
        yield text
