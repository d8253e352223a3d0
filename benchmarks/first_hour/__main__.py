"""Types the commands of each persona, and writes what was printed and how long it took.

    python -m benchmarks.first_hour -o DIR [--only NAME] [--warm] [--page docs/research/first-hour.md]

DIR/NAME.txt holds what was on the screen. Without --warm the newcomer compiles all kernels. The state folder, the home
folder and the run folder of the service are in DIR."""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.hardware_info import CHECKOUT, commit
from companion.bench.host_info import host_info

from .material import make
from .personas import PERSONAS, Persona
from .steps import Done, Session

BIN = Path(sys.executable).parent


def main() -> int:
    """1: a step differed from what was expected."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.first_hour", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="a new folder")
    parser.add_argument(
        "--only", action="append", choices=[p.name for p in PERSONAS], help="this persona; may be repeated"
    )
    parser.add_argument("--warm", action="store_true", help="use the compiled kernels of this computer for all")
    parser.add_argument("--page", type=Path, help="write the table into this page, after its marker line")
    args = parser.parse_args()
    args.out.mkdir(parents=True)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job of a script inherits "ignored"
    material = args.out.absolute() / "material"
    personas = [p for p in PERSONAS if not args.only or p.name in args.only]
    if any("MATERIAL" in step.text for p in personas for step in p.steps):
        _make_material(args.out.absolute(), material)
    rows, failed = [], 0
    for persona in personas:
        done = _play(persona, args.out.absolute(), material, args.warm)
        problems = [d for d in done if d.problem]
        failed += len(problems)
        (args.out / f"{persona.name.replace(' ', '-')}.txt").write_text(_screen(persona, done))
        rows.append(_row(persona, done, args.warm))
        print(rows[-1], flush=True)
        for d in problems:
            print(f"  ! {d.text}: {d.problem}", flush=True)
    if args.page is not None:
        _write_page(args.page, rows)
    return 1 if failed else 0


def _play(persona: Persona, out: Path, material: Path, warm: bool) -> list[Done]:
    folder = out / persona.name.replace(" ", "-")
    folder.mkdir()
    session = Session(folder, _environment(folder, cold=persona.cold and not warm))
    done = []
    try:
        for step in persona.steps:
            typed = step.text.replace("CHECKOUT", str(CHECKOUT)).replace("MATERIAL", str(material))
            stopped = step.stop.replace("CHECKOUT", str(CHECKOUT))
            result = session.run(type(step)(typed, step.status, step.shows, step.starts, stopped, step.wait_s))
            if result is not None:
                done.append(result)
    finally:
        session.close()
    return done


def _environment(folder: Path, cold: bool) -> dict[str, str]:
    """That of a user whose home is the folder, with `companion` in PATH."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("XDG_", "ROS_"))}
    environment |= {"HOME": str(folder), "PATH": f"{BIN}:{os.environ['PATH']}", "PYTHONUNBUFFERED": "1"}
    if cold:
        environment["NUMBA_CACHE_DIR"] = str(folder / "kernels")
    return environment


def _make_material(out: Path, material: Path) -> None:
    """A demo of 12 s, and the recordings from it."""
    folder = out / "material-demo"
    folder.mkdir()
    subprocess.run(
        [BIN / "companion", "demo", "-o", "demo-out", "--seconds", "12"],
        cwd=folder,
        env=_environment(folder, cold=False),
        check=True,
        stdout=subprocess.DEVNULL,
    )
    make(folder / "demo-out" / "prisms.mcap", material)
    shutil.rmtree(folder)


def _screen(persona: Persona, done: list[Done]) -> str:
    """What was typed and printed."""
    parts = [f"{persona.name}: {persona.who}\n({persona.pages})\n"]
    for d in done:
        end = f"[status {d.status}, {d.wall_s:.1f} s, processor {d.cpu_s:.1f} s]"
        parts.append(f"$ {d.text}\n{d.output.rstrip()}\n{end}{'  PROBLEM: ' + d.problem if d.problem else ''}\n")
    return "\n".join(parts)


def _row(persona: Persona, done: list[Done], warm: bool) -> str:
    wall_s, cpu_s = sum(d.wall_s for d in done), sum(d.cpu_s for d in done)
    good = sum(not d.problem for d in done)
    kernels = "compiled first" if persona.cold and not warm else "compiled before"
    return (
        f"| {persona.name} | {persona.who} | {good} of {len(done)} | {kernels} | {wall_s / 60:.1f} | {cpu_s / 60:.1f} | "
        f"{persona.pages} |"
    )


def _write_page(page: Path, rows: list[str]) -> None:
    """Replaces what follows the marker of the table."""
    marker = "<!-- python -m benchmarks.first_hour -->"
    before = page.read_text().split(marker)[0]
    head = "| persona | who | steps as expected | kernels | wall, min | processor, min | pages |\n|---|---|---|---|---|---|---|"
    page.write_text(
        f"{before}{marker}\n\n{datetime.now(UTC):%Y-%m-%d}, commit {commit(CHECKOUT)}, {host_info().text()}; load average {os.getloadavg()[2]:.1f}\n\n{head}\n"
        + "\n".join(rows)
        + "\n"
    )


if __name__ == "__main__":
    sys.exit(main())
