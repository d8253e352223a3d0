"""Time of each stage of the extractor: medians over many frames of one thread, after warm-up.

Run `python -m benchmarks.speed.stages`, or with --runs, --width, --ke. The frames are our simulator's, 640x480 uint16
with the noise and the faults of a good stereo camera: one structured (street), one of foliage (trees), each level and
tilted. Times are the processor's; other work on the machine counts little."""

from __future__ import annotations

import argparse
import sys

from benchmarks.speed.tables import stage_table
from companion.bench.frames import measure, render_sequence
from companion.bench.host_info import host_info, versions
from companion.bench.timing import one_core
from core.extractor import Extractor
from core.params import Params

FRAMES = (
    ("street, level", "street", 0.0, 0.0),
    ("street, tilted", "street", 10.0, -10.0),
    ("trees, level", "trees", 0.0, 0.0),
    ("trees, tilted", "trees", 10.0, -10.0),
)
"""(what the column is called, scene, roll and pitch in degrees)."""


def main(arguments: list[str] | None = None) -> int:
    """Prints the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.speed.stages", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--runs", type=int, default=100, help="frames of each kind (100)")
    parser.add_argument("--width", type=int, default=640, help="of the image, 4:3 (640)")
    parser.add_argument("--ke", type=float, default=0.0015, help="noise, sigma_Z = ke * Z^2 (0.0015)")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(arguments)
    if args.runs < 3:
        parser.error("--runs: at least 3")
    size = (args.width, args.width * 3 // 4)
    columns = []
    with one_core():
        extractor = Extractor(Params())
        for name, scene, roll, pitch in FRAMES:
            print(f"{name} ...", file=sys.stderr)
            shot = render_sequence(name, scene, size, roll_deg=roll, pitch_deg=pitch, ke_per_m=args.ke, seed=args.seed)
            columns.append(measure(shot, extractor, args.runs, watched=args.runs))
    software = ", ".join(f"{name} {version}" for name, version in versions().items())
    print(f"{host_info().text()}; {software}; {size[0]}x{size[1]}, ke {args.ke:g}, one thread,")
    print(f"medians of {args.runs} runs after warm-up\n")
    print(stage_table(columns), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
