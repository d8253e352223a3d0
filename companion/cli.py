"""The command `companion`. Only the module of the given command is imported."""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from shutil import get_terminal_size
from textwrap import fill
from typing import Any, Final

from . import raise_at_interrupt
from .argument_parser import ArgumentParser
from .command_list import COMMANDS, GROUPS
from .console import fail, print_line
from .error_text import error_text
from .kernels.jit_cache import no_place_text
from .standard_streams import discard_stdout, prepare
from .usage_error import UsageError

_INTERRUPTED: Final = 130
_ADDRESS: Final = re.compile(r"[a-z][a-z0-9]+:/")
_OWN: Final = ("companion", "core", "drivers")
"""Packages of this software: if a module of them is missing, this is a defect."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command. 0: success; 1: failure, with cause and remedy on stderr; 2: wrong usage, with the remedy."""
    if argv is None:
        prepare()
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # idle threads of numpy's OpenBLAS would spin during the start
    if mistake := _mistake_of_command(words):
        fail(mistake)
        return 2
    try:
        status = _run(words)
        return status if _flushed(quiet=status != 0) else 1
    except BrokenPipeError:  # the reader of the output has closed it
        discard_stdout()
        return 1
    except KeyboardInterrupt as interrupt:
        _print_interrupted(interrupt)
        return _INTERRUPTED
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in _OWN:
            raise
        fail(
            f"the Python module {error.name} is missing: osape-companion was installed without its requirements, as by "
            f"`pip install --no-deps`. `{sys.executable} -m pip check` lists the missing packages; install them, or "
            "osape-companion again without --no-deps"
        )
        return 1
    except RuntimeError:
        if not (text := no_place_text()):
            raise
        fail(text)
        return 1


def _print_interrupted(interrupt: KeyboardInterrupt) -> None:
    if sys.stderr.isatty():
        sys.stderr.write("\n")  # the prompt of the shell would follow ^C on its line
    if text := str(interrupt):  # of a command that says what was done
        fail(text)


def _mistake_of_command(words: Sequence[str]) -> str:
    """Returns why the first word is no command, with the remedy; "" if it is one, or an option without a command."""
    if not words or words[0] in COMMANDS:
        return ""
    if words[0].startswith("-"):
        place = next((k for k, word in enumerate(words) if word in COMMANDS), None)
        if place is None or words[0] in ("-h", "--help"):
            return ""
        return (
            f"options follow the command: companion {shlex.join([words[place], *words[:place], *words[place + 1 :]])}"
        )
    near = difflib.get_close_matches(words[0], COMMANDS, n=1)
    remedy = f"did you mean `companion {near[0]}`?" if near else "`companion --help` lists the commands"
    return f"there is no command {words[0]!r}; {remedy}"


def _flushed(quiet: bool) -> bool:
    """Writes what stdout has buffered; prints the cause where that fails, unless `quiet`. Python would do it after the
    command, with a message of its own."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        if not quiet:
            fail(error_text(error))
        discard_stdout()
        return False
    return True


def _run(words: Sequence[str]) -> int:
    """Parses the words and runs the command."""
    parser = parser_of(words[0] if words else "")
    try:
        args = parser.parse_args(words)
    except SystemExit as end:  # argparse exits this way after --help and on wrong usage
        return end.code if isinstance(end.code, int) else 2
    except BrokenPipeError:
        raise
    except OSError as error:  # of --help, where stdout has no buffer
        fail(error_text(error))
        return 1
    if args.command is None and not args.version:
        parser.print_usage(sys.stderr)
        fail("no command is given; `companion --help` lists the commands")
        return 2
    try:
        _refuse_addresses(args)
        raise_at_interrupt()
        return _print_version() if args.version else int(_module(args.command).run(args))
    except BrokenPipeError:  # an OSError, but not of the command
        raise
    except UsageError as error:
        fail(str(error))
        return 2
    except _expected_errors() as error:
        fail(error_text(error, getattr(args, "output", None)))
        return 1


def _refuse_addresses(args: argparse.Namespace) -> None:
    """Raises UsageError for an address in place of a file: as a Path it has lost a slash, and would be a file's name."""
    for value in vars(args).values():
        if isinstance(value, Path) and _ADDRESS.match(str(value)):
            raise UsageError(
                f"{str(value).replace(':/', '://', 1)}: an address, and this command takes files of this computer; copy it to a "
                "file first (`companion batch` and `companion find` take addresses)"
            )


def parser_of(command: str) -> argparse.ArgumentParser:
    """The parser with the options of one command and the names of the others."""
    parser = ArgumentParser(
        prog="companion",
        usage="companion COMMAND [OPTIONS]",
        description=_command_table(),
        epilog="`companion COMMAND --help` lists the options of a command.\nStart with `companion demo`.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    subparsers = parser.add_subparsers(prog="companion", dest="command", help=argparse.SUPPRESS)
    for name in COMMANDS:
        if name == command:
            _module(name).add_parser(subparsers)
            _add_texts(subparsers.choices[name], name)
        else:
            subparsers.add_parser(name)
    return parser


def _command_table() -> str:
    """All commands with their purpose, by group, in the order of use."""
    lines = ["Obstacle perception for multirotors."]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:"]
        for name, command in commands.items():
            gap = " " * 22
            lines.append(fill(command.purpose, _width(), initial_indent=f"  {name:<20}", subsequent_indent=gap))
    return "\n".join(lines)


def _width() -> int:
    """Characters in a line of help text."""
    return max(40, min(79, get_terminal_size().columns - 1))


def _add_texts(parser: argparse.ArgumentParser, name: str) -> None:
    """The description and the examples of a command in its help."""
    command = COMMANDS[name]
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = fill(f"{command.purpose[0].upper()}{command.purpose[1:]}.", _width())
    parts = ["\n".join(["examples:", *(f"  {line}" for line in command.examples)])] if command.examples else []
    parts += [fill(parser.epilog, _width())] if parser.epilog else []
    parser.epilog = "\n\n".join(parts) or None


def _module(command: str) -> Any:
    """The module of a command."""
    return importlib.import_module(f".{COMMANDS[command].module}", __package__)


def _expected_errors() -> tuple[type[Exception], ...]:
    """Errors with a message for the user. Any other exception is a defect and prints its traceback."""
    from drivers.base import DriverError

    from .config.loader import ConfigError
    from .kernels.compilation import WarmupError

    return DriverError, ConfigError, WarmupError, ValueError, OSError


def _print_version() -> int:
    from .log.provenance import software

    print_line(software())
    return 0
