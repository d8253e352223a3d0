"""Tracked obstacles in the viewer: their place in `level`, and the frames of a log that they belong to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

from companion.live.status import status_lines
from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.pipeline.encode import prisms_message
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.viewer.autopilot_view import autopilot_data
from companion.viewer.live_camera import Shown
from companion.viewer.live_page import decoded, frame_of
from companion.viewer.log import TRACKS_WAITING, read_frames
from companion.viewer.page import PageBuilder
from companion.viewer.tracks import tracks_data
from drivers.logs.codec import camera_message
from drivers.logs.reader import McapRecording
from osape_client.proto import osape_v1_pb2 as pb

from ..browser import Browser, opened
from ..small_recordings import INFO, EasyExtractor, flight
from ..view_scenes import frame


def message(frame_name: str = "ned") -> pb.Tracks:
    """A wall 4 m north of (10, 20, -3) and a person who walks east beside it."""
    m = pb.Tracks(schema_version=1, camera="front", sequence=7, frame=frame_name, valid=True)
    m.id.extend([5, 9])
    m.corners_m.extend([14, 19, 14, 21, -3.6, -2.2, 13, 22, 13, 22.5, -3.5, -2])
    m.confidence.extend([1.0, 0.5])
    m.unseen_ns.extend([0, 200_000_000])
    m.object_id.extend([0, 3])
    o = m.objects.add(id=3, velocity_x_m_s=0.0, velocity_y_m_s=1.5)
    o.centre_m.x, o.centre_m.y, o.centre_m.z = 13.0, 22.25, -2.75
    o.half_size_m.x, o.half_size_m.y, o.half_size_m.z = 0.1, 0.25, 0.75
    return m


@pytest.mark.unit
def test_tracks_are_rotated_from_ned_to_the_vehicles_level() -> None:
    data = tracks_data(message(), math.pi / 2, (10.0, 20.0, -3.0))  # the nose points east
    assert data is not None
    assert data["planes"][:6] == [-100, -400, 100, -400, -60, 80]
    assert data["confidence"] == [100, 50]
    mover = data["movers"][0]
    assert (mover["from"], mover["to"]) == ([225, -300, 25], [375, -300, 25])
    assert mover["text"] == "moving 3: 1.5 m/s"
    assert (mover["top"], mover["bottom"]) == (-50, 100)


def prisms_of_a_flight() -> pb.PrismsFrame:
    """The newest valid frame of a flight, with a prism."""
    pipeline = Pipeline((INFO,), EasyExtractor)
    results = [r for event in flight(10) for r in pipeline.handle(event) if isinstance(r, PrismsResult) and r.valid]
    whole = prisms_message(results[-1])
    del whole.prisms[:]
    whole.prisms.add(
        top_m=-2.0, bottom_m=0.0, margin_m=0.1, closed=True, vertices_m=[4, -1, 4, 1, 5, 0], plane=[0, 0, 0]
    )
    return whole


def put(m: Any, path: str, value: float) -> None:
    """Sets a field by its path, such as `objects.0.centre_m.z`."""
    *parents, name = path.split(".")
    for parent in parents:
        m = m[int(parent)] if parent.isdigit() else getattr(m, parent)
    if name.isdigit():
        m[int(name)] = value
    else:
        setattr(m, name, value)


@pytest.mark.unit
@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize(
    "path",
    ["corners_m.3", "confidence.1", "objects.0.centre_m.z", "objects.0.half_size_m.z", "objects.0.velocity_x_m_s"],
)
def test_tracks_with_a_number_that_is_not_finite_are_not_drawn(path: str, value: float) -> None:
    """It must not end the answer, which contains all cameras."""
    broken = message("level")
    put(broken, path, value)
    assert tracks_data(broken, 0.0, None) is None


@pytest.mark.unit
@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize(
    "path",
    [
        "planes.corners_m.0",
        "planes.margin_m.0",
        "prisms.0.vertices_m.0",
        "prisms.0.margin_m",
        "prisms.0.top_m",
        "pose.position_ned_m.x",
        "attitude.q_ned_frd.w",
        "transform.yaw_rad",
        "transform.translation_m.z",
    ],
)
def test_a_frame_with_a_number_that_is_not_finite_has_no_result_and_is_blind(path: str, value: float) -> None:
    """The page draws it as blind, and the server for Foxglove reports it so by the same function."""
    whole = prisms_of_a_flight()
    assert decoded(whole)[1] == ""
    put(whole, path, value)
    result, cause = decoded(whole)
    assert result is None
    assert "is the message damaged?" in cause
    drawn = frame_of(Shown(1, INFO, whole, None, 0, message()), 0)
    assert "is the message damaged?" in drawn["cause"]
    assert drawn["planes"] == []


@pytest.mark.unit
@pytest.mark.parametrize("name", ["first_deg", "step_deg"])
def test_sectors_whose_directions_are_not_finite_are_not_drawn(name: str) -> None:
    health = pb.Health(autopilot=pb.AutopilotHealth(autopilot="PX4"))
    health.autopilot.obstacles_echoed.cm.extend([100, 200])
    setattr(health.autopilot.obstacles_echoed, name, math.nan)
    data = autopilot_data(health, 0)
    assert data is not None
    assert data["echoed"] is None


@pytest.mark.unit
def test_a_damaged_description_of_a_camera_is_a_line_of_the_status() -> None:
    health = pb.Health(schema_version=1)
    health.cameras.add(camera="front", condition="running", info=camera_message(INFO)).info.fx_px = math.nan
    assert "  its description is damaged: intrinsics: fx is not finite" in status_lines(health)


@pytest.mark.unit
def test_tracks_whose_place_is_unknown_are_not_drawn() -> None:
    assert tracks_data(message(), 0.0, None) is None
    level = tracks_data(message("level"), 1.0, (1.0, 1.0, 1.0))
    assert level is not None
    assert level["planes"][:2] == [1400, 1900]
    assert tracks_data(pb.Tracks(), 0.0, (0.0, 0.0, 0.0)) is None
    damaged = message()
    del damaged.corners_m[-1]
    assert tracks_data(damaged, 0.0, (0.0, 0.0, 0.0)) is None


def frames_of(path: Path, order: list[tuple[str, int]]) -> list[tuple[int, bool]]:
    """(sequence, whether it has tracks) of the frames of a log with these messages."""
    with LogWriter(path) as log:
        log.begin(run_info("live"), (INFO,))
        for n, (kind, k) in enumerate(order):
            m = pb.PrismsFrame if kind == "prisms" else pb.Tracks
            log.write(kind, m(schema_version=1, camera="front", sequence=k, t_exposure_ns=k), n, "front", k)
    with McapRecording(path) as source:
        return [(f.sequence, f.tracks is not None) for f in read_frames(source)]


@pytest.mark.unit
def test_each_frame_of_a_log_has_its_own_tracks(tmp_path: Path) -> None:
    """The log contains them after the prisms, and may contain those of two frames together."""
    order = [("prisms", 1), ("tracks", 1), ("prisms", 2), ("prisms", 3), ("tracks", 2), ("tracks", 3), ("prisms", 4)]
    assert frames_of(tmp_path / "a.mcap", order) == [(1, True), (2, True), (3, True), (4, False)]
    lost = [("prisms", 1), ("prisms", 2), ("tracks", 2), ("tracks", 9)]
    assert frames_of(tmp_path / "b.mcap", lost) == [(1, False), (2, True)]
    none = [("prisms", k) for k in range(TRACKS_WAITING + 3)]
    assert frames_of(tmp_path / "c.mcap", none) == [(k, False) for k in range(TRACKS_WAITING + 3)]


@pytest.mark.unit
def test_the_live_page_draws_the_tracks_of_a_valid_frame() -> None:
    prisms = prisms_of_a_flight()
    drawn = frame_of(Shown(1, INFO, prisms, None, 0, message()), 0)["tracks"]
    assert drawn is not None
    assert drawn["id"] == [5, 9]
    assert frame_of(Shown(1, INFO, prisms, None, 0), 0)["tracks"] is None
    prisms.valid = False
    assert frame_of(Shown(1, INFO, prisms, None, 0, message()), 0)["tracks"] is None, "a blind frame shows nothing"


LEGEND = "document.getElementById('marks').textContent"
AT_THE_WALL = """(() => {
  const frame = app.data.frames[0], mover = frame.tracks.movers[0], [ax, ay, bx, by, top, bottom] = frame.planes;
  Object.assign(mover, { from: [(ax + bx) / 2, (ay + by) / 2, (top + bottom) / 2], top, bottom, text: "moving" });
  return app.show(0);
})()"""
BOXES = """Object.fromEntries(app.frames.group.children.filter((o) => o.isSprite).map((o) => {
  const tall = 2 * Math.tan(app.eye.fov * Math.PI / 360), middle = o.position.clone().project(app.eye).y / 2 * tall;
  return [o.name, [middle - o.center.y * o.scale.y, middle + (1 - o.center.y) * o.scale.y]];
}))"""
"""Lower and upper edge of each label on the screen."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with opened(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


@pytest.mark.process
@pytest.mark.parametrize("size", [(1200, 800), (390, 844)])
def test_the_speed_of_a_mover_does_not_cover_its_distance(
    browser: Browser, tmp_path: Path, size: tuple[int, int]
) -> None:
    builder = PageBuilder("tracks.mcap", 1)
    builder.add(frame(position_ned_m=(0.0, 0.0, -2.0), tracks=tracks_data(message(), 0.0, (10.0, 20.0, -3.0))))
    page = tmp_path / "tracks.html"
    page.write_text(builder.page(), encoding="utf-8")
    with browser.page("data:text/html,wait") as shown:
        shown.call(
            "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
        )
        shown.call("Page.navigate", url=page.as_uri())
        shown.wait("document.body?.dataset.drawn === '0'")
        assert shown.ask("[innerWidth, innerHeight]") == list(size)
        shown.ask(AT_THE_WALL)
        boxes = shown.ask(BOXES)
    assert boxes["moving"][0] >= boxes["4.0 m"][1]


@pytest.mark.process
def test_the_page_draws_outlines_and_the_arrow_of_what_moves(browser: Browser, tmp_path: Path) -> None:
    place = (10.0, 20.0, -3.0)
    plain = frame(position_ned_m=place)
    moving = dataclasses.replace(plain, sequence=8, t_ns=plain.t_ns + 10**8, tracks=tracks_data(message(), 0.0, place))
    builder = PageBuilder("tracks.mcap", 2)
    for f in (plain, moving):
        builder.add(f)
    page = tmp_path / "tracks.html"
    page.write_text(builder.page(), encoding="utf-8")
    pink = {}
    for k in (0, 1):
        target = tmp_path / f"{k}.png"
        with browser.page(f"{page.as_uri()}#frame={k}&numbers=1") as shown:
            shown.wait(f"document.body.dataset.drawn === '{k}'")
            assert shown.ask("document.getElementById('tracks').parentElement.hidden") is False
            shown.picture(target)
            assert shown.ask(LEGEND).startswith("trackedmovingfree")
            shown.ask("document.getElementById('tracks').click()")
            assert "tracked" not in shown.ask(LEGEND)
        b, g, r = cv2.split(cv2.imread(str(target)).astype(int))
        pink[k] = int(((r > 120) & (b > 100) & (g < r - 60) & (g < b - 30)).sum())
    assert not browser.complaints
    assert pink[1] > pink[0] + 100
