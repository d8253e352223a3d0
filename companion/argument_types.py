"""Types of command-line arguments for `argparse`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TypeVar

_Number = TypeVar("_Number", int, float)


def _digits(number: float) -> str:
    """An integer in full."""
    return str(number) if isinstance(number, int) else f"{number:g}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def number_in(kind: Callable[[str], _Number], low: _Number, high: _Number) -> Callable[[str], _Number]:
    """An argument type: a number from low to high. kind: int or float."""

    def parse(text: str) -> _Number:
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            hint = (
                "; write a decimal point"
                if kind is float and value is None and _is_number(text.replace(",", "."))
                else ""
            )
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
