"""What every page of figures begins with: when, at which commit, by which command, on what machine, with what."""

from __future__ import annotations

import shlex
import subprocess
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from companion.bench.host_info import host_info, versions

CHECKOUT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamp:
    """commit: short, marked when the sources differ from it; minutes: duration of the run."""

    date: str
    commit: str
    command: str
    host_info: str
    versions: str
    minutes: float
    quick: bool

    def markdown(self) -> str:
        """A first line with date and commit, then computer, versions and command."""
        rough = "; a quick run, its figures are rough" if self.quick else ""
        took = f"{self.minutes:.0f} min" if self.minutes >= 1.0 else "under a minute"
        return (
            f"Measured on {self.date} at commit {self.commit}{rough}.\n\n"
            f"- command: `{self.command}` ({took})\n- machine: {self.host_info}\n- versions: {self.versions}\n"
        )


def stamp(arguments: list[str], *, minutes: float, quick: bool) -> Stamp:
    """Of a run that ends now, with the arguments that repeat it."""
    return Stamp(
        date=datetime.now(UTC).strftime("%Y-%m-%d"),
        commit=commit(CHECKOUT),
        command=shlex.join(["python", "-m", "benchmarks", *arguments]),
        host_info=host_info().text(),
        versions=", ".join(f"{name} {version}" for name, version in versions().items()),
        minutes=minutes,
        quick=quick,
    )


def commit(checkout: Path) -> str:
    """The short name of the checkout's commit, and whether the sources that are measured differ from it."""
    head = _git(checkout, "rev-parse", "--short", "HEAD")
    if not head:
        return "unknown (no git checkout)"
    changed = _git(checkout, "status", "--porcelain", "--", "core", "drivers", "companion", "benchmarks")
    return f"{head} with changes that are not committed" if changed else head


def _git(checkout: Path, *words: str) -> str:
    try:
        done = subprocess.run(["git", "-C", str(checkout), *words], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()
