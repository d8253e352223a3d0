"""The command `companion`. Only the module of the given command is imported."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "run": ("live.run", "run the live service: cameras and autopilot in, obstacles out"),
    "status": ("live.status", "show the state of the running service"),
    "simulate-autopilot": (
        "autopilot.simulate_autopilot",
        "simulate an autopilot, for `run` without hardware",
    ),
    "doctor": ("doctor.doctor", "check all parts before a flight and name the remedies"),
    "keys": ("streams.keys", "make keys for the network streams and for MAVLink signatures"),
    "demo": ("demo.demo", "fly a simulated scene without hardware and draw the result"),
    "import": ("importers.command", "convert depth images or a ROS 2 recording into a log"),
    "replay": ("replay.replay", "run a log through the pipeline; optionally compare with the recorded result"),
    "batch": ("batch.command", "process many flights again into tables, and compare two results"),
    "find": ("batch.find", "cut the times that fulfil a condition out of the logs of a fleet"),
    "view": (
        "viewer.view",
        "draw a log as pictures and a 3-D page; --live: follow the running service",
    ),
    "ros2": ("ros2.command", "publish the results of the running service to ROS 2 (rmw_zenoh)"),
    "export": ("export.command", "write the results of a log as CSV, NPZ, Parquet or glTF"),
    "info": ("log.info", "show the content of a log: topics, rates, gaps, damage"),
    "recover": ("log.recover", "repair a damaged or unfinished log"),
    "setup": ("setup.setup", "find cameras and autopilot, and write a configuration"),
    "configs": ("install.configs", "list the shipped configurations, or copy one"),
    "check-config": ("config.check_config", "check a configuration file"),
    "install": ("install.install", "install the service on this computer (needs root)"),
    "uninstall": ("install.uninstall", "remove the service from this computer (needs root)"),
    "warmup": ("kernels.warmup", "compile all kernels"),
    "bench": ("bench.bench", "measure the frame rate that this computer reaches"),
}
"""Command -> its module in this package (with add_parser and run) and its help text."""

_INTERRUPTED: Final = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command. 0: success; 1: failure, with cause and remedy on stderr; 2: wrong usage."""
    words = list(sys.argv[1:] if argv is None else argv)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # idle threads of numpy's OpenBLAS would spin during the start
    parser = _parser(words[0] if words else "")
    try:
        args = parser.parse_args(words)
    except SystemExit as end:  # argparse exits this way after --help and on wrong usage
        return end.code if isinstance(end.code, int) else 2
    if args.version:
        return _print_version()
    if args.command is None:
        parser.print_usage(sys.stderr)
        print("companion: error: no command is given; `companion --help` lists the commands", file=sys.stderr)
        return 2
    try:
        return int(_module(args.command).run(args))
    except BrokenPipeError:  # the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except _expected_errors() as error:
        print(f"companion: error: {_error_text(error, getattr(args, 'output', None))}", file=sys.stderr)
        return 1


def _error_text(error: Exception, output: Path | None) -> str:
    """The message of an error. For errors of the operating system: the file and what to check. output: of the command."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check the path, its permissions and the free space"
    if isinstance(error, OSError):
        return (
            f"{'' if output is None else f'{output}: '}{error.strerror or error} while writing; check the free space. A log "
            "that was begun is kept as FILE.active (`companion recover` reads it)"
        )
    return str(error)


def _parser(command: str) -> argparse.ArgumentParser:
    """The parser with the options of one command and the names of the others."""
    parser = argparse.ArgumentParser(
        prog="companion",
        description="Obstacle perception for multirotors.",
        epilog="`companion COMMAND --help` lists the options of a command; start with `companion demo`.",
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
    """Errors with a message for the user. Any other exception is a defect and prints its traceback."""
    from drivers.base import DriverError

    from .config.loader import ConfigError
    from .kernels.child_process import WarmupError

    return DriverError, ConfigError, WarmupError, ValueError, OSError


def _print_version() -> int:
    from .log.provenance import software

    print(software())
    return 0
