"""The error of a command line that cannot be used."""

from __future__ import annotations


class UsageError(ValueError):
    """Options that exclude or need each other, a missing argument, or a value that no file and no device could make usable.
    The message names the option and what to give instead. `companion` ends with status 2."""
