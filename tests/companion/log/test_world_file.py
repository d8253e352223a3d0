"""Worlds in files: read back, and damage reported with file and place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.log.world_file import read_world, write_world
from core.world.serialize import SavedSection


def section(n: int) -> SavedSection:
    rng = np.random.default_rng(n)
    xy = np.round(rng.uniform(-50, 50, (n, 2)), 2)
    box = np.column_stack([xy, xy + 2.0, np.full(n, -3.0), np.full(n, 1.0)])
    return SavedSection(
        number=1,
        reset_counter=2,
        begun_ns=3,
        newest_ns=4,
        box=box,
        moments=np.ones((n, 6)),
        margin_m=np.full(n, 0.1),
        flags=np.zeros(n, np.uint8),
        hits=np.ones(n, np.int32),
        age_s=np.zeros(n),
    )


def test_written_whole_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "site.world"
    write_world(path, (section(10),))
    write_world(path, (section(9000),))
    assert [p.name for p in tmp_path.iterdir()] == ["site.world"]
    (back,), fault = read_world(path)
    assert fault == ""
    assert (back.number, back.reset_counter, back.begun_ns, back.newest_ns) == (1, 2, 3, 4)
    assert np.allclose(back.box, section(9000).box)


def test_a_cut_file_gives_its_whole_parts_and_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "site.world"
    write_world(path, (section(9000),))
    path.write_bytes(path.read_bytes()[:300_000])
    (back,), fault = read_world(path)
    assert len(back.box) == 4096
    assert str(path) in fault
    assert "it is cut" in fault
    path.write_bytes(b"PNG")
    with pytest.raises(ValueError, match=r"site\.world: no saved world"):
        read_world(path)
    with pytest.raises(OSError, match=r"nothing\.world"):
        read_world(tmp_path / "nothing.world")


def test_a_plane_that_does_not_fit_is_left_out_and_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, three = tmp_path / "site.world", section(3)
    box = three.box.copy()
    box[1, 5] = 800.0
    fault = write_world(path, (section(10), replace(three, box=box)))
    assert "site.world: left out: 1 of 3 planes of section 1 (plane 1: a height of more than 655.3 m)" in fault
    assert fault in caplog.text
    (whole, cut), damage = read_world(path)
    assert damage == ""
    assert len(whole.box) == 10
    assert np.allclose(cut.box, box[[0, 2]])
    assert write_world(path, (three,)) == ""
