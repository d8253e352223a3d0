"""Measures all figures of docs/research/benchmarks. Run `make bench`, or `python -m benchmarks` with --quick or --only
SECTION.

Each section runs in a process of its own, so that a section cannot affect the others."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.hardware_info import CHECKOUT, stamp
from benchmarks.pages import INDEX, SECTIONS, Section, index, page
from companion.bench.timing import ONE_THREAD

OUT = Path("docs/research/benchmarks")
QUICK_OUT = Path("bench-out")

Run = Callable[[Section, Path, bool], str]
"""run(section, out, quick) -> its Markdown. Raises SectionError."""


class SectionError(Exception):
    """A section failed; its error is on stderr."""


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    names = [s.name for s in SECTIONS]
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help=f"a rough look in a few minutes; writes to {QUICK_OUT}")
    parser.add_argument("--only", action="append", choices=names, help="this section; may be given again")
    parser.add_argument("--out", type=Path, help=f"folder of the pages and pictures ({OUT})")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)  # run one section here, its Markdown goes there
    args = parser.parse_args(arguments)
    args.only = args.only or names
    args.out = args.out or (QUICK_OUT if args.quick else OUT)
    return args


def main(arguments: list[str] | None = None, run: Run | None = None) -> int:
    """0: every section wrote its page; 1: a section failed, with the cause on stderr."""
    args = parse(arguments)
    if args.child is not None:
        module = importlib.import_module(next(s for s in SECTIONS if s.name == args.only[0]).module)
        args.child.write_text(module.section(args.out, args.quick))
        return 0
    args.out.mkdir(parents=True, exist_ok=True)
    failed = []
    for section in SECTIONS:
        if section.name not in args.only:
            continue
        _say(f"{section.name} ...")
        try:
            begun = time.monotonic()
            text = (run or run_apart)(section, args.out, args.quick)
        except SectionError as error:
            _say(f"{section.name}: {error}; its page stays as it was")
            failed.append(section.name)
            continue
        minutes = (time.monotonic() - begun) / 60.0
        words = ["--only", section.name, *(["--quick"] if args.quick else [])]
        header = stamp(words, minutes=minutes, quick=args.quick)
        (args.out / f"{section.name}.md").write_text(page(section, text, header))
        _say(f"{section.name}: {args.out / section.name}.md")
    (args.out / INDEX).write_text(index(args.out))
    if failed:
        _say(f"error: no figures of {', '.join(failed)}; the reason stands above")
    return 1 if failed else 0


def run_apart(section: Section, out: Path, quick: bool) -> str:
    """Runs a section in a process with one thread in every library; its progress goes to our stderr."""
    with tempfile.TemporaryDirectory() as folder:
        text = Path(folder) / "section.md"
        command = [sys.executable, "-m", "benchmarks", "--only", section.name, "--out", str(out.resolve())]
        command += ["--child", str(text), *(["--quick"] if quick else [])]
        done = subprocess.run(command, env={**os.environ, **ONE_THREAD}, cwd=CHECKOUT, check=False)
        if done.returncode < 0:
            raise SectionError(f"ended by signal {-done.returncode}")
        if done.returncode or not text.is_file():
            raise SectionError(f"failed with status {done.returncode}")
        return text.read_text()


def _say(text: str) -> None:
    print(f"benchmarks: {text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
