"""`companion bench`: what it prints is what was measured, and its verdict follows from it. No time is asserted."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import companion.bench.bench as command
from companion.bench.bench import Bench, busy_text, verdict
from companion.bench.frames import FrameSequence, Measured, measure, render_sequence
from companion.bench.host_info import HostInfo, host_info, processor_model, versions
from companion.bench.timing import Clock, Times, one_core
from companion.cli import main
from companion.kernels.compilation import WarmupError
from core.extractor import Extractor

BOARD = HostInfo(
    processor="Cortex-A76", architecture="aarch64", cores=4, governor="performance", board="A board", system="Linux"
)


def bench_of(street_ms: list[float], trees_ms: list[float], share: float = 1.0, hz: float = 12.0) -> Bench:
    """Measured times of the wall, of which the processor worked a share."""
    measured = tuple(
        Measured(
            name=name,
            times=Times(np.array(ms), share * np.array(ms)),
            stages_ms={"level": 1.0},
            valid=True,
            planes=1,
            strips=2,
        )
        for name, ms in (("street", street_ms), ("trees", trees_ms))
    )
    return Bench(
        size=(640, 480), frames=3, hz=hz, ready_s=1.0, first_s=0.1, measured=measured, host_info=BOARD, versions={}
    )


def test_the_verdict_is_about_slow_frames_of_the_slower_view() -> None:
    quick = bench_of([2.0, 2.0, 9.0], [4.0, 5.0, 8.0], hz=10.0)
    assert quick.worst().name == "street"
    assert quick.used_share() == pytest.approx(0.09)
    assert verdict(quick) == (
        "10 Hz needs a frame every 100 ms; this computer takes 9.0 ms in 99 of 100 frames of the harder view (street), "
        "9 % of one core's time."
    )
    slow = bench_of([2.0, 2.0, 2.0], [100.0, 130.0, 130.0])
    assert verdict(slow).startswith("TOO SLOW: 12 Hz needs a frame every 83 ms; this computer takes 130.0 ms")


def test_other_work_on_the_machine_is_reported() -> None:
    assert busy_text(bench_of([2.0], [4.0])) == ""
    assert "took 2.0 times their processor time" in busy_text(bench_of([2.0], [4.0], share=0.5))


@pytest.fixture
def warm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels are ready: the child process of the warm-up is tested elsewhere."""
    monkeypatch.setattr(command, "warm_up", lambda groups: None)


def test_the_command_prints_a_table_and_a_verdict(warm: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--frames", "10", "--size", "160x120"]) == 0
    output = capsys.readouterr().out
    assert output.startswith("From a depth image of 160x120 pixels to planes")
    for part in (
        "street (buildings",
        "trees (foliage",
        "  merge ",
        "  whole frame, median",
        "Start: ",
        "numba ",
        "12 Hz needs",
    ):
        assert part in output


def test_json_holds_every_figure(warm: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--frames", "10", "--size", "160x120", "--hz", "5", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["size_px"] == [160, 120]
    assert printed["camera_hz"] == 5.0
    assert set(printed["views"]) == {"street", "trees"}
    for view in printed["views"].values():
        assert 0.0 < view["wall_p50_ms"] <= view["wall_p95_ms"] <= view["wall_p99_ms"]
        assert view["frames_per_second"] == pytest.approx(1000.0 / view["wall_p50_ms"], rel=0.01)
        assert view["planes"] > 0
        assert view["stages_cpu_ms"]["level"] > 0.0
    slowest = max(v["wall_p99_ms"] for v in printed["views"].values())
    assert printed["used_share"] == pytest.approx(slowest * 5.0 / 1000.0, abs=1e-4)


def test_only_the_kernels_that_are_measured_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Sequence[str]] = []
    monkeypatch.setattr(command, "warm_up", asked.append)
    assert main(["bench", "--frames", "10", "--size", "160x120", "--json"]) == 0
    assert asked == [("extractor", "simulated")]


def test_kernels_that_cannot_be_made_ready_are_reported(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(groups: Sequence[str]) -> None:
        raise WarmupError("the kernels do not run: a reason")

    monkeypatch.setattr(command, "warm_up", broken)
    assert main(["bench", "--frames", "10"]) == 1
    assert "the kernels do not run: a reason" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        (["--size", "640"], "such as 640x480"),
        (["--size", "16x9000"], "64..4096"),
        (["--frames", "1"], "expected 10..100000"),
        (["--frames", "ten"], "'ten': expected 10..100000"),
        (["--hz", "0"], "expected 0.1..1000"),
    ],
)
def test_wrong_use_is_reported(arguments: list[str], printed: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", *arguments]) == 2
    assert printed in capsys.readouterr().err


def test_parameters_come_from_a_configuration(warm: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    monkeypatch.setattr(command, "bench", lambda params, *_: given.append(params) or bench_of([1.0], [1.0]))
    file = tmp_path / "my.toml"
    file.write_text("[extractor]\ncolumn_step = 2\n")
    assert main(["bench", "-c", str(file), "--json"]) == 0
    assert given[0].column_step == 2


class Recorder(Extractor):
    """Notes what each frame is given and what it hands on."""

    def __init__(self) -> None:
        super().__init__()
        self.depths: list[Any] = []
        self.given: list[Any] = []
        self.handed_on: list[Any] = []

    def extract(self, depth: Any, info: Any, R: Any, state: Any = None, **kwargs: Any) -> Any:
        model, after = super().extract(depth, info, R, state, **kwargs)
        self.depths.append(depth)
        self.given.append(state)
        self.handed_on.append(after)
        return model, after


def test_images_are_flown_in_turn_and_each_hands_on_to_the_next() -> None:
    shot = render_sequence("poles", "poles", (160, 120), images=3)
    assert len({image.tobytes() for image in shot.depth_mm}) == 3, "they differ in their noise"
    recorder, interleaved = Recorder(), []
    measured = measure(shot, recorder, 6, watched=2, interleaved=(lambda: interleaved.append(1),))
    assert len(measured.times) == len(interleaved) == 6
    assert measured.planes > 0
    assert len(recorder.depths) > 6 + 2, "some are for warming up"
    assert all(image is shot.depth_mm[i % 3] for i, image in enumerate(recorder.depths))
    assert all(a is b for a, b in zip(recorder.given[1:], recorder.handed_on[:-1], strict=True))
    with pytest.raises(ValueError, match="at least one image"):
        FrameSequence(name="a", info=shot.info, R_level_optical=shot.R_level_optical, depth_mm=())


def test_a_clock_keeps_both_times_of_each_run(monkeypatch: pytest.MonkeyPatch) -> None:
    walls, cpus = iter([0, 5_000_000, 6_000_000, 9_000_000]), iter([0, 2_000_000, 2_000_000, 5_000_000])
    monkeypatch.setattr(time, "perf_counter_ns", lambda: next(walls))
    monkeypatch.setattr(time, "thread_time_ns", lambda: next(cpus))
    clock = Clock()
    assert [clock.run(lambda: "a"), clock.run(lambda: "b")] == ["a", "b"]
    times = clock.times()
    assert times.wall_ms.tolist() == [5.0, 3.0]
    assert times.cpu_ms.tolist() == [2.0, 3.0]
    assert (times.wall(), times.wall(99), times.cpu(99)) == (5.0, 5.0, 3.0)
    with pytest.raises(ValueError, match="times"):
        Times(np.zeros(0), np.zeros(0))


def test_one_core_is_held_and_given_back() -> None:
    before = os.sched_getaffinity(0)
    with one_core() as core:
        assert os.sched_getaffinity(0) == {core}
    assert os.sched_getaffinity(0) == before


def test_the_machine_is_named_by_its_processor() -> None:
    assert processor_model("processor : 0\nmodel name\t: A Processor @ 3 GHz\n") == "A Processor @ 3 GHz"
    assert processor_model("processor : 0\nCPU part : 0xd0b\nCPU part : 0xd0b\n") == "ARM cores of part 0xd0b"
    assert processor_model("") == ""
    assert host_info().cores >= 1
    assert BOARD.text() == "A board, Cortex-A76, aarch64, 4 cores, clock governor performance, Linux"
    assert versions()["numba"][0].isdigit()
