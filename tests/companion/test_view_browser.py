"""The page in a real browser, where there is one."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.view_page import PageBuilder

from .view_scenes import blind, frame, tilted

FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage", "--hide-scrollbars", "--window-size=1200,800", "--virtual-time-budget=6000",
    "--enable-logging=stderr",
)  # fmt: skip


@pytest.fixture(scope="module")
def browser() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("no browser here (chromium) to open the page with")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    builder = PageBuilder("test.mcap", 3)
    for f in (frame(), blind(), tilted()):
        builder.add(f)
    path = tmp_path_factory.mktemp("page") / "flight.html"
    path.write_text(builder.page(), encoding="utf-8")
    return path


def ask(browser: str, page: Path, address: str, *flags: str) -> tuple[str, str]:
    """(what the browser printed, what the page said on its console)."""
    profile = f"--user-data-dir={page.parent / 'profile'}"
    command = [browser, *FLAGS, profile, *flags, f"{page.as_uri()}#{address}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout, "\n".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)


@pytest.mark.parametrize(
    ("address", "banner", "drawn"), [("frame=0", "VALID", "0"), ("frame=1", "BLIND: too few pixels", "1")]
)
def test_page_opens_without_complaint_and_tells_the_standing(
    browser: str, page: Path, address: str, banner: str, drawn: str
) -> None:
    dom, console = ask(browser, page, address, "--dump-dom")
    complaints = [line for line in console.splitlines() if "GL Driver Message" not in line]
    assert not complaints
    found = re.search(r'id="banner"[^>]*>([^<]*)<', dom)
    assert found is not None
    assert html.unescape(found.group(1)).startswith(banner)
    assert f'data-drawn="{drawn}"' in dom
    assert "roll 0°, pitch 0°, yaw 0°" in html.unescape(dom).replace("-0°", "0°")


def test_scene_is_drawn(browser: str, page: Path, tmp_path: Path) -> None:
    shots = {}
    for name, address in {"valid": "frame=2&world=ned&points=1&normals=1", "blind": "frame=1"}.items():
        target = tmp_path / f"{name}.png"
        ask(browser, page, address, f"--screenshot={target}")
        image = cv2.imread(str(target))
        assert image is not None
        assert image.shape[1] == 1200
        shots[name] = image[60 : image.shape[0] - 120, :800]  # the 3-D part
    colors = {name: len(np.unique(s[::2, ::2].reshape(-1, 3), axis=0)) for name, s in shots.items()}
    assert colors["valid"] > 200
    b, g, r = (shots["blind"][..., k].astype(int) for k in range(3))
    assert np.mean((r > 120) & (g < 70) & (b < 70)) > 0.02, "a blind frame says so across the scene"


ACT = """
<script type="module">
import "viewer/app";
const tell = {}, key = (name) => dispatchEvent(new KeyboardEvent("keydown", { key: name }));
const settle = () => new Promise((done) => setTimeout(done, 300));
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
document.getElementById("inferred").click();
key("End"); await settle();
tell.measured = app.frames.shown.length;
key("Home"); await settle();
key(" "); await settle();
tell.playing = app.playing;
document.title = JSON.stringify(tell);
</script>
</body>"""


def test_page_is_turned_stepped_and_questioned(browser: str, page: Path) -> None:
    acted = page.with_name("acted.html")
    acted.write_text(page.read_text("utf-8").replace("</body>", ACT), encoding="utf-8")
    dom, console = ask(browser, acted, "frame=0", "--dump-dom")
    assert "Uncaught" not in console
    found = re.search(r"<title>([^<]*)</title>", dom)
    assert found is not None
    tell = json.loads(html.unescape(found.group(1)))
    assert tell["tip"].startswith("4.0 m away; -0.8 to 0.6 m above the camera; margin 0.20 m")
    assert tell["turned"] == pytest.approx(0.3, abs=0.01)
    assert tell["zoomed"] == pytest.approx(1.49, abs=0.01)
    assert [tell[k] for k in ("right", "end", "left", "home")] == [1, 2, 1, 0]
    assert tell["walls"] == 1
    assert tell["measured"] == 2, "two of the last frame's four planes are partly inferred"
    assert tell["playing"] is True


def test_page_that_fails_says_so_instead_of_showing_nothing(browser: str, page: Path) -> None:
    broken = page.with_name("broken.html")
    text = page.read_text("utf-8").replace("this.#words(frame, options);", "this.gone();")
    broken.write_text(text, encoding="utf-8")
    dom, _ = ask(browser, broken, "frame=0", "--dump-dom")
    found = re.search(r'id="banner" class="blind"[^>]*>([^<]*)<', dom)
    assert found is not None
    assert "cannot be shown" in found.group(1)
