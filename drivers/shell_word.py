"""A path as a word of a command line, for messages that name the next command."""

from __future__ import annotations

import shlex
from pathlib import Path


def shell_word(path: Path | str) -> str:
    """The path, quoted where a shell needs it; one that begins with a minus, as an option does, begins with ./"""
    text = str(path)
    return shlex.quote(f"./{text}" if text.startswith("-") else text)
