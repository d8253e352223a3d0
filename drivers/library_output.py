"""Collects what a library prints: the standard output belongs to the result of a command (`--json`)."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Final

_STDERR: Final = 2


@contextmanager
def collected_output() -> Iterator[io.StringIO]:
    """Yields the text that is printed within the block: by Python code, and, after its end, by compiled code on stderr."""
    text = io.StringIO()
    with tempfile.TemporaryFile() as native:
        original = os.dup(_STDERR)
        os.dup2(native.fileno(), _STDERR)
        try:
            with redirect_stdout(text), redirect_stderr(text):
                yield text
        finally:
            os.dup2(original, _STDERR)
            os.close(original)
            native.seek(0)
            text.write(native.read().decode(errors="replace"))
