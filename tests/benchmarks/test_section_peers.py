"""The page of the peers: its figures from hand-made rows with known answers, its pictures, and the whole in small."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.fidelity.matrix import cases
from benchmarks.fidelity.result import Case
from benchmarks.peers import section as section_peers
from benchmarks.peers.methods import UNSORTED, Grid, Ours, Peer
from benchmarks.peers.participants import PAPER, SAFE
from benchmarks.peers.plots import draw_scatter, draw_times, kind_of
from benchmarks.peers.run import CLOUD, Figures, Timing, run_case
from benchmarks.peers.tables import (
    FINE_GRID,
    ROUGH_GRID,
    figures_table,
    groups,
    pooled,
    ratios,
    sentences,
    storage_table,
    times_table,
)
from benchmarks.scenes.catalogue import HELD_OUT_SEEDS
from companion.bench.timing import Times

CASE = Case(scene="wall", ke_per_m=0.0015, configured_ke_per_m=0.0015, seed=100)
OURS = Figures(
    peer=SAFE, unit="planes", family="structured", case=CASE, valid=True, primitives=10, facing=10, bytes=240, mean_m=0.02,
    p95_m=0.05, body_mean_m=0.02, missed=1, phantom=2, phantom_open=3, open_stopped=40, obstacle_rays=1000, open_rays=2000,
)  # fmt: skip
GRID = replace(
    OURS, peer=ROUGH_GRID, primitives=40, facing=20, bytes=400, mean_m=0.5, body_mean_m=0.0, missed=0, open_stopped=400
)
FINE = replace(GRID, peer=FINE_GRID, primitives=400, bytes=4000, mean_m=0.2)
TREE = replace(OURS, peer="OctoMap 0.1 m", unit="leaves", bytes=9600, mean_m=0.01, missed=1, open_stopped=20)
SECOND = replace(CASE, scene="corner")


def timing(peer: str, cpu_ms: float, kind: str = "structured") -> Timing:
    return Timing(peer=peer, kind=kind, times=Times(np.full(3, 2.0 * cpu_ms), np.full(3, cpu_ms)))


TIMES = [
    timing(SAFE, 10.0),
    timing(PAPER, 30.0),
    timing(ROUGH_GRID, 1.0),
    timing("OctoMap 0.1 m", 400.0),
    timing(CLOUD, 5.0),
]


def test_pooled_takes_medians_of_cases_shares_of_all_rays_and_leaves_silence_out() -> None:
    more = replace(
        OURS, case=SECOND, primitives=20, mean_m=0.04, missed=0, obstacle_rays=3000, open_rays=0, open_stopped=0
    )
    silent = replace(OURS, valid=False, primitives=0, mean_m=math.inf, missed=1000)
    p = pooled([OURS, more, silent])
    assert p is not None
    assert (p.cases, p.silent, p.primitives) == (3, 1, 15)
    assert (p.mean_m, p.worst_mean_m) == pytest.approx((0.03, 0.04))
    assert p.missed == pytest.approx((1 / 4000, 1 / 1000))
    assert p.open_stopped == pytest.approx((40 / 2000, 40 / 2000))
    assert pooled([silent]) is None
    alone = pooled([more])
    assert alone is not None
    assert math.isnan(alone.phantom_open[0])


def test_ratios_are_case_by_case_and_count_goals_that_are_missed() -> None:
    other = [replace(r, case=SECOND) for r in (replace(OURS, primitives=30), GRID, FINE)]
    peers = groups([OURS, GRID, FINE, *other])["structured", 0.0015]
    assert ratios(peers, ROUGH_GRID, lambda r: r.primitives, lambda r: r.primitives) == [0.25, 0.75]
    table = storage_table([OURS, GRID, FINE, *other])
    assert "0.50 (0.75, 1 of 2 over 0.5)" in table
    assert "0.60 (0.60, 2 of 2 over 0.5)" in table  # bytes
    assert "1.00 (1.50)" in table  # front sides
    assert "0.10 (0.10, 0 of 2 over 0.2)" in table  # error
    assert ratios({SAFE: [OURS]}, ROUGH_GRID, lambda r: r.bytes, lambda r: r.bytes) == []


def test_figures_table_shows_peers_without_a_result_or_not_installed() -> None:
    nothing = replace(TREE, mean_m=math.inf, p95_m=math.inf, body_mean_m=math.inf)
    silent = replace(OURS, peer=PAPER, valid=False)
    table = figures_table(groups([OURS, silent, nothing])["structured", 0.0015], [("Open3D", "not installed")])
    lines = {line.split("|")[1].strip(): line for line in table.splitlines()}
    assert (
        "| 10 planes | 240 | 0.020 (0.02) | 0.05 | 0.020 | 0.10 (0.1) | 0.20 (0.2) | 0.15 (0.1) | 2.00 (2.0) |"
        in lines[SAFE]
    )
    assert "said nothing" in lines[PAPER]
    assert "none (none)" in lines["OctoMap 0.1 m"]
    assert "not run" in lines["Open3D"]
    assert len({line.count("|") for line in table.splitlines()}) == 1


def test_times_table_counts_the_cloud_to_those_that_start_from_it() -> None:
    table = times_table([*TIMES, timing(ROUGH_GRID + UNSORTED, 3.0)], [("Open3D", "not installed")])
    lines = {line.split("|")[1].strip(): line for line in table.splitlines()}
    assert "| 10.00 (10.00) | 1.00 (1.00) | 20.00 | 3 |" in lines[SAFE]
    assert "| 0.10 (0.60) |" in lines[ROUGH_GRID]
    assert "| 0.30 (0.30) |" in lines[ROUGH_GRID + UNSORTED]
    assert "| 3.00 (3.00) |" in lines[PAPER]
    assert "not run" in lines["Open3D"]


def test_sentences_name_those_that_are_better_than_ours() -> None:
    text = "\n".join(sentences([OURS, GRID, FINE, TREE], TIMES))
    assert "neither larger nor farther from the truth than ours: none; nearer at all: OctoMap 0.1 m (40.0 times" in text
    assert "stop no more open rays than ours: OctoMap 0.1 m." in text
    assert f"cloud counted: {ROUGH_GRID}." in text
    better = replace(GRID, mean_m=0.01, bytes=100)
    assert f"than ours: {ROUGH_GRID}; nearer" in "\n".join(sentences([OURS, better], TIMES))


@pytest.mark.slow
def test_pictures_are_drawn_also_where_a_peer_has_no_model(tmp_path: Path) -> None:
    rows = [OURS, GRID, FINE, TREE, replace(TREE, peer="Open3D planar patches", mean_m=math.inf)]
    noisy = [
        replace(r, case=replace(CASE, ke_per_m=0.005), family=f) for r in rows for f in ("structured", "unstructured")
    ]
    draw_scatter(tmp_path / "a.png", [*rows, *noisy], ("bytes", "bytes"), ("mean_m", "m"), (1.0, 0.001))
    draw_scatter(tmp_path / "b.png", rows, ("open_stopped", "%"), ("missed", "%"), (0.01, 0.001))
    draw_times(tmp_path / "c.png", TIMES)
    for name in ("a.png", "b.png", "c.png"):
        picture = cv2.imread(str(tmp_path / name))
        assert picture.shape[0] > 300
        assert picture.std() > 10.0
    assert [kind_of(n) for n in (SAFE, ROUGH_GRID, "OctoMap 0.1 m", CLOUD)] == [SAFE, "3DP", "OctoMap", CLOUD]


def test_figures_come_from_held_out_seeds_and_quick_is_a_few_of_them() -> None:
    full, quick = (section_peers.judged_cases(e) for e in (section_peers.FULL, section_peers.QUICK))
    assert {c.seed for c in full} <= set(HELD_OUT_SEEDS)
    assert len({c.scene for c in full}) >= 24
    assert {c.ke_per_m for c in full} == {0.0015, 0.005}
    assert 0 < len(quick) <= 6
    for cases_of_kind in section_peers.timed_cases(section_peers.FULL).values():
        assert {c.seed for c in cases_of_kind} <= set(HELD_OUT_SEEDS)


@pytest.mark.slow
def test_the_whole_page_in_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few: list[Peer] = [Ours("safe"), Grid(0.1), Grid(0.8)]
    small = list(cases(["wall", "trees"], HELD_OUT_SEEDS[:1], ((0, 0),), (0.0015,), width=160))
    monkeypatch.setattr(section_peers, "contestants", lambda: (few, [("OctoMap", "not installed: pip install it")]))
    monkeypatch.setattr(section_peers, "judged_cases", lambda effort: small)
    monkeypatch.setattr(
        section_peers, "timed_cases", lambda effort: {"structured": small[:1], "unstructured": small[1:]}
    )
    monkeypatch.setattr(section_peers, "judge", lambda todo: [row for case in todo for row in run_case(case, few)])
    text = section_peers.section(tmp_path, quick=True)
    headings = [line for line in text.splitlines() if line.startswith("### ")]
    assert sum(h.startswith(("### structured, ke 0.0015", "### unstructured, ke 0.0015")) for h in headings) == 2
    assert sum("pose, ke 0.0015" in h or "drift 5 %, ke 0.0015" in h for h in headings) == 2, "the sequences"
    assert "**OctoMap was not run**: not installed: pip install it." in text
    assert "Frames: 2 of" in text
    assert "Structured: wall; Unstructured: trees" in text
    assert not any(line.startswith("# ") for line in text.splitlines())
    for name in (section_peers.ERROR_PNG, section_peers.RAYS_PNG, section_peers.TIME_PNG):
        assert f"]({name})" in text
        assert (tmp_path / name).stat().st_size > 5000
