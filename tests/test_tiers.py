"""Each test has one tier, so that make test contains no slow test."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import pytest

from .conftest import CHECKOUT, LONG_FILES, SEARCHED, pytest_collection_modifyitems


class Item:
    """What the hook uses of a test."""

    nodeid = "test_file.py::test"

    def __init__(self, path: Path, markers: tuple[str, ...]) -> None:
        self.path, self.markers = path, list(markers)

    def get_closest_marker(self, name: str) -> str | None:
        return name if name in self.markers else None

    def add_marker(self, mark: pytest.MarkDecorator) -> None:
        self.markers.append(mark.name)


@pytest.fixture
def marked(tmp_path: Path) -> Path:
    """A file that contains the markers which the Makefile searches."""
    file = tmp_path / "test_marked.py"
    file.write_text("".join(f"pytest.mark.{marker}\n" for marker in SEARCHED), encoding="utf-8")
    return file


def collected(path: Path, *markers: str) -> list[str]:
    item = Item(path, markers)
    pytest_collection_modifyitems([cast("pytest.Item", item)])
    return item.markers


def test_a_test_without_a_tier_is_a_unit_test(marked: Path) -> None:
    assert collected(marked) == ["unit"]
    assert collected(marked, "nojit") == ["nojit", "unit"]
    assert collected(marked, "process") == ["process"]


def test_long_files_come_first_and_exist(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("guard/test_a.py", *reversed(LONG_FILES), "guard/test_b.py")]
    items = [cast("pytest.Item", Item(file, ())) for file in files]
    pytest_collection_modifyitems(items)
    assert [item.path for item in items] == [*(tmp_path / name for name in LONG_FILES), files[0], files[-1]]
    assert [name for name in LONG_FILES if len(list(CHECKOUT.glob(f"tests/**/{name}"))) != 1] == []


def test_a_test_with_two_tiers_is_an_error(marked: Path) -> None:
    with pytest.raises(pytest.UsageError, match="has the tiers process and soak"):
        collected(marked, "process", "soak")


@pytest.mark.parametrize("marker", SEARCHED)
def test_a_marker_that_is_not_written_in_its_file_is_an_error(marker: str, tmp_path: Path) -> None:
    """`make test` would not run the test: it collects the files that contain the marker."""
    file = tmp_path / "test_file.py"
    file.write_text("from .marks import PART as pytestmark\n", encoding="utf-8")
    with pytest.raises(pytest.UsageError, match=rf"test_file.py does not contain mark.{marker}"):
        collected(file, marker)
    file.write_text(f"pytestmark = pytest.mark.{marker}\n", encoding="utf-8")
    assert marker in collected(file, marker)


def test_the_makefile_collects_the_files_with_a_marker() -> None:
    makefile = (CHECKOUT / "Makefile").read_text(encoding="utf-8")
    for marker in SEARCHED:
        assert f"$(call WITH_MARK,{marker}," in makefile
