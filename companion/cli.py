"""The command `companion`. Only the module of the command that is asked for is imported."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any, Final

COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "run": ("live.run", "the live service: cameras and autopilot in, prisms out"),
    "status": ("live.status", "how the running service is, in words"),
    "simulate-autopilot": (
        "autopilot.simulate_autopilot",
        "an autopilot that is not there, for `run` without hardware",
    ),
    "doctor": ("doctor.doctor", "before the flight: what works, what does not, and what to do"),
    "keys": ("streams.keys", "make keys for streams that leave this machine, and of signatures"),
    "demo": ("demo.demo", "fly through a simulated scene: the whole way from depth to prisms, without hardware"),
    "import": ("importers.command", "make a log of a folder of depth images, or of a ROS 2 recording"),
    "replay": ("replay.replay", "run a recorded flight through the pipeline; compare with what was recorded"),
    "view": (
        "viewer.view",
        "draw a log: pictures and a page with the prisms in 3-D; --live: a page that follows the service",
    ),
    "info": ("log.info", "what is in a log: topics, rates, gaps, damage"),
    "recover": ("log.recover", "make a whole file of a damaged or unfinished one"),
    "check-config": ("config.check_config", "check a configuration file"),
    "install": ("install.install", "the service on this machine, started with it (needs root)"),
    "uninstall": ("install.uninstall", "take the service off this machine (needs root)"),
    "warmup": ("kernels.warmup", "compile what is compiled at first use"),
    "bench": ("bench.bench", "how fast this machine turns depth images into obstacles"),
}
"""Command -> its module in this package (add_parser, run) and what it does."""

_INTERRUPTED: Final = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command. 0: done; 1: it failed, stderr says why and what to do; 2: wrong use."""
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # numpy's threads turn in circles at a start, for nothing
    parser = _parser(words[0] if words else "")
    try:
        args = parser.parse_args(words)
    except SystemExit as end:  # argparse ends so after --help and on wrong use
        return end.code if isinstance(end.code, int) else 2
    if args.version:
        return _print_version()
    if args.command is None:
        parser.print_usage(sys.stderr)
        print("companion: error: a command is needed; --help lists them", file=sys.stderr)
        return 2
    try:
        return int(_module(args.command).run(args))
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except _expected_errors() as error:
        print(f"companion: error: {_error_text(error)}", file=sys.stderr)
        return 1


def _error_text(error: Exception) -> str:
    """The error's message; of the operating system's, the file first and what to look at."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path, its rights and the free space"
    if isinstance(error, OSError):
        return f"{error.strerror or error} while writing; what was written stays in the .active file beside the output"
    return str(error)


def _parser(command: str) -> argparse.ArgumentParser:
    """The parser with the full options of one command, the others by name only."""
    parser = argparse.ArgumentParser(
        prog="companion",
        description="Obstacle perception for multirotors.",
        epilog="`companion COMMAND --help` tells a command's options; `companion demo` is where to begin.",
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    for name, (_, words) in COMMANDS.items():
        if name == command:
            _module(name).add_parser(subparsers)
            subparsers.choices[name].description = words[0].upper() + words[1:] + "."
        else:
            subparsers.add_parser(name, help=words)
    return parser


def _module(command: str) -> Any:
    """The module of a command."""
    return importlib.import_module(f".{COMMANDS[command][0]}", __package__)


def _expected_errors() -> tuple[type[Exception], ...]:
    """Those whose message says what is wrong and what to do; anything else is a defect and shows its trace."""
    from drivers.base import DriverError

    from .config.loader import ConfigError

    return DriverError, ConfigError, ValueError, OSError


def _print_version() -> int:
    from .log.provenance import software

    print(software())
    return 0
