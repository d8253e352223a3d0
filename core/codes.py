"""Codes for programs, each with a text for people."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Self


class Code(StrEnum):
    """Base of enums whose members are written `NAME = "code", "text"`. The value is the code: snake_case, equal to the
    member's name in lower case, and never renamed within a major version; "" where a member stands for nothing. `text` is
    for people and may change at any time."""

    text: str

    def __new__(cls, code: str, text: str) -> Self:
        member = str.__new__(cls, code)
        member._value_ = code
        member.text = text
        return member


def text_of(code: str, kind: type[Code]) -> str:
    """The text of a code of this enum; the code itself where the enum lacks it (it is of another version)."""
    for member in kind:
        if member == code:
            return member.text
    return code


def texts_of(codes: Iterable[str], kind: type[Code]) -> dict[str, str]:
    """Code -> text."""
    return {code: text_of(code, kind) for code in codes}
