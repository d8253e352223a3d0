"""What a frame would take on a Raspberry Pi 5, from counted instructions: `python -m benchmarks.speed.board_budget`.

An ESTIMATE, measured on no board. The views of `companion bench` (640x480) run under valgrind, compiled for a plain
64-bit processor, whose vectors are 128 bits wide as the board's are. Counted are the instructions of a run with some
frames and of one with more; the difference is that of the frames alone. A Cortex-A76 at 2.4 GHz is assumed to finish
between 1 and 2 of them in a cycle. Needs valgrind."""

from __future__ import annotations

import argparse
import os
import pickle
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from companion.bench.bench import PITCH_DEG, ROLL_DEG, SIZE, VIEWS
from companion.bench.frames import Flight, render_sequence
from core.extractor import Extractor

GHZ = 2.4
IPC = (1.0, 2.0)
"""Instructions a cycle: the pessimist's and the optimist's."""
HZ = 12.0
FEW = 4
"""Frames of the shorter run: kernels are loaded, buffers have grown."""
PLAIN = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "OPENBLAS_NUM_THREADS": "1"}
CHILD = "import sys; from benchmarks.speed.board_budget import fly; fly(sys.argv[1], int(sys.argv[2]))"
REFERENCES = re.compile(r"I +refs: +([\d,]+)")


def fly(file: str, frames: int) -> None:
    """Extracts a number of frames of a stored sequence."""
    with open(file, "rb") as stream:
        sequence = pickle.load(stream)
    flight = Flight(Extractor(), sequence)
    for _ in range(frames):
        flight.frame()


def instructions(file: Path, frames: int, environment: dict[str, str]) -> int:
    """Instructions of a whole process that extracts a number of frames. Raises RuntimeError with the last line of
    valgrind."""
    command = [
        "valgrind",
        "--tool=cachegrind",
        "--cache-sim=no",
        "--smc-check=all-non-file",
        "--cachegrind-out-file=/dev/null",
        sys.executable,
        "-c",
        CHILD,
        str(file),
        str(frames),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    found = REFERENCES.search(done.stderr)
    if done.returncode != 0 or found is None:
        raise RuntimeError("\n".join(done.stderr.splitlines()[-5:]))
    return int(found[1].replace(",", ""))


def main() -> int:
    """0: estimated; 1: no valgrind."""
    parser = argparse.ArgumentParser(description="a frame on a Raspberry Pi 5, estimated from instructions")
    parser.add_argument("--frames", type=int, default=8, help="counted beyond the first few (8)")
    parser.add_argument("--cache", type=Path, help="of the kernels for a plain processor; else they are compiled anew")
    args = parser.parse_args()
    if shutil.which("valgrind") is None:
        print("no valgrind: sudo apt-get install valgrind", file=sys.stderr)
        return 1
    print(f"ESTIMATE for a Raspberry Pi 5 ({GHZ:g} GHz, {IPC[0]:g}..{IPC[1]:g} instructions a cycle), {HZ:g} Hz")
    with tempfile.TemporaryDirectory() as folder:
        cache = args.cache or Path(folder) / "kernels"
        environment = {**os.environ, **PLAIN, "NUMBA_CACHE_DIR": str(cache)}
        for name, _ in VIEWS:
            file = Path(folder) / name
            file.write_bytes(pickle.dumps(render_sequence(name, name, SIZE, roll_deg=ROLL_DEG, pitch_deg=PITCH_DEG)))
            subprocess.run([sys.executable, "-c", CHILD, str(file), str(FEW)], env=environment, check=True)
            few = instructions(file, FEW, environment)
            each = (instructions(file, FEW + args.frames, environment) - few) / args.frames
            slow, fast = (each / ipc / GHZ / 1e6 for ipc in IPC)
            share = [100.0 * ms * HZ / 1000.0 for ms in (fast, slow)]
            print(
                f"{name:8s} {each / 1e6:6.1f} million instructions a frame: {fast:.0f}..{slow:.0f} ms, "
                f"{share[0]:.0f}..{share[1]:.0f} % of one core"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
