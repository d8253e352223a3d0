"""Each test has one tier, so that make test contains no slow test."""

from __future__ import annotations

from typing import cast

import pytest

from .conftest import pytest_collection_modifyitems


class Item:
    """What the hook uses of a test."""

    nodeid = "test_file.py::test"

    def __init__(self, *markers: str) -> None:
        self.markers = list(markers)

    def get_closest_marker(self, name: str) -> str | None:
        return name if name in self.markers else None

    def add_marker(self, mark: pytest.MarkDecorator) -> None:
        self.markers.append(mark.name)


def collected(*markers: str) -> list[str]:
    item = Item(*markers)
    pytest_collection_modifyitems([cast("pytest.Item", item)])
    return item.markers


def test_a_test_without_a_tier_is_a_unit_test() -> None:
    assert collected() == ["unit"]
    assert collected("nojit") == ["nojit", "unit"]
    assert collected("process") == ["process"]


def test_a_test_with_two_tiers_is_an_error() -> None:
    with pytest.raises(pytest.UsageError, match="has the tiers process and soak"):
        collected("process", "soak")
