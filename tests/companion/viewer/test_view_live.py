"""The live page in a real browser, with the service, its camera and `companion view` as processes: old, blind or
interrupted data are never shown as present."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
import zmq

from companion.streams.publisher import Publisher, Stream
from tests.waiting import PATIENCE_S, until

from ..browser import Browser, Page, opened
from ..live_service import ROOT, Live, flown
from .test_live_team import message as team_message

pytestmark = [pytest.mark.process, pytest.mark.realtime]

CONFIG = """
[[camera]]
name = "front"
kind = "simulated"
flight = "street"
width_px = 160
fps = 15.0
device = "{cable}"

[autopilot]
address = "udpin:127.0.0.1:{port}"

[publish]
world = "ipc://{run}/world"
world_requests = "ipc://{run}/world-snapshot"

[record]
record = "off"

[supervision]
restart_s = 1.0
first_backoff_s = 0.5
longest_backoff_s = 1.0
"""
STATE, BANNER = "document.body.dataset.state", "document.getElementById('banner').textContent"
VALID = f"{STATE} === 'valid' && app.frames.shown?.length > 0"


def shows(words: str) -> str:
    """That the page is red and shows the cause."""
    return f"{STATE} !== 'valid' && document.getElementById('banner').className === 'blind' && {BANNER}.includes({words!r})"


class Following:
    """A service, `companion view --live` beside it, and its page in a browser."""

    def __init__(self, live: Live, view: subprocess.Popen[str], address: str, page: Page) -> None:
        self.live, self.view, self.address, self.page = live, view, address, page


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with opened(tmp_path_factory.mktemp("browser"), "640,420") as browser:  # small: drawn by the processor
        yield browser


@pytest.fixture(scope="module")
def following(browser: Browser, tmp_path_factory: pytest.TempPathFactory, renders: Path) -> Iterator[Following]:
    live = Live(tmp_path_factory.mktemp("live"), CONFIG, renders)
    command = [sys.executable, "-m", "companion", "view", "--live", "-c", str(live.config), "--port", "0"]
    with (
        flown(live),
        subprocess.Popen(command, cwd=ROOT, env=live.environment, stdout=subprocess.PIPE, text=True) as view,
    ):
        try:
            live.start()
            assert view.stdout is not None
            address = re.search(r"http://\S+", view.stdout.readline())
            assert address is not None
            yield Following(live, view, address.group(), browser.page(address.group()))
            view.terminate()
            assert view.wait(PATIENCE_S) == 0
            assert live.stop() == 0
        finally:
            view.kill()
            live.close()


@pytest.fixture
def page(following: Following) -> Page:
    """The page, following a service that sees."""
    following.page.wait(VALID)
    return following.page


def test_depth_planes_and_health_are_shown(page: Page, tmp_path: Path) -> None:
    page.wait("!document.getElementById('depth').hidden && app.data.frames.at(-1).depth !== null")
    page.wait("document.getElementById('health').textContent.includes('camera front: running')")
    page.wait(f"{STATE} === 'valid' && Number(document.body.dataset.shown) < 1")
    page.picture(tmp_path / "live.png")
    image = cv2.imread(str(tmp_path / "live.png"))
    assert image is not None
    assert len(np.unique(image[60:300:2, 10:270:2].reshape(-1, 3), axis=0)) > 200, "walls, ground, words"


PLACED = """(async () => {
  const model = await import("viewer/model"), { world } = app.frames.ned, frame = app.data.frames[app.at];
  if (!frame.pos) return Infinity;  // a frame without a position, drawn at the last known one
  const ned = app.planes, apart = [];
  world.updateMatrixWorld();
  const m = world.matrixWorld.elements, p = world.children[0].geometry.attributes.position.array;
  for (let k = 0; k < ned.length / 6; k++) {
    const [ax, ay, , , top] = ned.slice(6 * k, 6 * k + 5).map((cm) => cm / 100), q = p.slice(18 * k, 18 * k + 3);
    const drawn = [0, 1, 2].map((i) => m[i] * q[0] + m[4 + i] * q[1] + m[8 + i] * q[2] + m[12 + i]);
    const right = model.toDrawing(model.toLevel([ax, ay, top], { yaw: frame.heading, t: frame.pos }));
    apart.push(Math.hypot(...drawn.map((v, i) => v - right[i])));
  }
  return Math.max(...apart);
})()"""


def test_the_merged_world_stands_where_the_vehicle_sees_it(page: Page) -> None:
    page.wait("app.frames.ned.world.visible && app.frames.ned.world.children.length === 2")
    assert page.ask("document.getElementById('worldwords').textContent").startswith("merged world: ")
    page.wait(f"{PLACED}.then((apart) => apart < 0.001)")  # a frame just come is drawn a moment later
    legend = "document.getElementById('marks').textContent"
    assert "merged world" in page.ask(legend)
    page.ask("document.getElementById('merged').click()")
    page.wait("!app.frames.ned.world.visible")
    assert "merged world" not in page.ask(legend)
    page.ask("document.getElementById('merged').click()")
    page.wait("app.frames.ned.world.visible")


def test_obstacles_of_other_vehicles_are_drawn_and_end_with_their_stream(page: Page, following: Following) -> None:
    drawn, text = "app.frames.ned.team.children.length", "document.getElementById('members').textContent"
    assert page.ask("document.getElementById('members').hidden")  # [share] is off
    with zmq.Context() as context:
        address = f"ipc://{following.live.folder}/run/neighbours"
        with closing(Publisher(Stream("neighbours", address), context)) as publisher:

            def is_drawn() -> bool:
                publisher.publish(team_message())
                return bool(page.ask(f"{drawn} === 4 && app.frames.ned.team.visible"))

            assert until(is_drawn)
        assert page.ask(text).startswith("vehicle 7, last packet 0.2 s ago: 2 planes, observed up to 12 s ago")
        page.ask("document.getElementById('team').click()")
        page.wait("!app.frames.ned.team.visible")
        page.ask("document.getElementById('team').click()")
        page.wait(f"{drawn} === 0 && {text}.includes('no team any more')")  # the stream has ended


def test_the_page_can_step_back_and_shows_it(page: Page) -> None:
    page.wait("app.data.frames.length > 3")
    page.key("ArrowLeft")
    page.wait(f"{STATE} === 'paused' && {BANNER}.startsWith('NOT LIVE')")
    at = page.ask("app.data.frames[app.at].t")
    page.wait("app.data.frames.at(-1).t > app.data.frames[app.at].t + 0.5")
    assert page.ask("app.data.frames[app.at].t") == at
    assert float(page.ask("document.body.dataset.shown")) > 0.5
    page.key("End")
    page.wait(VALID)


def test_a_lost_camera_is_blind_and_recovers(page: Page, following: Following) -> None:
    live = following.live
    camera = live.camera_pids()["front"]
    live.cable.unlink()  # so that it stays away
    try:
        with suppress(ProcessLookupError):  # it may have seen that already
            os.kill(camera, signal.SIGKILL)
        page.wait(shows("BLIND"))
        page.wait(f"{shows('lost: ')} && document.getElementById('stage').classList.contains('blind')")
    finally:
        live.cable.touch()
    page.wait(VALID)


def test_a_view_that_hangs_is_cut_off(page: Page, following: Following) -> None:
    following.view.send_signal(signal.SIGSTOP)
    try:
        page.wait(f"{shows('CUT OFF')} && document.getElementById('stage').dataset.word === 'CUT OFF'")
    finally:
        following.view.send_signal(signal.SIGCONT)
    page.wait(VALID)


SILENT = "document.getElementById('service').classList.contains('old')"


def test_a_service_that_is_killed_is_reported_to_be_silent_and_its_report_is_grey(
    page: Page, following: Following
) -> None:
    page.wait(f"!{SILENT}")
    before = "getComputedStyle(document.getElementById('health'), '::before').content"
    assert page.ask(before) == "none"
    following.live.stop(signal.SIGKILL)
    page.wait(shows("BLIND"))
    page.wait(shows("no message from the service for"))
    page.wait(SILENT)
    assert "no longer current" in page.ask(before)
    assert float(page.ask("getComputedStyle(document.getElementById('health')).opacity")) < 1.0
    assert page.ask(f"{STATE} !== 'valid'")
    following.live.start()
    page.wait(f"{VALID} && !{SILENT}")


def test_the_verdict_of_what_was_received(page: Page) -> None:
    """All that the band may say, from given answers; the worst wins, and unknown is never valid."""
    cases = [
        ("waiting", {"answer_ms": None}),
        ("waiting", {"shown_s": None}),
        ("valid", {}),
        ("cut", {"answer_ms": 1001}),
        ("cut", {"answer_ms": 1001, "following": False}),
        ("stale", {"since_s": 0.35}),
        ("stale", {"since_s": 0.35, "following": False}),
        ("stale", {"shown_s": 1.1}),
        ("paused", {"shown_s": 30.0, "following": False}),
        ("blind", {"cameras": []}),
        ("blind", {"cameras": [{"name": "a", "blind": "", "age_s": None}]}),
        ("blind", {"cameras": [{"name": "a", "blind": "lost", "age_s": 0.1}]}),
        ("stale", {"cameras": [{"name": "a", "blind": "", "age_s": 0.1}, {"name": "b", "blind": "", "age_s": 0.5}]}),
        (
            "blind",
            {"cameras": [{"name": "a", "blind": "lost", "age_s": 0.1}, {"name": "b", "blind": "", "age_s": 9.0}]},
        ),
    ]
    for state, change in cases:
        well = {"answer_ms": 50, "since_s": 0.1, "shown_s": 0.2, "following": True, "trouble": ""}
        cameras = change.pop("cameras", [{"name": "a", "blind": "", "age_s": 0.1}])
        seen = well | change | {"update": {"cameras": cameras, "service": {"missing": []}}}
        page_state = page.ask(f"import('viewer/live').then(m => m.verdict({json.dumps(seen)}, 0.4))")
        assert page_state["state"] == state, (seen, page_state)
        assert ("Do not treat any direction as free" in page_state["text"]) == (state in ("cut", "blind", "stale"))
        assert bool(page_state["word"]) == (state in ("cut", "blind", "stale"))


PAINTED = """(() => {
  const { renderer } = app, gl = renderer.getContext(), { width, height } = renderer.domElement;
  const pixels = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const colors = new Set();
  for (let k = 0; k < pixels.length; k += 4) colors.add(pixels[k] << 16 | pixels[k + 1] << 8 | pixels[k + 2]);
  return colors.size;
})()"""
"""How many colours are in the picture: one where nothing is drawn."""


@contextmanager
def resized(page: Page) -> Iterator[Callable[[int, int], None]]:
    """Gives a page a size, and waits until its picture has it."""

    def resize(width_px: int, height_px: int) -> None:
        page.call(
            "Emulation.setDeviceMetricsOverride",
            width=width_px,
            height=height_px,
            deviceScaleFactor=1,
            mobile=width_px < 900,
        )
        stage, canvas = "document.getElementById('stage')", "app.renderer.domElement"
        same = f"{canvas}.width === {stage}.clientWidth && {canvas}.height === {stage}.clientHeight"
        page.wait(f"innerWidth === {width_px} && innerHeight === {height_px} && {same}")

    try:
        yield resize
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")


@contextmanager
def without(page: Page, method: str) -> Iterator[None]:
    """A page whose app does nothing in a method."""
    page.ask(f"app.{method} = () => {{}}")
    try:
        yield
    finally:
        page.ask(f"delete app.{method}")


def test_the_picture_is_never_empty_after_a_change_of_size(page: Page) -> None:
    """A new size clears the picture: it is drawn at once and not with the next frame, which may be late."""
    with resized(page) as resize, without(page, "ask"):  # nothing else draws from now on
        for width, height in ((390, 844), (844, 390)):
            resize(width, height)
            assert page.ask(PAINTED) > 20


LABELS = """(() => {
  const heights = [], tall = 2 * Math.tan(app.eye.fov * Math.PI / 360), { clientHeight } = document.getElementById("stage");
  app.frames.scene.traverse((o) => o.isSprite && heights.push(o.scale.y / tall * clientHeight));
  return heights;
})()"""
"""The height of each label on the screen, pixels."""


def test_labels_can_be_read_on_a_phone(page: Page) -> None:
    with resized(page) as resize:
        for width, height in ((390, 844), (844, 390), (1400, 900)):
            resize(width, height)
            # the layout may change once more after the size; the labels follow with it
            page.wait(f"Math.min(...{LABELS}) >= 15.9")
            assert len(page.ask(LABELS)) >= 5, "those of the range rings at least"


def test_frames_of_a_view_before_a_restart_are_removed(page: Page) -> None:
    """Another `companion view` counts time from its own start, and may know other cameras: an old frame would get a wrong age."""
    before = "app.play(false); app.data.frames.forEach((frame) => { frame.t += 1000; });"
    cameras = "app.data.cameras.unshift({ ...app.data.cameras[0], name: 'gone' }); app.data.frames.forEach((frame) => { frame.c = 1; });"
    page.ask(f"{before} {cameras} app.camera = 1; app.chosen = 'front'; app.updateCameras(); live.name = 'another'")
    page.wait("live.name !== 'another'")
    page.wait(VALID)
    assert page.ask("Math.max(...app.data.frames.map((frame) => frame.t))") < 1000
    assert page.ask("app.data.cameras.map((camera) => camera.name)") == ["front"]
    assert page.ask("[app.camera, document.getElementById('camera').options.length]") == [0, 1]
    assert float(page.ask("document.body.dataset.shown")) >= 0


def test_the_heading_of_now_is_that_of_the_camera_that_has_one(page: Page) -> None:
    """Frames of a blind camera between those of another one have none."""
    with without(page, "append"):
        last = "app.data.frames.at(-1)"
        for later_s, known in ((0.3, True), (1.2, False)):
            page.ask(f"app.data.frames.push({{ ...app.data.frames[0], attitude: null, t: {last}.t + {later_s} }})")
            assert page.ask("app.attitude().attitude !== null") is known
            page.ask("app.data.frames.pop()")


def test_nothing_is_drawn_between_two_views(page: Page) -> None:
    with without(page, "append"):
        page.ask("app.forget()")
        assert page.ask("document.body.dataset.state") != "valid"
        assert page.ask("app.frames.walls") is None
        assert page.ask("document.getElementById('age').textContent") == ""
        page.key(" ")
        assert page.ask("document.getElementById('count').textContent") == ""
        page.key(" ")
    page.wait(VALID)


@pytest.mark.parametrize(
    "defect",
    [
        "app.frames.draw = () => { throw new Error('a defect') }",
        "live.showState = () => { throw new Error('a defect') }",
    ],
)
def test_a_page_that_cannot_draw_any_more_does_not_pretend(
    page: Page, following: Following, browser: Browser, defect: str
) -> None:
    with browser.page(following.address) as other:
        other.wait(VALID)
        other.forgive()
        other.ask(defect)
        # on a slow machine the page may say "stale" first, which has the same colour
        other.wait(f"{BANNER}.includes('a defect')")
        at = other.ask("live.after")
        other.wait(f"live.after > {at} || live.broken !== null")
        assert other.ask("document.getElementById('banner').className") == "blind"
