"""`companion batch`: processes many flights again, and compares two results."""

from __future__ import annotations

import argparse
import fcntl
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from ..argument_types import number_in
from ..common_options import add_config
from ..config.loader import config_text, load_config
from ..console import counted, print_json, progress, warn
from ..kernels.warmup import ensure_compiled
from ..log.provenance import software
from ..usage_error import UsageError, given_option
from .dataset import begin_run, delete_unfinished, finished
from .engines import Engine, EngineName
from .flights import Flight, find_flights
from .frame_rows import text_hash
from .jobs import BatchOptions, Failure, FlightTask, Process
from .local_engine import LocalEngine
from .parquet_table import arrow_module
from .report import BatchReport, print_failures, print_report
from .storage import is_url, utf8_name

LOCK_FILE: Final = ".lock"
_OF_A_RUN: Final = ("config", "engine", "address", "workers", "vehicle", "near", "planes", "logs")
"""Options without an effect on a comparison."""
_NEAR_M: Final = 2.0


def make_engine(name: EngineName, address: str | None, workers: int | None, process: Process) -> Engine:
    """The engine. Raises UsageError for an option that it does not have, DeviceNotFound without its library."""
    if name is EngineName.LOCAL:
        if address is not None:
            raise UsageError("--address: the local engine has none; name --engine dask or ray")
        return LocalEngine(workers or len(os.sched_getaffinity(0)), process)
    if workers is not None:
        raise UsageError(f"--workers: the cluster has its number of workers; leave it out with --engine {name}")
    if address is None:
        example = "tcp://HOST:8786" if name is EngineName.DASK else "auto, or ray://HOST:10001"
        raise UsageError(f"--engine {name} needs --address of the cluster, such as {example}")
    if name is EngineName.DASK:
        from .dask_engine import DaskEngine

        return DaskEngine(address, process)
    from .ray_engine import RayEngine

    return RayEngine(address, process)


def batch(flights: Sequence[Flight], output: str, options: BatchOptions, engine: Engine) -> BatchReport:
    """Processes the flights whose results are not present. Raises ValueError for an output of other options."""
    begun_s = time.monotonic()
    report = BatchReport(flights=len(flights))
    with _locked(output):
        begin_run(output, _run_of(options))
        present = finished(output, flights)
        tasks = [FlightTask(f, output, options, software()) for f in flights if f not in present]
        for flight, unread_files in present.items():
            report.add_present(flight, unread_files)
        with progress("batch") as on_progress:
            ended = len(present)
            try:
                for number, done in enumerate(engine.run(tasks), start=1):
                    report.add(done)
                    ended += not isinstance(done.result, Failure)  # which the next run processes again
                    on_progress(number / len(tasks))
            except KeyboardInterrupt as interrupt:
                done_of = f"processed {ended} of {counted(len(flights), 'flight')}"
                raise KeyboardInterrupt(f"interrupted: {done_of}; the same command continues") from interrupt
        delete_unfinished(output)
    report.wall_s = time.monotonic() - begun_s
    return report


def _run_of(options: BatchOptions) -> dict[str, Any]:
    """What the results depend on."""
    config = options.config
    return {
        "software": software(),
        "config_hash": None if config is None else text_hash(config_text(config)),
        "near_m": options.near_m,
        "planes": options.planes,
        "logs": options.logs,
    }


@contextmanager
def _locked(output: str) -> Iterator[None]:
    """Raises ValueError while another process writes to a local output."""
    if is_url(output):
        yield
        return
    Path(output).mkdir(parents=True, exist_ok=True)
    with (Path(output) / LOCK_FILE).open("w") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(f"{output}: another `companion batch` writes to it; wait for its end") from error
        except OSError:
            pass  # some network file systems have no locks
        yield


def add_parser(subparsers: Any) -> None:
    """The command line of `companion batch`."""
    parser = subparsers.add_parser("batch")
    parser.add_argument(
        "inputs", nargs="*", metavar="INPUT", help="logs: files, directories, patterns, s3:// addresses"
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="directory or address for the tables, or for the report of --compare",
    )
    add_config(parser, "use this configuration instead of the recorded ones")
    parser.add_argument(
        "--compare",
        nargs=2,
        metavar=("OUT_A", "OUT_B"),
        help="compare two results of `companion batch` and write a report to OUT",
    )
    parser.add_argument("--no-pictures", action="store_true", help="with --compare: draw no pictures")
    parser.add_argument(
        "--engine",
        choices=[str(name) for name in EngineName],
        help="where the flights are processed: on this computer or on a cluster (default: local)",
    )
    parser.add_argument("--address", metavar="ADDRESS", help="address of the Dask scheduler or of the Ray cluster")
    parser.add_argument(
        "--workers",
        type=number_in(int, 1, 1024),
        metavar="N",
        help="processes on this computer (default: one per core)",
    )
    parser.add_argument(
        "--vehicle", metavar="NAME", help="name of the vehicle of all logs (default: the name of each log's directory)"
    )
    parser.add_argument(
        "--near",
        type=number_in(float, 0.0, 1000.0),
        metavar="M",
        help=f"planes nearer than this are near passes (default: {_NEAR_M:g} m)",
    )
    parser.add_argument("--planes", action="store_true", help="also write the table of all planes")
    parser.add_argument("--logs", action="store_true", help="also write the replayed logs, without depth images")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """0: all logs have a result; 1: a log has none. Damaged logs are part of the result. Raises UsageError."""
    if args.compare is not None:
        return _compare(args)
    if not args.inputs:
        raise UsageError("no input is given; name files, folders or patterns of logs")
    if "" in args.inputs:
        raise UsageError("an empty path is given as an input; is a variable of the shell not set?")
    if args.no_pictures:
        raise UsageError("--no-pictures needs --compare OUT_A OUT_B")
    from .task import run_task  # late: it imports the kernels

    engine_name = EngineName(args.engine or EngineName.LOCAL)
    engine = make_engine(engine_name, args.address, args.workers, run_task)
    arrow_module()
    config = load_config(args.config) if args.config is not None else None
    options = BatchOptions(
        config=config, near_m=_NEAR_M if args.near is None else args.near, planes=args.planes, logs=args.logs
    )
    output = utf8_name(args.output if is_url(args.output) else os.path.realpath(args.output))
    unread_inputs: list[str] = []
    flights = find_flights(args.inputs, args.vehicle, output, unread_inputs.append)
    for text in unread_inputs:
        warn(text)
    for flight in flights:
        if parts := ", ".join(map(str, flight.missing_parts)):
            warn(
                f"{flight}: part {parts} is missing between its files: deleted for the budget (as those of a disarmed vehicle), or "
                "not copied; the results lack its time"
            )
    if engine_name is EngineName.LOCAL:
        tracks = options.config is not None and options.config.tracking.enabled  # otherwise `run_task` compiles them
        ensure_compiled("extractor", *(("tracking",) if tracks else ()))
    report = batch(flights, output, options, engine)
    report.unread_inputs = len(unread_inputs)
    if args.json:
        print_json(report.as_json(args.output))
    else:
        print_report(report, args.output)
    print_failures(report)
    return 1 if report.failed or report.unread_files or report.unread_inputs else 0


def _compare(args: argparse.Namespace) -> int:
    if args.inputs:
        raise UsageError(f"--compare: takes two results and no logs; leave out {args.inputs[0]}")
    if option := given_option(args, _OF_A_RUN):
        raise UsageError(f"--compare: processes no logs; leave out {option}")
    if is_url(args.output):
        raise UsageError(f"{args.output}: the report of a comparison is written into a local folder; name one with -o")
    arrow_module()
    from .comparison_report import run_comparison

    a, b = (text if is_url(text) else os.path.realpath(text) for text in args.compare)
    return run_comparison(a, b, Path(args.output), not args.no_pictures, args.json)
