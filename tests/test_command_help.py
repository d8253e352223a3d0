"""The help of `companion`: every command and option is described, and every example is a command line that the parser accepts."""

from __future__ import annotations

import argparse
import shlex

import pytest

from companion.cli import parser_of
from companion.command_list import COMMANDS

EXAMPLES = [(name, line) for name, command in COMMANDS.items() for line in command.examples]


def subparser(command: str) -> argparse.ArgumentParser:
    (found,) = (a for a in parser_of(command)._actions if a.dest == "command")
    assert isinstance(found.choices, dict)
    parser = found.choices[command]
    assert isinstance(parser, argparse.ArgumentParser)
    return parser


@pytest.mark.parametrize(("command", "line"), EXAMPLES, ids=[line for _, line in EXAMPLES])
def test_each_example_is_a_command_line_of_its_command(command: str, line: str) -> None:
    words = shlex.split(line.removeprefix("sudo "))
    assert words[:2] == ["companion", command]
    assert parser_of(command).parse_args(words[1:]).command == command


@pytest.mark.parametrize("command", COMMANDS)
def test_each_option_has_a_help_text_and_examples_are_printed(command: str) -> None:
    parser = subparser(command)
    assert [a.option_strings or a.dest for a in parser._actions if not a.help] == []
    text = parser.format_help()
    assert all(line in text for line in COMMANDS[command].examples)


@pytest.mark.parametrize("command", COMMANDS)
def test_options_with_a_number_name_their_default(command: str) -> None:
    numbers = [
        a
        for a in subparser(command)._actions
        if isinstance(a.default, (int, float)) and not isinstance(a.default, bool)
    ]
    assert [a.option_strings for a in numbers if "default: " not in str(a.help)] == []


@pytest.mark.parametrize("columns", [60, 80])
def test_the_list_of_commands_fits_a_terminal_and_names_each_command(
    columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal of 60 characters each line but the shortest was broken twice."""
    monkeypatch.setenv("COLUMNS", str(columns))
    text = parser_of("").format_help()
    assert [line for line in text.splitlines() if len(line) > columns] == []
    assert all(f"\n  {name} " in text for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_texts_of_a_command_fit_a_narrow_terminal(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    lines = subparser(command).format_help().splitlines()
    examples = {f"  {line}" for line in COMMANDS[command].examples}
    assert [line for line in lines if len(line) > 60 and line not in examples] == []
