"""Measures `companion batch` on a fleet: workers against processor time, and workers killed at random.

    python -m benchmarks.batch.scaling FLEET --engine dask --flights 24
    python -m benchmarks.batch.scaling FLEET --kill 20

Starts a Dask or Ray cluster of real processes on this computer with one and with two workers. On a loaded computer the
elapsed time depends on other programs; the processor time of the flights does not, but for caches and memory: efficiency is
stated by both. Prints one JSON object per run."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def dask_cluster(workers: int) -> Iterator[str]:
    """The address of a local Dask cluster with this number of workers."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


@contextmanager
def ray_cluster(workers: int) -> Iterator[str]:
    """The address of a local Ray cluster with this number of CPUs."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": workers, "include_dashboard": False})
    try:
        yield cluster.address
    finally:
        cluster.shutdown()


def run_batch(inputs: Sequence[str], output: Path, *options: str) -> dict[str, Any]:
    """The report of `companion batch --json`."""
    command = [sys.executable, "-m", "companion", "batch", *inputs, "-o", str(output), "--json", *options]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def digest(output: Path) -> str:
    """One digest of all tables: equal for equal results."""
    total = hashlib.sha256()
    for path in sorted(output.rglob("*.parquet")):
        total.update(str(path.relative_to(output)).encode() + path.read_bytes())
    return total.hexdigest()[:16]


def scaling(inputs: Sequence[str], engine: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Runs with one and two workers."""
    for workers in (1, 2):
        output = folder / f"{engine}{workers}"
        if engine == "local":
            report = run_batch(inputs, output, "--workers", str(workers))
        else:
            with (dask_cluster if engine == "dask" else ray_cluster)(workers) as address:
                report = run_batch(inputs, output, "--engine", engine, "--address", address)
        numbers = {k: report[k] for k in ("processed", "frames", "cpu_s", "wall_s", "peak_mb", "failed")}
        yield {"engine": engine, "workers": workers, **numbers, "digest": digest(output), "load": os.getloadavg()[0]}


def killed(inputs: Sequence[str], folder: Path, kills: int, every_s: float, seed: int) -> dict[str, Any]:
    """The report of a run of the local engine whose workers are killed (-9) at random times."""
    output, stop, count = folder / "killed", threading.Event(), [0]

    def kill_some() -> None:
        rng = random.Random(seed)
        while count[0] < kills and not stop.wait(every_s * rng.uniform(0.5, 1.5)):
            workers = _workers()
            if workers:
                os.kill(rng.choice(workers), signal.SIGKILL)
                count[0] += 1

    thread = threading.Thread(target=kill_some)
    thread.start()
    begun_s = time.monotonic()
    report = run_batch(inputs, output, "--workers", "2")
    stop.set()
    thread.join()
    rows = _flight_rows(output)
    return {
        "flights": report["flights"],
        "kills": count[0],
        "restarted": report["restarted"],
        "failed": report["failed"],
        "rows": len(rows),
        "distinct": len({(r["vehicle"], r["flight"]) for r in rows}),
        "frames": sum(r["frames"] for r in rows),
        "equal_to_onboard": sum(r["equals_onboard"] is True for r in rows),
        "cpu_s": report["cpu_s"],
        "wall_s": round(time.monotonic() - begun_s, 1),
        "peak_mb": report["peak_mb"],
        "digest": digest(output),
        "unfinished": len(list((output / ".unfinished").glob("*"))),
    }


def _workers() -> list[int]:
    """Process numbers of the workers of the run: spawned processes below this one."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            command = (entry / "cmdline").read_bytes()
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            grandparent = int(Path(f"/proc/{parent}/stat").read_text().rpartition(")")[2].split()[1])
        except (FileNotFoundError, ProcessLookupError):
            continue
        if b"spawn_main" in command and grandparent == os.getpid():
            found.append(int(entry.name))
    return found


def _flight_rows(output: Path) -> list[dict[str, Any]]:
    from companion.batch.dataset import open_table

    rows: list[dict[str, Any]] = open_table(str(output), "flights").to_table().to_pylist()
    return rows


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("fleet", type=Path)
    parser.add_argument("--engine", choices=("local", "dask", "ray"), default="local")
    parser.add_argument("--flights", type=int, default=24, help="flights of the scaling run")
    parser.add_argument("--kill", type=int, default=0, metavar="N", help="instead: kill N workers during all flights")
    parser.add_argument("--every", type=float, default=20.0, metavar="S", help="mean time between two kills")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path, help="keep the results here")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.output or Path(temporary)
        if args.kill:
            print(json.dumps(killed([str(args.fleet)], folder, args.kill, args.every, args.seed)))
            return 0
        # flights with a single file
        files = sorted(
            p for p in args.fleet.rglob("*.000.mcap") if not p.with_name(p.name.replace(".000.", ".001.")).exists()
        )
        for line in scaling([str(p) for p in files[: args.flights]], args.engine, folder):
            print(json.dumps(line), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
