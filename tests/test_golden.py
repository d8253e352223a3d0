"""The recorded streams still give the golden results; what the comparison overlooks, it overlooks on purpose."""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from core.types import DepthFrame

from . import golden_world
from .companion.recordings import events_of
from .golden import (
    DATA,
    STREAMS,
    Result,
    differences,
    dumps,
    load,
    record,
    recording_path,
    result_of,
    result_path,
    summary,
    totals,
)


@pytest.mark.parametrize("name", STREAMS)
def test_golden_stream(name: str, update_golden: bool, capsys: pytest.CaptureFixture[str]) -> None:
    """Exact where the golden result was made with the same processor and packages, within the tolerance elsewhere."""
    now = result_of(recording_path(name))
    if update_golden:
        before = load(name) if result_path(name).exists() else None
        result_path(name).write_text(dumps(now))
        with capsys.disabled():
            sys.stdout.write(f"\n{summary(name, before, now)}\n")
        return
    golden = load(name)
    if list(differences(golden, now)):
        pytest.fail(f"{summary(name, golden, now)}\nIf this is meant: make golden, and read the diff.", pytrace=False)


def test_golden_worlds(update_golden: bool, capsys: pytest.CaptureFixture[str]) -> None:
    """What the streams' frames are merged to, as exactly."""
    now = golden_world.worlds()
    if update_golden:
        before = golden_world.load() if golden_world.WORLDS.exists() else {"made_with": now["made_with"]}
        found = list(golden_world.differences({**before, "made_with": now["made_with"]}, now))
        golden_world.WORLDS.write_text(golden_world.dumps(now))
        with capsys.disabled():
            sys.stdout.write(
                "\nworlds: " + (f"{len(found)} differences\n" + "\n".join(found[:12]) if found else "as before")
            )
        return
    found = list(golden_world.differences(golden_world.load(), now))
    if found:
        pytest.fail("\n".join([*found[:12], "If this is meant: make golden, and read the diff."]), pytrace=False)


def test_a_log_is_merged_to_the_same_world_bit_for_bit() -> None:
    """Whatever was merged before in the same process; and a frame more or less is another world."""
    first = golden_world.observations_of(recording_path("alley"))
    world = golden_world.merged(first)
    again = golden_world.merged(golden_world.observations_of(recording_path("alley")))
    assert world.numbers() == again.numbers()
    assert golden_world.world_bytes(world) == golden_world.world_bytes(again)
    assert golden_world.world_bytes(golden_world.merged(first[:-1])) != golden_world.world_bytes(world)
    assert len(world.picture(first[-1].t_ns).planes) > 10


def test_what_the_comparison_of_worlds_sees() -> None:
    golden = golden_world.load()
    assert list(golden_world.differences(golden, golden)) == []
    for key in ("planes", "free_cells", "digest"):
        now = copy.deepcopy(golden)
        now["street"][key] = "0" if key == "digest" else golden["street"][key] // 2
        assert list(golden_world.differences(golden, now))
        now["made_with"] = ["another processor"]
        assert bool(list(golden_world.differences(golden, now))) == (key != "digest")
    now = copy.deepcopy(golden)
    now["street"]["rows"][0][0] += 1
    assert len(list(golden_world.differences(golden, now))) == 2


def test_the_streams_hold_what_they_are_for() -> None:
    """No golden result may be an empty model: each stream shows what it was recorded for."""
    found = {name: totals(load(name)) for name in STREAMS}
    for name in STREAMS:
        frames = load(name)["frames"]
        assert 8 <= len(frames) <= 16
        assert {f["attitude"] for f in frames} & {"INTERPOLATED", "EXTRAPOLATED"}
        if name != "broken":
            assert found[name]["used"] == found[name]["valid"] == len(frames)
        assert found[name]["planes"] > 4 * found[name]["valid"]
        assert found[name]["seen free, m"] > 20 * found[name]["valid"]
    broken = load("broken")["frames"]
    assert {f["cause"] for f in broken} >= {"", "too few pixels hold a measurement"}
    assert any(f["dropped"] for f in broken), "frames without attitude"
    assert sum(path.stat().st_size for path in DATA.rglob("*") if path.is_file()) < 6_000_000


@pytest.mark.parametrize("name", ["alley", "broken"])
def test_a_recording_is_what_the_simulator_flies(name: str, tmp_path: Path) -> None:
    """The same events as in the stored file: a simulator that changed needs `make golden-recordings`. On another kind of
    processor the last digit of a pixel may differ."""
    record(name, tmp_path / "again.mcap")
    stored, again = events_of(recording_path(name)), events_of(tmp_path / "again.mcap")
    assert [(type(e), e.t_arrival_ns) for e in stored] == [(type(e), e.t_arrival_ns) for e in again]
    for one, other in zip(stored, again, strict=True):
        if isinstance(one, DepthFrame) and isinstance(other, DepthFrame):
            apart_mm = np.abs(one.depth_mm.astype(np.int32) - other.depth_mm)
            assert np.count_nonzero(apart_mm > 2) <= one.depth_mm.size // 500


def without_a_plane(result: Result) -> None:
    del result["frames"][2]["planes"][5:7]


def one_plane_less(result: Result) -> None:
    del result["frames"][2]["planes"][5]


def another_plane(result: Result) -> None:
    result["frames"][2]["planes"].append([0, 0, 100, 0, -2000, 0, 50, 9, 0, 0])
    result["frames"][2]["planes"].append([0, 0, 200, 0, -2000, 0, 50, 9, 0, 0])


def planes_farther_by(shift_mm: int) -> Callable[[Result], None]:
    def change(result: Result) -> None:
        for row in result["frames"][3]["planes"]:
            row[0] += shift_mm
            row[2] += shift_mm

    return change


def less_free(result: Result) -> None:
    free = result["frames"][1]["free"]
    free["open_mm"] = [v // 2 for v in free["open_mm"]]
    free["digest"] = "0" * 16


def blind(result: Result) -> None:
    result["frames"][4]["valid"] = False


def no_ground(result: Result) -> None:
    result["frames"][0]["ground"]["seen"] = False


def other_attitude(result: Result) -> None:
    result["frames"][0]["attitude"] = "NONE"


def frame_missing(result: Result) -> None:
    del result["frames"][-1]


def other_order(result: Result) -> None:
    result["frames"][0]["planes"].reverse()


def other_digest(result: Result) -> None:
    result["frames"][0]["free"]["digest"] = "0" * 16


def one_strip_more(result: Result) -> None:
    result["frames"][0]["counts"]["strips"] += 1


SEEN_ANYWHERE: tuple[Callable[[Result], None], ...] = (
    without_a_plane,
    another_plane,
    planes_farther_by(2),
    less_free,
    blind,
    no_ground,
    other_attitude,
    frame_missing,
)
SEEN_ON_THE_SAME_PROCESSOR = (one_plane_less, planes_farther_by(1), other_order, other_digest, one_strip_more)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("change", SEEN_ANYWHERE + SEEN_ON_THE_SAME_PROCESSOR)
def test_what_the_comparison_sees(change: Callable[[Result], None], exact: bool) -> None:
    golden = load("street")
    now = copy.deepcopy(golden)
    if not exact:
        now["made_with"] = ["another processor"]
    assert list(differences(golden, now)) == []
    change(now)
    assert bool(list(differences(golden, now))) == (exact or change in SEEN_ANYWHERE)


def test_an_update_reports_what_changed() -> None:
    golden = load("street")
    now = copy.deepcopy(golden)
    assert summary("street", golden, now) == "street: as before"
    without_a_plane(now)
    found = summary("street", golden, now)
    planes = totals(golden)["planes"]
    assert found.splitlines()[0] == "street: 2 differences"
    assert f"  planes: {planes} -> {planes - 2}" in found
    assert "frame 2: planes: gone (a_x " in found
    assert summary("street", None, now).startswith("street: new; frames 9, used 9")


def test_a_result_is_for_reading() -> None:
    """Each plane on a line of its own, and nothing lost on the way."""
    text = result_path("street").read_text()
    assert dumps(load("street")) == text
    rows = [line for line in text.splitlines() if line.strip().startswith("[") and line.count(",") >= 9]
    assert len(rows) >= totals(load("street"))["planes"]
