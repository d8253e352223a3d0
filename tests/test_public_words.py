"""Retired words of the vocabulary do not appear in text that users read.

Checked: user documentation (not research), READMEs, comments of the shipped configurations, documentation of parameters,
texts of codes, help of every command, and all messages in the source (errors, diagnostics, log lines, STATUSTEXT)."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion
import drivers
from companion.cli import parser_of
from companion.command_list import COMMANDS
from companion.config.sections import SECTIONS, fields_of
from companion.diagnostic import DiagnosticCode
from companion.pipeline.latency import LatencyStage
from companion.pipeline.sync import DropCause
from core.types import InvalidCause
from drivers.mavlink.anomalies import LinkAnomaly

ROOT = Path(__file__).resolve().parents[1]

RETIRED = {
    "overtaken": "superseded",
    "overtakes": "supersedes",
    "nobody": "no process, no subscriber, not received",
    "somebody": "another process, a subscriber, another sender",
    "anybody": "any user, of any origin",
    "whoever": "every subscriber, the user",
    "stranger": "conflict, other sender",
    "strangers": "conflicts, other senders",
    "told": "sent, reported, received",
    "tell": "report, distinguish, show",
    "tells": "reports, shows, lists",
    "heard": "received",
    "hears": "receives",
    "hung": "stalled, does not respond",
    "oddity": "anomaly",
    "oddities": "anomalies",
    "teller": "builder, sender",
    "clockwork": "clock callbacks",
    "tidy": "collect garbage",
    "anew": "again",
    "flesh": "physical",
    "lent": "shared",
    "mute": "silent, no notification",
    "weigh": "compare, score",
    "weighed": "compared, scored",
    "speaks": "sends, uses",
    "spoke": "sent",
    "said": "reported",
    "believed": "accepted",
    "crystal": "clock",
    "crystals": "clocks",
    "in words": "as text",
    "last words": "last lines of output",
    "says nothing": "is invalid, sends nothing",
    "say nothing": "are invalid, send nothing",
    "says something": "is valid",
    "sees again": "recovered",
    "as it should be": "OK, no fault",
    "what there is": "available",
    "arrivals only": "not synchronised",
}
"""Retired word or phrase -> its standard replacement."""

PATTERN = re.compile(rf"(?<![\w-])(?:{'|'.join(sorted(RETIRED, key=len, reverse=True))})(?![\w-])", re.IGNORECASE)

PAGES = [
    *(p for p in (ROOT / "docs").rglob("*.md") if "research" not in p.parts),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *(ROOT / "clients").rglob("*.md"),
]


def retired_in(text: str) -> list[str]:
    """Each retired word of a text with its replacement and the words around it."""
    found = []
    for match in PATTERN.finditer(text):
        around = text[max(0, match.start() - 40) : match.end() + 40].replace("\n", " ")
        found.append(f"{match[0]!r} (write: {RETIRED[match[0].lower()]}) in: ...{around}...")
    return found


def prose(markdown: str) -> str:
    """The text of a page without code, quoted names and link targets."""
    text = re.sub(r"```.*?```", "", markdown, flags=re.DOTALL)
    text = re.sub(r"`[^`\n]*`", "", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return "\n".join(line for line in text.splitlines() if not line.startswith("    "))


def messages(package: Path) -> Iterator[tuple[str, str]]:
    """(place, text) of the string literals of several words in a package, without docstrings."""
    for file in sorted(package.rglob("*.py")):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        joined = [n for n in nodes if isinstance(n, ast.JoinedStr)]
        inner = {id(n.value) for n in nodes if isinstance(n, ast.Expr)} | {
            id(part) for n in joined for part in n.values
        }
        texts = [(n.lineno, text_of(n)) for n in joined]
        texts += [
            (n.lineno, n.value)
            for n in nodes
            if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in inner
        ]
        yield from ((f"{file.relative_to(ROOT)}:{line}", text) for line, text in texts if text.count(" ") >= 2)


def text_of(node: ast.JoinedStr) -> str:
    """The text of an f-string with `*` for each value."""
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "*" for part in node.values)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_pages_use_the_standard_words(page: Path) -> None:
    assert retired_in(prose(page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_commands_uses_the_standard_words(command: str) -> None:
    parser = parser_of(command)
    (subparsers,) = (a for a in parser._actions if a.dest == "command")
    assert isinstance(subparsers.choices, dict)
    text = " ".join(f"{parser.format_help()} {subparsers.choices[command].format_help()}".split())
    assert retired_in(text) == []


@pytest.mark.parametrize("file", sorted((ROOT / "configs").glob("*.toml")), ids=lambda p: p.name)
def test_comments_of_configurations_use_the_standard_words(file: Path) -> None:
    comments = "\n".join(line.partition("#")[2] for line in file.read_text(encoding="utf-8").splitlines())
    assert retired_in(comments) == []


@pytest.mark.parametrize("section", SECTIONS)
def test_documentation_of_parameters_uses_the_standard_words(section: str) -> None:
    texts = [f"{section}.{f.name}: {f.metadata.get('doc', '')}" for f in fields_of(section)]
    assert any(text.partition(": ")[2] for text in texts)
    assert [found for text in texts for found in retired_in(text)] == []


def test_texts_of_codes_use_the_standard_words() -> None:
    kinds = (DiagnosticCode, DropCause, InvalidCause, LatencyStage, LinkAnomaly)
    assert [found for kind in kinds for code in kind for found in retired_in(code.text)] == []


@pytest.mark.parametrize("package", [companion, drivers], ids=["companion", "drivers"])
def test_messages_use_the_standard_words(package: object) -> None:
    folder = Path(str(package.__file__)).parent  # type: ignore[attr-defined]
    assert [f"{place}: {found}" for place, text in messages(folder) for found in retired_in(text)] == []


def test_a_retired_word_is_found() -> None:
    text = "12 Hz, 3 overtaken; the service is told of it. `told`"
    assert [found.split(" (")[0] for found in retired_in(prose(text))] == ["'overtaken'", "'told'"]
    assert retired_in(prose("    told\n`told` and unfolded, [a](told.md)")) == []
