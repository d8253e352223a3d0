"""Pictures: their size, and that what they show stands where an independent projection puts it."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from companion.cli import main
from companion.viewer import command
from companion.viewer.colors import FAR_RGB, UNKNOWN_RGB, UNKNOWN_STRIPE_RGB
from companion.viewer.frame import ViewFrame
from companion.viewer.png import BANNER_PX, HEIGHT_PX, WIDTH_PX, image_place, save_frame
from core.types import PlaneFlags, StripTable

from ..small_recordings import write_flight
from ..view_scenes import INFO, INTRINSICS, blind, frame, model, tilted

Image = NDArray[np.int32]


def drawn(f: ViewFrame, folder: Path) -> Image:
    """(HEIGHT_PX, WIDTH_PX, 3) RGB of a frame's picture."""
    path = folder / "frame.png"
    save_frame(f, path, t_start_ns=2_000_000_000)
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape == (HEIGHT_PX, WIDTH_PX, 3)
    return image[..., ::-1].astype(np.int32)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Image]:
    """The pictures of `frame()`, of `blind()` and of a frame without prisms, which several tests look at."""
    folder = tmp_path_factory.mktemp("pictures")
    frames = {"valid": frame(), "blind": blind(), "empty": frame(model=None)}
    return {name: drawn(f, folder) for name, f in frames.items()}


def panel(image: Image, f: ViewFrame) -> tuple[Image, float]:
    """The depth image's part of a picture and its picture pixels per image pixel."""
    left, bottom, width, height = image_place(f)[0]
    x0, x1 = round(left * WIDTH_PX), round((left + width) * WIDTH_PX)
    y0, y1 = round((1 - bottom - height) * HEIGHT_PX), round((1 - bottom) * HEIGHT_PX)
    return image[y0:y1, x0:x1], (x1 - x0) / f.info.intrinsics.width


def dark(part: Image, u: float, v: float, scale: float, reach: int = 3) -> bool:
    """Whether the black casing of an outline lies within `reach` picture pixels of an image pixel."""
    x, y = round((u + 0.5) * scale), round((v + 0.5) * scale)
    return bool(part[y - reach : y + reach + 1, x - reach : x + reach + 1].max(axis=2).min() < 50)


def test_outline_of_a_plane_stands_where_the_pinhole_puts_it(pictures: dict[str, Image]) -> None:
    # plane 4 m ahead, 1 m to either side, from 0.6 m above to 0.8 m below
    part, scale = panel(pictures["valid"], frame())
    k = INTRINSICS
    left, right = k.cx - k.fx / 4, k.cx + k.fx / 4
    top, bottom = k.cy - 0.6 * k.fy / 4, k.cy + 0.8 * k.fy / 4
    for u in np.linspace(left, right, 9):
        assert dark(part, u, top, scale)
        assert dark(part, u, bottom, scale)
    for v in np.linspace(top, bottom, 9):
        assert dark(part, left, v, scale)
        assert dark(part, right, v, scale)
    for u, v in [(left - 8, k.cy), (right + 8, k.cy), (k.cx, top - 8), (k.cx, bottom + 8), (k.cx + 25, k.cy)]:
        assert not dark(part, u, v, scale)


def test_dashes_of_an_inferred_plane_leave_gaps(tmp_path: Path) -> None:
    plane = [[4.0, -1.0, 4.0, 1.0, -0.6, 0.8]]
    full = frame(model=model(plane))
    dashed = frame(model=model(plane, [int(PlaneFlags.INFERRED)]))
    k, v = INTRINSICS, INTRINSICS.cy - 0.6 * INTRINSICS.fy / 4
    shares = []
    for f in (full, dashed):
        part, scale = panel(drawn(f, tmp_path), f)
        us = np.linspace(k.cx - k.fx / 4 + 3, k.cx + k.fx / 4 - 3, 150)
        shares.append(np.mean([dark(part, u, v, scale, reach=2) for u in us]))
    assert shares[0] == 1.0
    assert 0.2 < shares[1] < 0.95


def test_strips_are_drawn_into_the_image(tmp_path: Path) -> None:
    columns = np.linspace(-1.5, 1.5, 7)
    n = len(columns)
    zeros = np.zeros(n, np.int32)
    strips = StripTable(
        u=zeros,
        row_top=zeros,
        row_bottom=zeros,
        support_px=zeros,
        cluster=zeros,
        x_m=np.full(n, 5, np.float32),
        y_m=columns.astype(np.float32),
        top_m=np.full(n, -1, np.float32),
        bottom_m=np.full(n, 1, np.float32),
    )
    plain = frame(model=model([]))
    with_strips = frame(model=replace(model([]), strips=strips))
    before, scale = panel(drawn(plain, tmp_path), plain)
    after, _ = panel(drawn(with_strips, tmp_path), with_strips)
    brighter = (after - before).sum(axis=2)
    k = INTRINSICS
    for y in columns:
        x = round((k.cx + k.fx * y / 5 + 0.5) * scale)
        row = round((k.cy + 0.5) * scale)
        assert brighter[row, x - 2 : x + 3].max() > 40
        assert brighter[round((k.cy - k.fy / 5 - 6) * scale), x - 2 : x + 3].max() == 0


def test_unknown_is_grey_and_hatched_and_far_is_pale(tmp_path: Path) -> None:
    depth = np.full((240, 320), 10_000, np.uint16)
    depth[:, :100] = 0
    depth[:, 200:] = 65534
    f = frame(depth_mm=depth, model=model([]))
    part, scale = panel(drawn(f, tmp_path), f)
    unknown = part[: round(120 * scale), 4 : round(98 * scale)].reshape(-1, 3)
    for color in (UNKNOWN_RGB, UNKNOWN_STRIPE_RGB):
        assert np.mean(np.abs(unknown - color).max(axis=1) < 12) > 0.2
    far = part[8 : round(120 * scale), round(202 * scale) : -4].reshape(-1, 3)
    assert np.mean(np.abs(far - FAR_RGB).max(axis=1) < 6) > 0.99


def test_the_banner_distinguishes_blind_valid_and_not_extracted(pictures: dict[str, Image]) -> None:
    edge = (slice(4, BANNER_PX - 4), slice(WIDTH_PX - 200, WIDTH_PX - 4))  # right of the words
    expected = {"valid": (0x2E, 0x7D, 0x32), "blind": (0xC6, 0x28, 0x28), "empty": (0xB2, 0x6A, 0x00)}
    for name, image in pictures.items():
        assert (np.abs(image[edge] - expected[name]) < 4).all(), name
        label = image[4 : BANNER_PX - 4, : WIDTH_PX // 2]
        assert np.mean(label.min(axis=2) > 220) > 0.005, f"{name}: no words in the band"


def test_blind_frame_shows_no_free_space_and_no_planes(pictures: dict[str, Image]) -> None:
    image = pictures["blind"]
    green = np.abs(image - (0xC8, 0xE6, 0xC9)).max(axis=2) < 10
    assert not green.any()
    assert np.abs(pictures["valid"] - (0xC8, 0xE6, 0xC9)).max(axis=2).min() < 10, "a valid one shows it"
    part, _ = panel(image, blind())
    red = np.abs(part - (0xC6, 0x28, 0x28)).max(axis=2) < 8
    assert red.mean() > 0.02, "the image itself is stamped"


@pytest.mark.parametrize(
    "f",
    [
        tilted(),
        frame(depth_mm=None),
        frame(
            model=None, R_ned_frd=None, dropped="the newest attitude is too old to be carried forward to the exposure"
        ),
        frame(model=model([[-3.0, -1.0, -3.0, 1.0, -1.0, 1.0]])),
    ],
    ids=["tilted", "no depth", "dropped", "plane behind the camera"],
)
def test_every_kind_of_frame_can_be_drawn(f: ViewFrame, tmp_path: Path) -> None:
    assert np.std(drawn(f, tmp_path)) > 10


def test_names_and_causes_with_a_dollar_are_text(tmp_path: Path) -> None:
    """matplotlib takes what stands between two of them for a formula, and fails at one that it cannot read."""
    formula = "$x_{$"
    assert np.std(drawn(frame(info=replace(INFO, camera=formula), model=None, dropped=formula), tmp_path)) > 10


def test_missing_matplotlib_is_named_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before kernels are compiled and the log is read, which takes long."""
    monkeypatch.setitem(sys.modules, "matplotlib.backends.backend_agg", None)
    monkeypatch.setattr(command, "ensure_compiled", lambda *groups: pytest.fail("kernels were compiled"))
    assert main(["view", str(write_flight(tmp_path / "log.mcap")), "-o", str(tmp_path / "out")]) == 1
    assert re.search(r"pip install .matplotlib.*--no-png", capsys.readouterr().err)
    assert not (tmp_path / "out").exists()
