"""Tables in Markdown: the first columns are text, to the left; the others are figures, to the right."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def row(cells: Iterable[str]) -> str:
    """A row of a table."""
    return f"| {' | '.join(cells)} |"


def head(titles: Sequence[str], words: int = 1) -> str:
    """The titles and the rule below them, for a table whose rows are printed one by one. words: columns of text."""
    return f"{row(titles)}\n|{'---|' * words}{'---:|' * (len(titles) - words)}"


def table(titles: Sequence[str], rows: Iterable[Iterable[str]], words: int = 1) -> str:
    """A whole table."""
    return "\n".join([head(titles, words), *map(row, rows)])
