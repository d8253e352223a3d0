"""The pages of docs/research/benchmarks: one page for each section, and an index of the pages that exist."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.hardware_info import Stamp

INDEX: Final = "README.md"
_MEASURED: Final = "Measured on "


@dataclass(frozen=True, slots=True)
class Section:
    """name: of the page's file and of `--only`; module: has `section(out, quick) -> str`, the Markdown of the page."""

    name: str
    title: str
    question: str
    module: str


SECTIONS: Final = (
    Section(
        "speed",
        "Speed",
        "How long does a frame take, where does the time go, what makes it longer?",
        "benchmarks.speed.section",
    ),
    Section(
        "fidelity",
        "Fidelity",
        "Which obstacles are missing in the model, and which does the model add?",
        "benchmarks.fidelity.section",
    ),
    Section(
        "peers",
        "Beside others",
        "How do a grid, an octree and a plane extractor compare?",
        "benchmarks.peers.section",
    ),
    Section("paper", "The paper's figures", "Which of the paper's claims hold?", "benchmarks.paper.section"),
    Section(
        "world",
        "The merged world",
        "Is the world of a flight closed, correct and small, and how much time does it take?",
        "benchmarks.world.section",
    ),
    Section("recordings", "Recordings", "What are the models of recorded images?", "benchmarks.fidelity.recordings"),
    Section("memory", "Memory", "Does memory grow over 100 000 frames?", "benchmarks.speed.section_memory"),
)
"""In the order of the index."""

FRAME: Final = """# Benchmarks

What the algorithm reaches, and what it does not, measured by

    make bench

which makes its own environment and rewrites these pages; `make bench ARGS='--only speed'` one of them, `ARGS=--quick` a rough look at all in a few minutes (into `bench-out`). Each page states date, commit, machine, versions and command. Figures are of simulated scenes with known truth unless the page states otherwise. Do not edit these pages by hand.

Why a goal is missed, what was tried and what would reach it: `docs/research/attempts.md`, for time `docs/research/speed.md`.

On a companion computer, without this checkout, `companion bench` measures its speed.

How to read the times: one thread on one core, after everything is compiled, medians of many frames that differ in their noise. *Processor* is processor time; *wall* is elapsed time, which contains other work on the machine. To compare two machines, or two days, compare the ratios to the reference workload of the same run.

| page | question | measured |
|---|---|---|
"""


def page(section: Section, text: str, stamp: Stamp) -> str:
    """A whole page. text: Markdown with headings from level 2; the first paragraph before them is its summary."""
    return f"# {section.title}\n\n{stamp.markdown()}\n{text.strip()}\n"


def index(folder: Path) -> str:
    """The index of the pages in a folder, with their summaries."""
    rows, summaries = [], []
    for section in SECTIONS:
        path = folder / f"{section.name}.md"
        if not path.is_file():
            rows.append(f"| {section.title} | {section.question} | not yet |")
            continue
        text = path.read_text()
        rows.append(f"| [{section.title}]({path.name}) | {section.question} | {measured(text)} |")
        if summary := summary_of(text):
            summaries.append(f"## {section.title}\n\n{summary}\n")
    return FRAME + "\n".join(rows) + "\n" + "".join(f"\n{s}" for s in summaries)


def measured(text: str) -> str:
    """When and at which commit a page was measured, of its first lines."""
    line = next((x for x in text.splitlines() if x.startswith(_MEASURED)), "")
    return line.removeprefix(_MEASURED).removesuffix(".")


def summary_of(text: str) -> str:
    """The first paragraph after the stamp of a page, when one stands before its first heading of level 2."""
    head = text.split("\n## ", 1)[0]
    _, _, after = head.partition("\n- versions: ")
    return after.partition("\n")[2].strip().split("\n\n", 1)[0]
