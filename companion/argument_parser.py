"""A parser of command lines that accepts values such as `-20,5` as words of their own."""

from __future__ import annotations

import argparse
import difflib
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from drivers.shell_word import shell_word

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

_NEGATIVE = re.compile(r"-[0-9.].*")
"""A word that argparse takes for an option, unless it is a plain negative number."""
_OPTION = re.compile(r"--[^=]+")
_OPTIONS_IN_HELP = re.compile(r"^  (-.*?)(?:  |$)", re.MULTILINE)
"""The options at the begin of a line of help, with their values."""


def negative_values_joined(words: Sequence[str]) -> list[str]:
    """Returns the words of a command line, with `--option -20,5` as `--option=-20,5`.

    argparse takes a word that begins with a minus for an option, unless it is a plain number, and reports "expected one
    argument". No option of this program begins with a minus and a digit."""
    out: list[str] = []
    for k, word in enumerate(words):
        if word == "--":
            return [*out, *words[k:]]
        if out and _NEGATIVE.fullmatch(word) and not _plain(word) and _OPTION.fullmatch(out[-1]):
            out[-1] += f"={word}"
        else:
            out.append(word)
    return out


def _plain(word: str) -> bool:
    """Whether argparse accepts a word as a negative number."""
    return re.fullmatch(r"-\d+|-\d*\.\d+", word) is not None


def named_path(text: str) -> Path:
    """The path of an argument. Raises ArgumentTypeError for an empty one, which would be the working directory."""
    if not text:
        raise argparse.ArgumentTypeError("an empty path; is a variable of the shell not set?")
    return Path(text)


class ArgumentParser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` that accepts a list of numbers with a minus as a word of its own, suggests what an
    unknown word may mean, and refuses an empty path."""

    _words: Sequence[str] = ()

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.register("type", Path, named_path)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As in the base class, which calls it for `parse_args` and for the words of a command. No word may be unknown."""
        self._words = negative_values_joined(sys.argv[1:] if args is None else args)
        found, unknown = super().parse_known_args(self._words, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}; {self._remedy(unknown[0])}")
        return found, unknown

    def print_help(self, file: SupportsWrite[str] | None = None) -> None:
        """Prints the help. Raises OSError, which the base class drops: the status was 0 although nothing was printed."""
        (sys.stdout if file is None else file).write(self.format_help())

    def error(self, message: str) -> NoReturn:
        """Prints the usage and the message, and exits. A file whose name begins with a minus was taken for an option."""
        for word in self._words:
            if word.startswith("-") and os.path.lexists(word):
                super().error(f"{message}; give the file as {shell_word(word)}")
        super().error(message)

    def _remedy(self, unknown: str) -> str:
        """Returns what to do about a word that is no argument of this parser."""
        options = re.findall("--[a-z0-9-]+", " ".join(_OPTIONS_IN_HELP.findall(self.format_help())))
        if unknown.endswith(".toml") and "--config" in options:
            return f"did you mean -c {shell_word(unknown)}?"
        if near := difflib.get_close_matches(unknown.partition("=")[0], options, n=1):
            return f"did you mean {near[0]}?"
        return f"`{self.prog} --help` lists its arguments"
