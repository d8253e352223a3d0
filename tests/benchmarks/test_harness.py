"""`make bench`: sections become pages, failures and missing sections are reported, and the index lists the pages."""

from __future__ import annotations

import importlib
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

import benchmarks.__main__ as harness
from benchmarks.__main__ import SectionError, main, parse, run_apart
from benchmarks.hardware_info import CHECKOUT, Stamp, commit
from benchmarks.pages import SECTIONS, Section, index, measured, page, summary_of
from benchmarks.peers.install import install, peers

MADE = "No figure here is real.\n\nWhat words mean.\n\n## A table\n\n| a |\n|---|\n| 1 |\n"
STAMP = Stamp(
    date="2026-11-21",
    commit="abc1234",
    command="python -m benchmarks",
    host_info="a processor, 2 cores",
    versions="python 3.11, numpy 2",
    minutes=12.2,
    quick=False,
)


def test_a_page_states_date_commit_and_command_before_its_text() -> None:
    text = page(SECTIONS[0], MADE, STAMP)
    assert text.startswith("# Speed\n\nMeasured on 2026-11-21 at commit abc1234.\n\n- command: `python -m benchmarks`")
    assert "- machine: a processor, 2 cores\n- versions: python 3.11, numpy 2\n" in text
    assert text.endswith(MADE)
    assert measured(text) == "2026-11-21 at commit abc1234"
    assert summary_of(text) == "No figure here is real."
    assert summary_of(page(SECTIONS[0], "## A table\n", STAMP)) == ""


def test_every_section_gets_its_page(tmp_path: Path) -> None:
    asked = []

    def run(section: Section, out: Path, quick: bool) -> str:
        asked.append((section.name, out, quick))
        return MADE

    assert main(["--quick", "--out", str(tmp_path)], run) == 0
    names = [s.name for s in SECTIONS]
    assert asked == [(name, tmp_path, True) for name in names]
    assert {p.name for p in tmp_path.iterdir()} == {"README.md", *(f"{name}.md" for name in names)}
    assert "a quick run, its figures are rough" in (tmp_path / "speed.md").read_text()


def test_a_section_that_fails_keeps_its_old_page_and_the_others_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(section: Section, out: Path, quick: bool) -> str:
        if section.name == "peers":
            raise SectionError("ended by signal 11")
        return MADE

    (tmp_path / "peers.md").write_text("as it was")
    assert main(["--out", str(tmp_path)], run) == 1
    assert (tmp_path / "peers.md").read_text() == "as it was"
    assert (tmp_path / "memory.md").is_file()
    output = capsys.readouterr().err
    assert "peers: ended by signal 11; its page stays as it was" in output
    assert "error: no figures of peers" in output


@pytest.mark.parametrize("section", SECTIONS, ids=lambda s: s.name)
def test_each_section_has_its_module(section: Section) -> None:
    assert callable(importlib.import_module(section.module).section)


def test_the_index_links_pages_and_names_those_that_are_missing(tmp_path: Path) -> None:
    (tmp_path / "speed.md").write_text(page(SECTIONS[0], MADE, STAMP))
    text = index(tmp_path)
    assert f"| [Speed](speed.md) | {SECTIONS[0].question} | 2026-11-21 at commit abc1234 |" in text
    assert "## Speed\n\nNo figure here is real.\n" in text
    for section in SECTIONS[1:]:
        assert f"| {section.title} | {section.question} | not yet |" in text


def test_quick_figures_do_not_land_in_the_documentation() -> None:
    assert parse(["--quick"]).out == Path("bench-out")
    assert parse([]).out == Path("docs/research/benchmarks")
    with pytest.raises(SystemExit):
        parse(["--only", "nothing"])


def test_a_section_runs_in_a_process_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its Markdown is returned; a signal or an exit status is reported."""
    seen = {}

    def child(status: int) -> None:
        def call(command: Sequence[str], **kwargs: object) -> subprocess.CompletedProcess[str]:
            seen["environment"] = kwargs["env"]
            if status == 0:
                Path(command[command.index("--child") + 1]).write_text(MADE)
            return subprocess.CompletedProcess(command, status)

        monkeypatch.setattr(harness.subprocess, "run", call)

    child(0)
    assert run_apart(SECTIONS[0], tmp_path, True) == MADE
    assert seen["environment"]["OMP_NUM_THREADS"] == "1"
    child(-11)
    with pytest.raises(SectionError, match="signal 11"):
        run_apart(SECTIONS[0], tmp_path, True)
    child(1)
    with pytest.raises(SectionError, match="status 1"):
        run_apart(SECTIONS[0], tmp_path, True)


def test_the_commit_is_reported_with_what_differs_from_it(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        who = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
        subprocess.run(["git", "-C", str(tmp_path), *who, *arguments], check=True, capture_output=True)

    assert commit(tmp_path) == "unknown (no git checkout)"
    git("init")
    (tmp_path / "core").mkdir()
    file = tmp_path / "core" / "a.py"
    file.write_text("a = 1\n")
    git("add", "-A")
    git("commit", "-m", "one")
    clean = commit(tmp_path)
    assert len(clean) >= 7
    assert " " not in clean
    file.write_text("a = 2\n")
    assert commit(tmp_path) == f"{clean} with changes that are not committed"


def test_peers_are_installed_one_by_one_and_one_without_a_wheel_is_left_out() -> None:
    called: list[Sequence[str]] = []

    def command(arguments: Sequence[str]) -> int:
        called.append(arguments)
        return 1 if arguments[-1].startswith("b") else 0

    constraints = CHECKOUT / ".ci" / "constraints.txt"
    assert install(["a>=1", "b>=1", "c"], [constraints], command) == ["b>=1"]
    assert [arguments[-1] for arguments in called] == ["a>=1", "b>=1", "c"]
    assert all("--only-binary" in arguments and str(constraints) in arguments for arguments in called)


def test_the_peers_of_the_project_are_named_and_pinned() -> None:
    pinned = (CHECKOUT / ".ci" / "constraints-peers.txt").read_text()
    named = [r.split(">")[0] for r in peers(CHECKOUT / "pyproject.toml")]
    assert named
    assert all(f"\n{name}==" in pinned for name in named)


def test_the_index_names_each_command_that_exists() -> None:
    folder = CHECKOUT / "benchmarks"
    named = set(re.findall(r"benchmarks(?:\.\w+)+", (folder / "README.md").read_text()))
    runnable = {
        ".".join(path.relative_to(CHECKOUT).with_suffix("").parts).removesuffix(".__main__")
        for path in folder.rglob("*.py")
        if '__name__ == "__main__"' in path.read_text()
    }
    assert named == runnable - {"benchmarks"}
