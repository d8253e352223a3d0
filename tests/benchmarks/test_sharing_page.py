"""The page of the measurements of sharing."""

from __future__ import annotations

from pathlib import Path

from benchmarks.sharing.__main__ import NOTES, OUT, write


def test_what_is_written_by_hand_stays_when_it_is_measured_anew(tmp_path: Path) -> None:
    page = tmp_path / "sharing.md"
    write(page, [], 0.0, quick=False)
    assert NOTES not in page.read_text()
    by_hand = f"{NOTES}\n\nA paragraph.\n\n## Attempts\n\n- One.\n"
    page.write_text(f"old\n\n| table |\n\n{by_hand}")
    write(page, [], 0.0, quick=False)
    assert page.read_text().endswith(f"\n\n{by_hand}")
    assert "| table |" not in page.read_text()


def test_the_page_has_a_part_that_is_written_by_hand() -> None:
    assert OUT.read_text().count(f"\n{NOTES}\n") == 1
