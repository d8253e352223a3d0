"""The page: it holds the frames, asks nothing of the network, and its own arithmetic agrees with ours."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import companion
from companion.viewer.colors import depth_index, palette, range_index
from companion.viewer.depth import plane_outlines_px
from companion.viewer.frame import ViewFrame
from companion.viewer.geometry import level_range_m, nearest_m
from companion.viewer.page import DEPTH_BUDGET_BYTES, DEPTH_WIDTHS_PX, PageBuilder, depth_width_px, small_index
from core.types import Ground

from ..view_scenes import INFO, blind, frame, tilted

VIEWER = Path(companion.__file__).parent / "viewer" / "static"


def page_of(*frames: ViewFrame, note: str = "") -> str:
    builder = PageBuilder("test.mcap", len(frames))
    for f in frames:
        builder.add(f)
    return builder.page(note)


def data_of(page: str) -> Any:
    found = re.search(r'<script type="text/plain" id="data">([^<]*)</script>', page)
    assert found is not None
    return json.loads(gzip.decompress(base64.b64decode(found.group(1))))


def test_page_holds_every_frame_with_its_planes_and_prisms() -> None:
    data = data_of(page_of(frame(), blind(), tilted(), note="a part of it"))
    assert data["title"] == "test.mcap"
    assert data["note"] == "a part of it"
    assert [f["status"] for f in data["frames"]] == ["VALID", "BLIND", "VALID"]
    assert [c["name"] for c in data["cameras"]] == ["front", "left"]
    assert [f["c"] for f in data["frames"]] == [0, 0, 1]
    first = data["frames"][0]
    assert first["planes"] == [400, -100, 400, 100, -60, 80]
    assert first["prisms"] == [[0, -60, 80, 0, 20, [400, -100, 400, 100], [0]]]
    assert first["free"]["to"] == [300, 400, 0, 0]
    assert first["ground"] == [2.0, 0.01, 0.0]
    assert first["t"] == 0.0
    assert bytes.fromhex(data["palette"]) == palette().tobytes()


def half_open() -> ViewFrame:
    """The frame with one direction presumed free from 1 to 6 m at the camera's height."""
    made = frame()
    assert made.model is not None
    begin, end = np.zeros((2, 2), np.uint8), np.zeros((2, 2), np.uint8)
    begin[0, 1], end[0, 1] = 10, 60
    return replace(made, model=replace(made.model, free=replace(made.model.free, open_from_dm=begin, open_to_dm=end)))


def below() -> ViewFrame:
    """The frame with a third layer, the middle of which is 0.5 m below the ground; all are free to 4 m."""
    made = frame()
    assert made.model is not None
    free = replace(
        made.model.free,
        layer_edges_m=np.array([-3.0, -1.0, 1.0, 4.0], np.float32),
        free_from_m=np.full((2, 3), 0.5, np.float32),
        free_to_m=np.full((2, 3), 4.0, np.float32),
        end=np.ones((2, 3), np.uint8),
    )
    return replace(made, model=replace(made.model, free=free))


def test_page_holds_open_space_apart_from_free_space() -> None:
    plain, opened = (f["free"] for f in data_of(page_of(frame(), half_open()))["frames"])
    assert "openTo" not in plain
    assert opened["openFrom"] == [0, 100, 0, 0]
    assert opened["openTo"] == [0, 600, 0, 0]
    assert opened["to"] == plain["to"]


def test_blind_frame_carries_its_cause_and_nothing_that_could_be_taken_as_free() -> None:
    f = data_of(page_of(blind()))["frames"][0]
    assert f["cause"] == "too few pixels hold a measurement"
    assert f["free"] is None
    assert f["planes"] == f["prisms"] == []


def test_depth_image_of_the_page_is_the_picked_bytes() -> None:
    rng = np.random.default_rng(3)
    depth = rng.integers(0, 65536, (240, 320)).astype(np.uint16)
    f = data_of(page_of(frame(depth_mm=depth)))["frames"][0]
    image = cv2.imdecode(np.frombuffer(base64.b64decode(f["depth"]), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, depth_index(depth, INFO, 0.005))
    small = small_index(depth, INFO, 80)
    assert small.shape == (60, 80)
    np.testing.assert_array_equal(small, depth_index(depth, INFO)[2::4, 2::4])


def test_many_frames_make_smaller_images() -> None:
    widths = [depth_width_px(n) for n in (1, 100, 300, 600, 100_000)]
    assert widths == sorted(widths, reverse=True)
    assert widths[0] == DEPTH_WIDTHS_PX[0]
    assert 600 * widths[3] ** 2 * 0.75 * 0.3 < DEPTH_BUDGET_BYTES


def test_page_makes_no_network_requests() -> None:
    page = page_of(frame())
    ours = page.replace((VIEWER / "three.module.min.js").read_text("utf-8"), "")
    assert len(ours) < len(page) - 500_000, "three.js lies in the page"
    assert not re.search(r"https?://", ours)
    # the one address in three.js is the name of an XML namespace, which is never loaded
    assert set(re.findall(r"https?://[\w./-]+", page)) == {"http://www.w3.org/1999/xhtml"}
    assert not re.search(r"<(link|iframe|object)\b|\b(src|href)\s*=\s*[\"'](?!data:)", ours)
    assert "default-src 'none'" in page
    assert "The MIT License" in page
    assert "@@" not in ours
    assert len(page) < 1_500_000


def test_same_frames_make_the_same_page() -> None:
    assert page_of(tilted(), blind()) == page_of(tilted(), blind())


def test_page_without_frames_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one frame"):
        PageBuilder("empty", 0).page()


def test_title_and_note_cannot_break_out_of_the_page() -> None:
    builder = PageBuilder("</script><script>alert(1)</script>.mcap", 1)
    builder.add(frame())
    page = builder.page()
    assert "alert(1)" not in page
    assert data_of(page)["title"].endswith("alert(1)</script>.mcap")


def uphill() -> ViewFrame:
    """The ground rises to the camera's height 2.5 m ahead, less a tolerance of 0.25 m."""
    made = frame()
    assert made.model is not None
    ground = Ground(seen=True, height_m=0.5, slope_x=-0.2, tolerance_m=0.25, noise_per_m=0.01)
    return replace(made, model=replace(made.model, ground=ground))


SCRIPT = """
import * as m from "./model.mjs";
import { readFileSync } from "node:fs";
const { frames, cameras } = JSON.parse(readFileSync("data.json", "utf8"));
const out = frames.map((f) => {
  const camera = cameras[f.c], walls = m.planeWalls(f);
  const place = m.worldFromLevel(f, "ned"), p = [1, 2, 3];
  const sectors = (kind) => m.layersOf(f, false).flatMap(({ layer }) => m.spaceSectors(f, kind, layer, 0));
  return {
    place, back: m.toLevel(m.toWorld(p, place), place), world: m.toWorld(p, place),
    distances: walls.map((w) => w.distance), index: walls.map((w) => m.rangeIndex(w.distance, camera)),
    pixels: walls.map((w) => [[w.ax, w.ay, w.top], [w.bx, w.by, w.top], [w.bx, w.by, w.bottom], [w.ax, w.ay, w.bottom]]
      .map((c) => m.projectPixel(c, camera, f))),
    roundtrip: m.projectPixel(m.pixelPoint(100, 50, 4, camera, f), camera, f),
    prisms: m.prismWalls(f).map((w) => [w.ax, w.ay, w.bx, w.by, w.top, w.bottom, w.flags]), sectors: sectors("free"), opened: sectors("open"),
    layers: m.layersOf(f, true).map(({ layer }) => m.spaceSectors(f, "free", layer, 0).length),
  };
});
const times = [0, 1, 2, 2, 5].map((t, k) => ({ t, c: k % 2 }));
console.log(JSON.stringify({ out, at: [-1, 0, 1.5, 2, 4.9, 9].map((t) => m.frameAt(times, t)),
  steps: [m.stepFrame(times, 0, 1, -1), m.stepFrame(times, 0, 1, 0), m.stepFrame(times, 4, 1, -1), m.stepFrame(times, 3, -1, 0)],
  normal: m.freeNormal(5, -1, 5, 1), drawing: m.toDrawing([1, 2, 3]), words: [m.flagWords(0), m.flagWords(3)],
  points: m.depthPoints(Uint8Array.from([0, 255, 100, 101]), 2, cameras[0], frames[0]).bytes }));
"""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Any:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no JavaScript engine (node) here to run the page's arithmetic")
    folder = tmp_path_factory.mktemp("node")
    shutil.copy(VIEWER / "model.js", folder / "model.mjs")
    (folder / "data.json").write_text(json.dumps(data_of(page_of(frame(), tilted(), uphill(), half_open(), below()))))
    (folder / "ask.mjs").write_text(SCRIPT)
    done = subprocess.run([node, "ask.mjs"], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("which", [0, 1])
def test_page_projects_and_measures_as_the_pictures_do(answers: Any, which: int) -> None:
    f = (frame(), tilted())[which]
    assert f.model is not None
    out = answers["out"][which]
    np.testing.assert_allclose(out["distances"], nearest_m(f.model.planes), atol=0.02)
    assert np.abs(np.array(out["index"]) - range_index(nearest_m(f.model.planes), f.info)).max() <= 1
    seen = 0
    for corners, outline in zip(out["pixels"], plane_outlines_px(f), strict=True):
        if None in corners:
            continue
        np.testing.assert_allclose(corners, outline, atol=2.0)  # the page's lengths are whole centimetres
        seen += 1
    assert seen >= 1
    np.testing.assert_allclose(out["roundtrip"], [100, 50], atol=0.05)


def test_page_places_the_vehicle_in_the_world(answers: Any) -> None:
    out = answers["out"][1]
    np.testing.assert_allclose(out["place"]["t"], [5, -2, -3])
    yaw = 0.7
    expected = [5 + np.cos(yaw) - 2 * np.sin(yaw), -2 + np.sin(yaw) + 2 * np.cos(yaw), 0.0]
    np.testing.assert_allclose(out["world"], expected, atol=2e-3)
    np.testing.assert_allclose(out["back"], [1, 2, 3], atol=1e-9)


def test_page_ends_free_space_where_the_ground_rises_into_it(answers: Any) -> None:
    made = uphill()
    assert made.model is not None
    (sector,) = answers["out"][2]["sectors"]
    clear = level_range_m(made.model.ground, np.array([-0.6, 0.0]))
    assert clear[1] == pytest.approx(0.25 / 0.2)
    expected = [0.5, clear.min(), clear.min(), 0.5]
    np.testing.assert_allclose(np.hypot(*np.array(sector).T), expected, atol=1e-3)


def test_page_draws_no_free_space_inside_the_ground(answers: Any) -> None:
    """In `below` each layer is free to 4 m; the middle of the lowest one is 0.5 m below the ground."""
    assert answers["out"][0]["layers"] == [1, 1]
    assert answers["out"][4]["layers"] == [2, 2, 0]


def test_page_reads_prisms_free_space_and_time(answers: Any) -> None:
    out = answers["out"][0]
    assert out["prisms"] == [[4, -1, 4, 1, -0.6, 0.8, 0]]
    (sector,) = out["sectors"]  # the right-hand direction is not known free, the camera flies in the second layer
    np.testing.assert_allclose(np.hypot(*np.array(sector).T), [0.5, 4.0, 4.0, 0.5], atol=1e-6)
    np.testing.assert_allclose(np.arctan2(sector[0][1], sector[0][0]), -0.6, atol=1e-6)
    assert answers["at"] == [0, 0, 1, 3, 3, 4]
    assert answers["steps"] == [1, 2, 4, 2]
    assert answers["normal"] == [-1, 0]
    assert answers["drawing"] == [2, -3, -1]
    assert answers["words"] == ["fully measured", "partly inferred, unknown behind"]
    assert answers["points"] == [100, 101]


def test_page_draws_open_space_beyond_what_is_free(answers: Any) -> None:
    assert [out["opened"] for out in answers["out"][:3]] == [[], [], []]
    ((near_left, far_left, *_),) = answers["out"][3]["opened"]
    assert np.hypot(*near_left) == pytest.approx(4.0, abs=0.02)
    assert np.hypot(*far_left) == pytest.approx(6.0, abs=0.02)
