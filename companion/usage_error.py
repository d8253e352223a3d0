"""The error of a command line that cannot be used."""

from __future__ import annotations

import argparse
from collections.abc import Iterable


class UsageError(ValueError):
    """Options that exclude or need each other, a missing argument, or a value that no file and no device could make usable.
    The message names the option and what to give instead. `companion` ends with status 2."""


def given_option(args: argparse.Namespace, names: Iterable[str]) -> str:
    """The first of these options that is on the command line, such as `--frame-latency-ms`; "" if none is. names: as in
    `args`, which holds None, False or an empty list for an option that is not given."""
    values = ((name, getattr(args, name)) for name in names)
    given = (name for name, value in values if value is not None and value is not False and value != [])  # 0 is given
    return next((f"--{name.replace('_', '-')}" for name in given), "")
