"""Configuration keys and Python names that the pages for users name exist, and each option is in the list of commands."""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import re
import textwrap
import tomllib
from pathlib import Path

import pytest

from companion.cli import parser_of
from companion.command_list import COMMANDS
from companion.config.retired_constants import CONSTANTS_OF
from companion.config.sections import SECTIONS, fields_of
from core.extractor import Extractor

from ...conftest import CHECKOUT
from ...test_docs_links import USER_PAGES, lines_of, name_of

KEYS = {section: {f.name for f in fields_of(section)} for section in SECTIONS}
KEYS |= {section: KEYS[section] | set(constants) for section, constants in CONSTANTS_OF.items()}


def unknown_keys(text: str) -> list[str]:
    """Of the keys that a text names with their section, those that do not exist."""
    named = re.findall(r"\[+([a-z_]+)\]+`? `?([a-z0-9_]+)(?=`| = )", text)
    return [f"[{section}] {key}" for section, key in named if section in KEYS and key not in KEYS[section]]


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_named_key_exists(page: Path) -> None:
    assert unknown_keys(page.read_text(encoding="utf-8")) == []


def test_a_wrong_key_is_found() -> None:
    assert unknown_keys("set `[avoid] send = true`, `[[camera]]` `device`, `[record] depth_hz`") == []
    assert unknown_keys("`[avoid] sends = true`, `[guard]` `none`") == ["[avoid] sends", "[guard] none"]


def code_blocks(page: Path) -> list[str]:
    """The code blocks of a page, fenced or indented."""
    blocks, block = [], ""
    for line, code in [*lines_of(page), ("", False)]:
        if (code or (block and not line)) and not line.lstrip().startswith("```"):
            block += f"{line}\n"
        else:
            blocks += [textwrap.dedent(block)] if block.strip() else []
            block = ""
    return blocks


def configurations(page: Path) -> list[str]:
    """The code blocks of a page that are parts of a configuration."""
    return [
        b
        for b in code_blocks(page)
        if (m := re.match(r"\s*(?:#.*\n\s*)*\[+(\w+)\]+ *(?:#.*)?$", b, re.M)) and m[1] in KEYS
    ]


def unknown_in(text: str) -> list[str]:
    """Of the sections and keys of a configuration, those that do not exist. Raises TOMLDecodeError."""
    unknown = []
    for section, content in tomllib.loads(text).items():
        for part in content if isinstance(content, list) else [content]:
            unknown += [f"[{section}] {key}" for key in part if key not in KEYS.get(section, set())]
    return unknown


@pytest.mark.parametrize("page", USER_PAGES, ids=name_of)
def test_each_printed_configuration_can_be_read_and_its_keys_exist(page: Path) -> None:
    assert [key for block in configurations(page) for key in unknown_in(block)] == []


def test_a_wrong_key_of_a_printed_configuration_is_found() -> None:
    assert unknown_in('[[camera]]\nkind = "oak"\nknid = 1\n[avoid]\nsend = true\n[avoids]\nsend = true\n') == [
        "[camera] knid",
        "[avoids] send",
    ]
    assert sum(len(configurations(page)) for page in USER_PAGES) >= 10


def test_the_table_of_stages_names_the_calls_of_the_extractor_and_their_modules() -> None:
    page = (CHECKOUT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in page.splitlines() if re.match(r"\| \[\d+ ", line)]
    body = inspect.getsource(Extractor)
    calls = [name.rpartition(".")[2] for row in rows for name in re.findall(r"`([\w.]+)`", row[1])]
    modules = [name for row in rows for name in re.findall(r"`(\w+)`", row[2])]
    assert len(rows) == 10
    assert [name for name in calls if not re.search(rf"(?<!\w){name}\(", body)] == []
    assert [name for name in modules if not (CHECKOUT / "core" / "stages" / f"{name}.py").is_file()] == []


def python_blocks(page: Path) -> list[str]:
    """The code blocks of a page that are Python: those that import something."""
    return [b for b in code_blocks(page) if re.search(r"^\s*from \w[\w.]* import ", b, re.MULTILINE)]


PYTHON = [(page, block) for page in USER_PAGES for block in python_blocks(page)]


def test_the_python_of_the_pages_is_found() -> None:
    assert len(PYTHON) >= 6
    assert sum("WorldMirror" in block for _, block in PYTHON) >= 2


@pytest.mark.parametrize(("page", "block"), PYTHON, ids=[name_of(page) for page, _ in PYTHON])
def test_python_of_a_page_can_be_parsed_and_its_imports_exist(page: Path, block: str) -> None:
    for node in ast.walk(ast.parse(block)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(str(node.module))
            assert [a.name for a in node.names if not hasattr(module, a.name)] == []


def options_of(command: str) -> dict[str, list[str]]:
    """Option, by its longest spelling -> all spellings."""
    (choice,) = (a for a in parser_of(command)._actions if a.dest == "command")
    assert isinstance(choice.choices, dict)
    parser = choice.choices[command]
    assert isinstance(parser, argparse.ArgumentParser)
    return {max(a.option_strings, key=len): list(a.option_strings) for a in parser._actions if a.option_strings}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_list_of_commands_has_each_option(command: str) -> None:
    page = (CHECKOUT / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    rows = " ".join(line for line in page.splitlines() if re.match(rf"\| `companion {command}\b(?!-)", line))
    options = options_of(command)
    named = set(re.findall(r"(?<![\w-])--?[a-z][a-z0-9-]*", " ".join(re.findall(r"`[^`]*`", rows))))
    missing = [o for o, spelled in options.items() if o not in ("--help", "--json") and not named & set(spelled)]
    assert missing == []
    assert named <= {spelling for spelled in options.values() for spelling in spelled}
