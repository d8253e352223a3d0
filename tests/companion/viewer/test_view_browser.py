"""The page in a real browser, where there is one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.viewer.page import PageBuilder

from ..browser import Browser, Page, opened
from ..view_scenes import blind, frame, tilted

pytestmark = pytest.mark.process

BANNER = "document.getElementById('banner').textContent"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with opened(tmp_path_factory.mktemp("browser")) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    builder = PageBuilder("test.mcap", 3)
    for f in (frame(), blind(), tilted()):
        builder.add(f)
    path = tmp_path_factory.mktemp("page") / "flight.html"
    path.write_text(builder.page(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def once(browser: Browser, page: Path) -> Iterator[Page]:
    with browser.page(f"{page.as_uri()}#frame=0") as shown:
        shown.wait("document.body.dataset.drawn === '0'")
        yield shown


@pytest.fixture
def first(once: Page) -> Page:
    """The page at its first frame."""
    once.key("Home")
    once.wait("document.body.dataset.drawn === '0'")
    return once


def shows_status(shown: Page, banner: str) -> bool:
    facts = shown.ask("document.getElementById('facts').textContent").replace("-0°", "0°")
    return bool(shown.ask(BANNER).startswith(banner)) and "roll 0°, pitch 0°, yaw 0°" in facts


def picture(shown: Page, folder: Path) -> np.ndarray:
    """The 3-D part of a page."""
    shown.picture(folder / "page.png")
    image = cv2.imread(str(folder / "page.png"))
    assert image is not None
    assert image.shape[1] == 1200
    return image[60 : image.shape[0] - 120, :800]


def test_page_opens_without_complaint_and_shows_the_status(browser: Browser, first: Page) -> None:
    assert shows_status(first, "VALID")
    assert not browser.complaints


def test_a_blind_frame_says_so_across_the_scene(browser: Browser, page: Path, tmp_path: Path) -> None:
    with browser.page(f"{page.as_uri()}#frame=1") as shown:
        shown.wait("document.body.dataset.drawn === '1' && !document.getElementById('depth').hidden")
        assert shows_status(shown, "BLIND: too few pixels")
        b, g, r = (c.astype(int) for c in cv2.split(picture(shown, tmp_path)))
        assert np.mean((r > 120) & (g < 70) & (b < 70)) > 0.02
        assert not browser.complaints


def test_scene_is_drawn(browser: Browser, page: Path, tmp_path: Path) -> None:
    with browser.page(f"{page.as_uri()}#frame=2&world=ned&points=1&normals=1") as shown:
        shown.wait("document.body.dataset.drawn === '2' && !document.getElementById('depth').hidden")
        colors = picture(shown, tmp_path)[::2, ::2].reshape(-1, 3)
    assert len(np.unique(colors, axis=0)) > 200


ACT = """(async () => {
const tell = {}, key = (name) => dispatchEvent(new KeyboardEvent("keydown", { key: name }));
const settle = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
const canvas = document.getElementById("canvas"), app = window.app;
const pointer = (kind, x, y) => canvas.dispatchEvent(new PointerEvent(kind, { clientX: x, clientY: y, pointerId: 1, bubbles: true }));
canvas.setPointerCapture = () => {};
const box = canvas.getBoundingClientRect(), x = box.left + box.width / 2, y = box.top + box.height / 2;
await settle();
key("4"); await settle();
pointer("pointermove", x, y);
tell.tip = document.getElementById("tip").textContent;
const before = app.orbit.azimuth;
pointer("pointerdown", x, y); pointer("pointermove", x + 50, y); pointer("pointerup", x + 50, y);
tell.turned = before - app.orbit.azimuth;
const far = app.orbit.distance;
canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: 400, cancelable: true }));
tell.zoomed = app.orbit.distance / far;
tell.walls = app.frames.shown.length;
for (const [name, act] of [["right", () => key("ArrowRight")], ["end", () => key("End")], ["left", () => key("ArrowLeft")], ["home", () => key("Home")]]) {
  act(); await settle();
  tell[name] = app.at;
}
const slider = document.getElementById("slider");
slider.value = "1";
slider.dispatchEvent(new Event("input")); await settle();
tell.slid = app.at;
document.getElementById("inferred").click();
key("End"); await settle();
tell.measured = app.frames.shown.length;
key("Home"); await settle();
key(" ");
tell.playing = app.playing;
return JSON.stringify(tell);
})()"""


def test_page_is_turned_stepped_slid_and_questioned(first: Page) -> None:
    tell = json.loads(first.ask(ACT))
    first.ask("app.play(false)")
    assert tell["tip"].startswith("plane 0: 4.0 m away; 1.2 to 2.6 m above the ground; margin 0.20 m")
    assert tell["turned"] == pytest.approx(0.3, abs=0.01)
    assert tell["zoomed"] == pytest.approx(1.49, abs=0.01)
    assert [tell[k] for k in ("right", "end", "left", "home")] == [1, 2, 1, 0]
    assert tell["slid"] == 1
    assert tell["walls"] == 1
    assert tell["measured"] == 2, "two of the last frame's four planes are partly inferred"
    assert tell["playing"] is True


def test_page_plays_to_its_end(first: Page) -> None:
    first.ask("document.getElementById('speed').value = '4'")
    first.ask("app.play(true)")
    first.wait("!app.playing && document.body.dataset.drawn === '2'")


def test_page_that_fails_shows_the_failure(browser: Browser, page: Path) -> None:
    broken = page.with_name("broken.html")
    text = page.read_text("utf-8").replace("this.#words(frame, options);", "this.gone();")
    broken.write_text(text, encoding="utf-8")
    with browser.page(f"{broken.as_uri()}#frame=0", forgiven=True) as shown:
        shown.wait("document.getElementById('banner').className === 'blind'")
        assert "cannot be shown" in shown.ask(BANNER)
