"""Links, anchors, commands and targets that the documentation prints exist."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Final

import pytest

from companion.cli import main
from companion.command_list import COMMANDS

from .conftest import CHECKOUT

PAGES = [CHECKOUT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
PAGES += [CHECKOUT / "clients" / name / "README.md" for name in ("cpp", "python")]
PAGES += sorted((CHECKOUT / "docs").rglob("*.md"))
USER_PAGES = [page for page in PAGES if "research" not in page.parts]
"""Pages that print today's commands. Research notes also name commands of earlier versions."""
LINKING_PAGES = [*PAGES, CHECKOUT / "CHANGELOG.md"]
SOFTWARE = [
    file
    for part in ("companion", "drivers", "clients", "configs", "examples", "packaging", "systemd")
    for file in sorted((CHECKOUT / part).rglob("*"))
    if file.is_file() and (file.suffix in (".py", ".toml", ".js", ".html", ".service", ".rules") or part == "packaging")
]
"""Files whose messages and comments name commands and pages."""
OPTIONS_OF_OTHERS: Final = {
    "--set": "benchmarks.fidelity.run",
    "--held-out": "benchmarks.fidelity.run",
    "--unknown": "examples/plan_world.py",
    "--platform": "podman build",
    "--restart": "podman run",
    "-p": "journalctl",
}
"""Options that a page names apart from their command, of other programs than `companion`."""

LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
FENCE = re.compile(r"^\s*(```|~~~)")


def name_of(page: Path) -> str:
    return str(page.relative_to(CHECKOUT))


@cache
def lines_of(page: Path) -> list[tuple[str, bool]]:
    """The lines of a page, each with whether it is code (a fenced or an indented block)."""
    lines, fenced, list_indent = [], False, 0
    for line in page.read_text(encoding="utf-8").splitlines():
        if FENCE.match(line):
            fenced = not fenced
            lines.append((line, True))
            continue
        indent = len(line) - len(line.lstrip())
        if re.match(r"\s*(\d+\.|[-*]) ", line) and not fenced:
            list_indent = indent + len(re.match(r"\s*(\d+\.|[-*]) +", line)[0].lstrip())
        elif line and indent == 0:
            list_indent = 0
        lines.append((line, fenced or indent >= list_indent + 4))
    return lines


@cache
def anchors_of(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    anchors: set[str] = set()
    for line, code in lines_of(page):
        if code or not (heading := re.match(r"#{1,6} +(.*?)\s*#*$", line)):
            continue
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading[1])
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        number = 0
        while (anchor := f"{slug}-{number}" if number else slug) in anchors:
            number += 1
        anchors.add(anchor)
    return anchors


def broken_links(page: Path) -> list[str]:
    """Relative links of a page whose file or anchor does not exist."""
    broken = []
    for line, code in lines_of(page):
        for target in [] if code else LINK.findall(re.sub(r"`[^`]*`", "", line)):
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            path = (page.parent / file).resolve() if file else page
            if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors_of(path)):
                broken.append(target)
    return broken


@pytest.mark.parametrize("page", LINKING_PAGES, ids=name_of)
def test_each_relative_link_and_anchor_exists(page: Path) -> None:
    assert broken_links(page) == []


def test_each_user_page_is_in_the_index() -> None:
    index = CHECKOUT / "docs" / "README.md"
    linked = {(index.parent / t.partition("#")[0]).resolve() for t in LINK.findall(index.read_text(encoding="utf-8"))}
    assert [name_of(p) for p in USER_PAGES if index.parent in p.parents and p != index and p not in linked] == []


def test_each_research_note_is_in_its_index() -> None:
    index = CHECKOUT / "docs" / "research" / "README.md"
    linked = {(index.parent / t.partition("#")[0]).resolve() for t in LINK.findall(index.read_text(encoding="utf-8"))}
    assert [name_of(p) for p in sorted(index.parent.glob("*.md")) if p != index and p not in linked] == []


def snippets(page: Path) -> list[str]:
    """Code lines and the code spans of the other lines."""
    found = []
    for line, code in lines_of(page):
        found += [line.strip()] if code else re.findall(r"`([^`]+)`", line)
    return found


@pytest.fixture(scope="module")
def options() -> dict[str, set[str]]:
    """The options of each command, from its help."""

    def help_of(command: str) -> str:
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.suppress(SystemExit):
            main([command, "--help"])
        return text.getvalue()

    return {name: set(re.findall(r"(?<![\w-])--?[a-z][a-z0-9-]*", help_of(name))) for name in COMMANDS}


def wrong_command(text: str, options: dict[str, set[str]]) -> str | None:
    """Why a printed `companion ...` is not one that the parser has; None where it is, or is no command."""
    text = text.removeprefix("$ ")
    match = re.match(r"(?:sudo (?:-u \S+ )?)?(?:\S*/)?companion(?: +(.*))?$", text)
    if match is None or not match[1]:
        return None
    try:
        arguments = shlex.split(match[1].replace("...", ""), comments=True)
    except ValueError:
        return f"{text}: not a command line"
    if not arguments or not re.fullmatch(r"[a-z-]+", arguments[0]) or arguments[0] in ("--version", "--help"):
        return None
    if arguments[0] not in options:
        return f"{text}: there is no command {arguments[0]}"
    given = [w.partition("=")[0] for w in arguments[1:] if w.startswith("-")]
    unknown = [option for option in given if option not in options[arguments[0]]]
    return f"{text}: {arguments[0]} has no {unknown[0]}" if unknown else None


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_printed_command_and_option_exists(page: Path, options: dict[str, set[str]]) -> None:
    assert [wrong for text in snippets(page) if (wrong := wrong_command(text, options))] == []


def options_alone(page: Path) -> set[str]:
    """The options that the text of a page names without their command, such as `--json`."""
    spans = [span for line, code in lines_of(page) if not code for span in re.findall(r"`([^`]+)`", line)]
    return {m[0] for span in spans if (m := re.match(r"--?[a-z][a-z-]*(?=[ =]|$)", span))}


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_option_named_alone_exists(page: Path, options: dict[str, set[str]]) -> None:
    assert options_alone(page) - set().union(*options.values()) - OPTIONS_OF_OTHERS.keys() == set()


def test_the_software_names_commands_and_anchors_that_exist(options: dict[str, set[str]]) -> None:
    assert len(SOFTWARE) > 300
    wrong = []
    for file in SOFTWARE:
        text = file.read_text(encoding="utf-8")
        wrong += [f"{name_of(file)}: {found}" for found in wrong_names(text, options)]
    assert wrong == []


def wrong_names(text: str, options: dict[str, set[str]]) -> list[str]:
    """Of the commands and anchors of pages that a source file names, those that do not exist. Files: test_named_files.py."""
    # a backslash: of the shell, before the mark
    commands = [name.rstrip("\\") for name in re.findall(r"`((?:sudo )?companion [^`\n{\"]*)", text)]
    wrong = [found for name in commands if (found := wrong_command(name, options))]
    for file, anchor in re.findall(r"\b(docs/[\w/-]+\.md)#([\w-]+)", text):
        if anchor not in anchors_of(CHECKOUT / file):
            wrong.append(f"{file}#{anchor}")
    return wrong


def make_targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_printed_make_target_exists(page: Path) -> None:
    printed = {m[1] for text in snippets(page) if (m := re.match(r"(?:\$ )?make ([a-z-]+)", text))}
    assert printed - make_targets() == set()


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_printed_module_and_file_exists(page: Path) -> None:
    text = "\n".join(snippets(page))
    modules = set(re.findall(r"python3? -m ((?:benchmarks|companion|core|drivers)(?:\.\w+)*)", text))
    assert [m for m in sorted(modules) if importlib.util.find_spec(m) is None] == []
    files = set(
        re.findall(r"(?<![\w/.-])(?:examples|configs|benchmarks|core|drivers|companion|tests)/[\w/.-]+\.\w+", text)
    )
    assert [f for f in sorted(files) if not (CHECKOUT / f).exists()] == []


def test_a_broken_link_and_a_wrong_command_are_found(tmp_path: Path, options: dict[str, set[str]]) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A page\n\n[a](#a-page) [b](#none) [c](none.md)\n\n    [d](code.md)\n")
    assert broken_links(page) == ["#none", "none.md"]
    page.write_text("Add `--replace` or `--repalce X`, see `-5`.\n\n    --code\n")
    lines_of.cache_clear()
    assert options_alone(page) == {"--replace", "--repalce"}
    text = "run `companion view LOG --every 2`, or `companion vew`; see docs/README.md#reference and docs/README.md#fly"
    assert wrong_names(text, options) == ["companion vew: there is no command vew", "docs/README.md#fly"]
    assert wrong_command("companion replay a.mcap --check", options) is None
    assert wrong_command("sudo companion install -c my.toml --dry-run", options) is None
    assert wrong_command("companion replay a.mcap --chekc", options) is not None
    assert wrong_command("companion fly", options) is not None
