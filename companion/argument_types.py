"""Types of command-line arguments for `argparse`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from typing import Final, TypeVar

_Number = TypeVar("_Number", int, float)
_BEGINS_WITH_NUMBER: Final = re.compile(r"[-+]?\.?\d")


def _digits(number: float) -> str:
    """An integer in full."""
    return str(number) if isinstance(number, int) else f"{number:g}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _hint(kind: Callable[[str], int | float], text: str) -> str:
    """What to write in place of a text that is not a number of this kind, "" where the text is no number at all."""
    if kind is int and _is_number(text):
        return "; write a whole number"
    if kind is float and _is_number(text.replace(",", ".")):
        return "; write a decimal point"
    return "; write one number without a unit" if _BEGINS_WITH_NUMBER.match(text) else ""


def number_in(kind: Callable[[str], _Number], low: _Number, high: _Number) -> Callable[[str], _Number]:
    """An argument type: a number from low to high. kind: int or float."""

    def parse(text: str) -> _Number:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            hint = _hint(kind, text) if value is None else ""
            raise argparse.ArgumentTypeError(f"{text!r}: expected {_digits(low)}..{_digits(high)}{hint}")
        return value

    return parse


def checked_by(check: Callable[[str], object]) -> Callable[[str], str]:
    """An argument type: a text that a function accepts, which otherwise raises ValueError with the remedy."""

    def parse(text: str) -> str:
        try:
            check(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        return text

    return parse
