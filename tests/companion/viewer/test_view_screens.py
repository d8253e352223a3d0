"""The page on a phone, a tablet and a desktop: what is seen, and the tools of the picture."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.viewer.page import PageBuilder

from ..browser import Browser, Page, opened
from ..view_scenes import blind, frame, tilted

pytestmark = pytest.mark.process

SIZES = [(1440, 900), (820, 1180), (1024, 768), (390, 844), (844, 390)]
"""A desktop, a tablet upright and flat, a phone upright and flat."""
DESKTOP, PHONE = (1120, 640), (390, 844)
"""Where the size is not the subject: small, since it is drawn by the processor."""
BOX = "(() => { const b = document.querySelector('%s').getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom]; })()"


def ring(shift_cm: int) -> dict[str, Any]:
    cm: list[int | None] = [500 + shift_cm, 1501] + [None] * 70
    return {"cm": cm, "first": 0.0, "step": 5.0, "clear": 1501, "body": True, "age_s": 0.1}


PILOT: dict[str, Any] = {
    "kind": "PX4",
    "mode": "Position",
    "armed": True,
    "age_s": 0.4,
    "sent": ring(0),
    "echoed": ring(20),
}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with opened(tmp_path_factory.mktemp("screens")) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Valid, blind twice, valid, blind, valid; with a position that moves north."""
    builder = PageBuilder("test.mcap", 6)
    for k, made in enumerate((frame(), blind(), blind(), tilted(), blind(), frame())):
        t_ns = 2_500_000_000 + k * 100_000_000
        builder.add(replace(made, t_ns=t_ns, sequence=k, position_ned_m=(float(k), 0.0, -2.0), autopilot=PILOT))
    path = tmp_path_factory.mktemp("page") / "flight.html"
    path.write_text(builder.page(), encoding="utf-8")
    return path


def resize(shown: Page, size: tuple[int, int]) -> None:
    """Gives a page a size, and waits until its picture has it."""
    width, height = size
    shown.call(
        "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 1100
    )
    stage, canvas = "document.getElementById('stage')", "window.app?.renderer.domElement"
    same = f"{canvas}?.width === {stage}.clientWidth && {canvas}?.height === {stage}.clientHeight"
    shown.wait(f"!window.app || (innerWidth === {width} && innerHeight === {height} && {same})")


def opened_at(browser: Browser, page: Path, size: tuple[int, int], address: str = "frame=0") -> Page:
    shown = browser.page("data:text/html,wait")
    resize(shown, size)
    shown.call("Page.navigate", url=f"{page.as_uri()}#{address}")
    shown.wait("window.app && document.body.dataset.drawn !== undefined")
    return shown


@pytest.fixture(scope="module")
def both(browser: Browser, page: Path) -> Iterator[tuple[Page, Page]]:
    with opened_at(browser, page, DESKTOP) as desktop, opened_at(browser, page, PHONE) as phone:
        yield desktop, phone


@pytest.fixture
def desktop(both: tuple[Page, Page]) -> Page:
    """A page that shows its first frame, for tests that change nothing but what the next frame replaces."""
    both[0].ask("app.show(0)")
    return both[0]


@pytest.fixture
def phone(both: tuple[Page, Page]) -> Page:
    """The same on a phone."""
    both[1].ask("app.show(0)")
    return both[1]


def test_the_panel_does_not_cover_the_picture(browser: Browser, page: Path) -> None:
    with opened_at(browser, page, SIZES[0]) as shown:
        for size in SIZES:
            resize(shown, size)
            left, top, right, bottom = shown.ask(BOX % "#stage")
            panel = shown.ask(BOX % "aside")
            assert panel[0] >= right or panel[1] >= bottom
            assert (right - left) * (bottom - top) > 0.35 * size[0] * size[1]
            assert shown.ask("document.documentElement.scrollWidth") == size[0]
            for name in ("#canvas", "#views", "#legend", "#pilot"):
                box = shown.ask(BOX % name)
                assert left <= box[0] < box[2] <= right, (name, size)
                assert top <= box[1] < box[3] <= bottom, (name, size)
            for one, other in (("#legend", "#views > :last-child"), ("#legend", "#pilot")):
                a, b = shown.ask(BOX % one), shown.ask(BOX % other)
                assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], f"{one} covers {other} at {size}"
            for name in ("#slider", "#strip", "#play", "#blind"):
                box = shown.ask(BOX % name)
                assert 0 <= box[0] < box[2] <= size[0], (name, size)
                assert box[3] <= size[1], (name, size)
            assert shown.ask("document.getElementById('pilot').textContent") == "PX4 · Position · ARMED"


def test_the_legend_does_not_cover_a_long_state_of_the_autopilot(browser: Browser, page: Path) -> None:
    """In a window of 700 x 500 the name of the autopilot was behind the legend."""
    with opened_at(browser, page, DESKTOP) as shown:
        shown.ask(
            "document.getElementById('pilot').textContent = 'ArduPilot · mode not reported · disarmed · report old'"
        )
        for size in ((700, 500), (844, 390), (390, 844)):
            resize(shown, size)
            legend, pilot = shown.ask(BOX % "#legend"), shown.ask(BOX % "#pilot")
            assert legend[2] < pilot[0] or pilot[3] < legend[1] or legend[3] < pilot[1], size
            assert pilot[2] - pilot[0] > 100, size


def test_nothing_covers_the_state_on_a_small_phone(browser: Browser, page: Path) -> None:
    with opened_at(browser, page, PHONE, "frame=1") as shown:
        assert shown.ask("document.getElementById('banner').textContent").startswith("BLIND")
        for size in ((568, 320), (640, 360), (320, 568)):
            resize(shown, size)
            banner, stage = shown.ask(BOX % "#banner"), shown.ask(BOX % "#stage")
            assert stage[3] - stage[1] > 0.25 * size[1]
            for name in ("#canvas", "#views", "#legend", "#pilot", "aside", "footer"):
                left, top, right, bottom = shown.ask(BOX % name)
                covered = not (right == left or (top >= banner[3] and bottom <= size[1]))
                assert not covered, f"{name} covers the state, or is cut off, at {size}"


def test_the_legend_names_what_its_scale_colours(phone: Page) -> None:
    choose = "(() => { const by = document.getElementById('by'); by.value = '%s'; by.dispatchEvent(new Event('change')); })()"
    ramp, before = "document.getElementById('ramp')", phone.ask("document.getElementById('by').value")
    assert phone.ask(f"{ramp}.textContent") == "obstacles by distance"
    assert phone.ask(f"{ramp}.scrollWidth <= {ramp}.clientWidth")
    phone.ask(choose % "flags")
    assert phone.ask(f"{ramp}.textContent") == "depth image by distance"
    phone.ask(choose % before)


def test_the_panel_of_a_phone_can_be_closed(phone: Page) -> None:
    before = phone.ask(BOX % "#stage")
    phone.ask("document.getElementById('panel').click()")
    after = phone.ask(BOX % "#stage")
    assert after[3] - after[1] > 1.3 * (before[3] - before[1])
    phone.ask("document.getElementById('panel').click()")
    assert phone.ask(BOX % "#stage") == before


def test_the_tip_at_the_lower_border_is_inside_the_window(phone: Page) -> None:
    phone.wait("!document.getElementById('depth').hidden")
    last_row = (
        "const b = depth.getBoundingClientRect(), at = { clientX: b.left + 9, clientY: innerHeight - 5, bubbles: true }"
    )
    phone.ask(
        f"{{ const depth = document.getElementById('depth'); {last_row};"
        " depth.dispatchEvent(new PointerEvent('pointermove', at)); }"
    )
    assert phone.ask("document.getElementById('tip').textContent") != ""
    box = phone.ask(BOX % "#tip")
    assert 0 <= box[1] < box[3] <= PHONE[1]


def test_the_sectors_are_those_of_the_autopilot(desktop: Page) -> None:
    assert desktop.ask("document.getElementById('sentwords').textContent") == "nearest 5.0 m; 70 of 72 unknown"
    assert desktop.ask("document.getElementById('echowords').textContent") == "nearest 5.2 m; 70 of 72 unknown"
    pixel = "[...document.getElementById('dial').getContext('2d').getImageData(130, %d, 1, 1).data].slice(0, 3)"
    red, green, blue = desktop.ask(pixel % 20)  # the outer ring, forward: an obstacle
    assert red > 200 > green > blue - 50
    assert desktop.ask(pixel % 240) == [0x59, 0x63, 0x6E]  # behind: unknown


WORDS = "import('viewer/pilot').then(({ ringWords }) => ringWords(%s, %s))"
FORWARD = "[...document.getElementById('dial').getContext('2d').getImageData(130, 20, 1, 1).data].slice(0, 3)"
NONE_SENT = [0x27, 0x2F, 0x38]


def test_old_sectors_are_not_shown(desktop: Page) -> None:
    old = json.dumps(PILOT | {"sent": ring(0) | {"age_s": 12.2}})
    desktop.ask(f"import('viewer/pilot').then(({{ showPilot }}) => showPilot({old}, app.data.frames[0]))")
    assert desktop.ask("document.getElementById('sentwords').textContent") == "none for 12 s"
    assert desktop.ask(FORWARD) == NONE_SENT
    assert desktop.ask("document.getElementById('echowords').textContent") == "nearest 5.2 m; 70 of 72 unknown"


def test_sectors_that_count_from_north_need_the_heading(desktop: Page) -> None:
    """Heading east: what lies in the north is on the left. A frame without an attitude has no heading."""
    north = json.dumps(PILOT | {"sent": ring(0) | {"body": False}})
    draw = "import('viewer/pilot').then(({ showPilot }) => showPilot(%s, { attitude: %s, heading: %s }))"
    desktop.ask(draw % (north, "[0, 0, 90]", "Math.PI / 2"))
    left = FORWARD.replace("130, 20", "20, 130")
    red, green, blue = desktop.ask(left)
    assert red > 200 > green > blue - 50
    assert desktop.ask(FORWARD) == [0x59, 0x63, 0x6E]
    desktop.ask(draw % (north, "null", "0"))
    assert desktop.ask(FORWARD) == desktop.ask(left) == NONE_SENT
    assert "heading is not known" in desktop.ask("document.getElementById('sentwords').textContent")


def test_sectors_that_are_all_unknown_are_not_called_clear_of_obstacles(desktop: Page) -> None:
    unknown = json.dumps(ring(0) | {"cm": [None] * 72})
    assert desktop.ask(WORDS % (unknown, "0")) == "all 72 unknown"


def test_the_next_blind_moment_is_one_press_away(phone: Page) -> None:
    phone.wait("document.body.dataset.drawn === '0'")
    for expected in (1, 4, 1):
        phone.ask("document.getElementById('blind').click()")
        phone.wait(f"document.body.dataset.drawn === '{expected}'")
    strip = "[...document.getElementById('strip').getContext('2d').getImageData(%s, 3, 1, 1).data].slice(0, 3)"
    assert phone.ask(strip % "5") == [0x43, 0xA0, 0x47]
    assert phone.ask(strip % "Math.floor(document.getElementById('strip').width * 0.25)") == [0xE5, 0x39, 0x35]


def test_a_distance_is_measured_between_two_presses(browser: Browser, page: Path) -> None:
    with opened_at(browser, page, DESKTOP, "frame=0&view=top") as shown:
        shown.ask("app.toggleMeasure()")
        # two points of the wall's upper edge, 4 m ahead, 0.5 m left and right, through the page's own projection
        press = (
            "((x) => { const v = app.eye.position.clone().set(x, 0.6, -4).project(app.eye);"
            " const b = document.getElementById('canvas').getBoundingClientRect();"
            " const at = { clientX: b.left + (v.x + 1) / 2 * b.width, clientY: b.top + (1 - v.y) / 2 * b.height, bubbles: true };"
            " document.getElementById('canvas').dispatchEvent(new MouseEvent('click', at)); })(%s)"
        )
        shown.ask(press % -0.5)
        shown.ask(press % 0.5)
        text = shown.ask("document.getElementById('measured').textContent")
        level_m = float(text.split("level ")[1].split(" m")[0])
        assert level_m == pytest.approx(1.0, abs=0.35)  # from above a press meets the edge or the ground below it
        shown.ask("app.toggleMeasure()")
        assert shown.ask("document.getElementById('measured').hidden")


def test_unknown_space_and_all_layers_can_be_shown(browser: Browser, page: Path) -> None:
    sheets = "app.frames.group.children.filter((o) => o.isMesh && o !== app.frames.walls).map((o) => o.geometry.attributes.position.count)"
    with opened_at(browser, page, DESKTOP) as shown:
        both = shown.ask(sheets)
        assert len(both) == 2
        shown.ask("document.getElementById('unknown').click()")
        assert shown.ask(sheets) == [6]  # one direction is free at the camera's height
        shown.ask("(document.getElementById('layers').value = 'all', app.show(app.at))")
        assert shown.ask(sheets) == [12]  # and in the layer above


def test_a_frame_without_attitude_is_drawn_with_the_last_known_heading(browser: Browser, tmp_path: Path) -> None:
    """Otherwise the vehicle points north at such a frame, and the view, which turns with it, is turned away from the scene."""
    builder = PageBuilder("test.mcap", 2)
    lost = replace(frame(), model=None, R_ned_frd=None, position_ned_m=None, dropped="no attitude")
    for k, made in enumerate((tilted(), lost)):
        builder.add(replace(made, t_ns=2_500_000_000 + k * 100_000_000, sequence=k))
    page = tmp_path / "flight.html"
    page.write_text(builder.page(), encoding="utf-8")
    with opened_at(browser, page, DESKTOP, "frame=0&world=ned") as shown:
        place = "app.place(app.data.frames[app.at])"
        before = shown.ask(place), shown.ask("app.orbit.azimuth")
        shown.ask("app.show(1)")
        assert (shown.ask(place), shown.ask("app.orbit.azimuth")) == before
        assert before[0]["yaw"] == pytest.approx(0.7, abs=1e-4)
        assert "last known heading" in shown.ask("document.getElementById('facts').textContent")


def test_obstacles_and_trail_are_saved_as_gltf(desktop: Page) -> None:
    desktop.ask("app.show(5)")
    content = json.loads(desktop.ask("app.gltf()"))
    assert [m["name"] for m in content["meshes"]] == ["front_5", "trail"]
    data = base64.b64decode(content["buffers"][0]["uri"].split(",", 1)[1])
    assert len(data) == content["buffers"][0]["byteLength"]
    accessor = content["accessors"][content["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    view = content["bufferViews"][accessor["bufferView"]]
    assert accessor["count"] == 6
    first = struct.unpack_from("<3f", data, view["byteOffset"])
    assert first == pytest.approx((-1.0, 0.6, -4.0))  # right, up, backward
    assert accessor["min"] == pytest.approx([-1.0, -0.8, -4.0])


def press_space(page: Page) -> None:
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key=" ", code="Space", text=" ", windowsVirtualKeyCode=32)


def press(page: Page, element: str) -> None:
    """A click with the pointer on the middle of an element."""
    left, top, right, bottom = page.ask(BOX % element)
    for kind in ("mousePressed", "mouseReleased"):
        page.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=(left + right) / 2,
            y=(top + bottom) / 2,
            button="left",
            clickCount=1,
        )


def test_space_presses_the_control_that_has_the_focus_of_the_keyboard(browser: Browser, page: Path) -> None:
    with opened_at(browser, page, DESKTOP) as shown:
        shown.ask("document.getElementById('trail').focus()")
        press_space(shown)
        assert shown.ask("document.getElementById('trail').checked") is False
        shown.ask("document.getElementById('view-top').focus()")
        press_space(shown)
        assert shown.ask("app.view") == "top"
        assert shown.ask("app.playing") is False


def test_space_plays_after_a_press_of_the_pointer(browser: Browser, page: Path) -> None:
    pressed = (("#trail", "behind", False), ("label:has(#trail)", "behind", True), ("#view-side", "side", True))
    with opened_at(browser, page, DESKTOP) as shown:
        shown.ask("window.plays = 0; app.play = () => { plays += 1; }")
        for plays, (control, view, has_trail) in enumerate(pressed, 1):
            shown.ask(f"document.querySelector('{control}').scrollIntoView()")
            press(shown, control)
            press_space(shown)
            assert shown.ask("window.plays") == plays, control
            assert shown.ask("app.view") == view
            assert shown.ask("document.getElementById('trail').checked") is has_trail
