"""`companion view` on logs: complete, without prisms, damaged, partly blind."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.cli import main
from companion.log.log_writer import LogWriter, write_recording
from companion.log.provenance import run_info
from companion.pipeline.encode import prisms_message
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.replay.replay import Options, replay
from companion.viewer.frame import FrameStatus
from companion.viewer.log import WAITING, LoggedFrame, read_frames
from companion.viewer.strips import StripFinder
from companion.viewer.view import PAGE_NAME, ViewOptions, make_views
from core.extractor import Extractor
from core.params import Params
from core.types import DepthFrame
from drivers.base import BadData, DeviceNotFound
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import SimulatedFlight
from osape_client.proto import osape_v1_pb2 as pb

from ..recordings import frames_of
from ..small_recordings import INFO, EasyExtractor, flight


@pytest.fixture(scope="module")
def depth_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "broken.mcap"
    write_recording(SimulatedFlight("broken", width=96, height=72), path, run_info("simulated"))
    return path


@pytest.fixture(scope="module")
def log(depth_only: Path) -> Path:
    path = depth_only.with_name("prisms.mcap")
    replay(depth_only, Options(output=path))
    return path


@pytest.fixture(scope="module")
def logged(log: Path) -> list[LoggedFrame]:
    with McapRecording(log) as source:
        return list(read_frames(source))


def page_data(folder: Path) -> Any:
    page = (folder / PAGE_NAME).read_text("utf-8")
    found = re.search(r'id="data">([^<]*)<', page)
    assert found is not None
    return json.loads(gzip.decompress(base64.b64decode(found.group(1))))


def test_every_frame_comes_back_with_its_image_and_its_model(log: Path, logged: list[LoggedFrame]) -> None:
    frames = [item.frame() for item in logged]
    assert [f.status for f in frames] == [item.status for item in logged]
    assert [0 if f.model is None else len(f.model.planes) for f in frames] == [item.plane_count for item in logged]
    recorded: list[DepthFrame] = frames_of(log)
    assert [f.sequence for f in frames] == [d.sequence for d in recorded]
    assert len(frames) == 57
    for f, d in zip(frames, recorded, strict=True):
        assert f.depth_mm is not None
        np.testing.assert_array_equal(f.depth_mm, d.depth_mm)
        assert f.t_ns == d.t_exposure_ns
    statuses = {s: sum(f.status is s for f in frames) for s in FrameStatus}
    assert statuses == {FrameStatus.VALID: 40, FrameStatus.BLIND: 17, FrameStatus.NO_PRISMS: 0}
    causes = {f.cause for f in frames if f.status is FrameStatus.BLIND}
    assert any("too few pixels" in c for c in causes)
    assert any("attitude" in c and c.startswith("frame not used") for c in causes)


def test_model_comes_back_in_the_cameras_own_level_frame(logged: list[LoggedFrame]) -> None:
    """Extracted anew from the same state, the same planes: the way into ned and back is undone."""
    extractor, compared = Extractor(Params()), 0
    for item in logged[:8]:
        f = item.frame()
        if f.status is not FrameStatus.VALID:
            continue
        assert f.model is not None
        assert f.depth_mm is not None
        assert f.R_level_cam_optical is not None
        assert f.position_ned_m is not None
        model, _ = extractor.extract(f.depth_mm, f.info, f.R_level_cam_optical, item.state)
        np.testing.assert_allclose(f.model.planes, model.planes, atol=2e-4)
        assert f.model.ground.height_m == pytest.approx(model.ground.height_m)
        np.testing.assert_allclose(f.model.free.azimuth_edges_rad, model.free.azimuth_edges_rad, atol=1e-5)
        compared += len(model.planes)
    assert compared > 8


def test_strips_are_found_again_for_the_logged_planes_only(logged: list[LoggedFrame]) -> None:
    item = next(i for i in logged if i.plane_count > 2)
    frame = item.frame()
    found = StripFinder(Params()).with_strips(frame, item.state)
    assert found.model is not None
    assert found.model.strips is not None
    assert len(found.model.strips.u) > 10
    other = StripFinder(Params(min_obstacle_height_m=2.0)).with_strips(frame, item.state)
    assert other is frame, "another configuration's strips are not this log's"


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are empty files: which frames are chosen is the subject, test_view_png.py tests what is drawn."""
    monkeypatch.setattr("companion.viewer.view.save_frame", lambda frame, path, **options: path.touch())


@pytest.mark.usefixtures("undrawn")
def test_default_choice_draws_a_handful_and_the_page(log: Path, tmp_path: Path) -> None:
    views = make_views(log, tmp_path / "made" / "here")
    assert 5 <= len(views.pictures) <= 7
    assert all(p.is_file() for p in views.pictures)
    assert (views.frames, views.valid, views.blind, views.damage) == (57, 40, 17, "")
    assert views.page == tmp_path / "made" / "here" / PAGE_NAME
    data = page_data(tmp_path / "made" / "here")
    assert len(data["frames"]) == 57
    assert data["note"] == ""
    assert sum(f["status"] == "BLIND" for f in data["frames"]) == 17


@pytest.mark.usefixtures("undrawn")
def test_frames_can_be_asked_for(log: Path, tmp_path: Path) -> None:
    views = make_views(log, tmp_path, ViewOptions(frames=(3, 40), page=False))
    assert [p.name for p in views.pictures] == ["frame_front_000003.png", "frame_front_000040.png"]
    assert not (tmp_path / PAGE_NAME).exists()
    every = make_views(log, tmp_path, ViewOptions(every=30, page=False))
    assert len(every.pictures) == 2
    with pytest.raises(ValueError, match=r"frame 999 is not in the log; its frames are 0 \.\. 60"):
        make_views(log, tmp_path, ViewOptions(frames=(999,)))


def test_log_without_prisms_names_the_remedy_and_shows_the_depth(depth_only: Path, tmp_path: Path) -> None:
    views = make_views(depth_only, tmp_path, ViewOptions(frames=(0,)))
    assert views.without_prisms == views.frames == 57
    assert "run `companion replay` first" in views.notes[0]
    data = page_data(tmp_path)
    assert data["frames"][0]["status"] == "NO_PRISMS"
    assert data["frames"][0]["depth"]


def test_damaged_log_is_drawn_as_far_as_it_goes(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    status = main(["view", str(cut), "-o", str(tmp_path / "out"), "--json", "--frame", "0"])
    out, err = capsys.readouterr()
    report = json.loads(out)
    assert status == 1
    assert 5 < report["frames"] < 57
    assert "companion recover" in err
    assert "companion recover" in report["damage"]
    data = page_data(tmp_path / "out")
    assert len(data["frames"]) == report["frames"]
    assert "damaged" in data["note"]


def test_wrong_use_and_missing_files(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(log)]) == 2
    assert main(["view", str(log), "-o", str(tmp_path), "--every", "0"]) == 2
    assert main(["view", str(tmp_path / "none.mcap"), "-o", str(tmp_path / "x")]) == 1
    assert "does not exist" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
    with pytest.raises(DeviceNotFound):
        make_views(tmp_path / "none.mcap", tmp_path)
    with pytest.raises(ValueError, match="expected 1 or more"):
        ViewOptions(every=0)


def test_a_foreign_log_is_refused(shared_data: Path, tmp_path: Path) -> None:
    with pytest.raises(BadData, match="not a recording of this software"):
        make_views(shared_data / "mcap" / "keelson_ais_protobuf.mcap", tmp_path / "x")


def test_command_prints_what_it_drew(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", str(log), "-o", str(tmp_path), "--frame", "12", "--no-page"]) == 0
    out = capsys.readouterr().out
    assert "57 frames: 40 valid, 17 blind" in out
    assert "frame_front_000012.png" in out
    assert (tmp_path / "frame_front_000012.png").stat().st_size > 20_000


def made_by_hand(path: Path, order: list[tuple[str, int]], spoil: int | None = None) -> Path:
    """A log of frames in the order given: ("depth", n), ("duplicate", n) or ("prisms", n). spoil: that frame's prisms
    come from a version of the future."""
    pipeline = Pipeline((INFO,), EasyExtractor)
    results, frames = {}, {}
    for event in flight(40):
        for output in pipeline.handle(event):
            if isinstance(output, PrismsResult):
                results[output.sequence] = output
        if isinstance(event, DepthFrame):
            frames[event.sequence] = event
    with LogWriter(path) as log:
        log.begin(run_info("live"), (INFO,))
        for kind, n in order:
            if kind == "depth":
                log.event(frames[n])
            elif kind == "prisms":
                message = prisms_message(results[n])
                message.schema_version = 99 if n == spoil else message.schema_version
                log.write("prisms", message, results[n].t_arrival_ns, "front", n)
            else:
                late = pb.FrameDecision(camera="front", sequence=n, t_exposure_ns=frames[n].t_exposure_ns)
                late.cause = pb.CAUSE_DUPLICATE_FRAME
                log.write("decision", late, frames[n].t_arrival_ns, "front", n)
    return path


def frames_in(path: Path) -> list[tuple[int, FrameStatus, bool]]:
    with McapRecording(path) as source:
        return [(f.sequence, f.status, f.depth_mm is not None) for f in read_frames(source)]


def test_prisms_find_their_depth_in_a_live_logs_order(tmp_path: Path) -> None:
    order = [("depth", 0), ("depth", 1), ("prisms", 0), ("depth", 2), ("duplicate", 2), ("prisms", 1), ("depth", 3)]
    assert frames_in(made_by_hand(tmp_path / "live.mcap", order)) == [
        (0, FrameStatus.VALID, True),
        (1, FrameStatus.VALID, True),
        (3, FrameStatus.NO_PRISMS, True),
    ]
    assert frames_in(made_by_hand(tmp_path / "nodepth.mcap", [("prisms", 5)])) == [(5, FrameStatus.VALID, False)]


def test_depth_without_prisms_does_not_pile_up(tmp_path: Path) -> None:
    path = made_by_hand(tmp_path / "depth.mcap", [("depth", n) for n in range(WAITING + 5)])
    with McapRecording(path) as source:
        first = next(read_frames(source))
        assert first.sequence == 0
        assert source.share_read < 1.0, "the first one is handed on before the log is at its end"
    assert frames_in(path) == [(n, FrameStatus.NO_PRISMS, True) for n in range(WAITING + 5)]


@pytest.mark.usefixtures("undrawn")
def test_prisms_of_another_version_are_left_out_and_reported(tmp_path: Path) -> None:
    order = [(kind, n) for n in range(3) for kind in ("depth", "prisms")]
    path = made_by_hand(tmp_path / "future.mcap", order, spoil=1)
    views = make_views(path, tmp_path / "out", ViewOptions(every=1))
    assert [p.stem[-1] for p in views.pictures] == ["0", "2"]
    assert "frame 1 was left out: prisms of schema version 99" in views.damage
    assert len(page_data(tmp_path / "out")["frames"]) == 2
