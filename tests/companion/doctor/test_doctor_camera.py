"""What `companion doctor` says of the frames of a camera."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from companion.cameras.status import CameraCondition, CameraStatus
from companion.config.camera import CameraConfig
from companion.config.loader import Config
from companion.doctor import camera_check
from companion.doctor.camera_check import camera_finding, frames_finding, middle_depth_m
from core.params import Params
from core.types import CameraInfo, DepthFrame, Intrinsics

NS = 1_000_000_000
SECTION = CameraConfig(name="front", kind="oak")


def frames_of(depth_mm: np.ndarray) -> list[DepthFrame]:
    """Four frames of one image at 30 Hz."""
    stamps = [k * NS // 30 for k in range(4)]
    return [
        DepthFrame(
            camera="front",
            sequence=k,
            t_exposure_ns=t,
            t_arrival_ns=t + 1_000_000,
            depth_mm=depth_mm.astype(np.uint16),
        )
        for k, t in enumerate(stamps)
    ]


def test_the_depth_in_the_middle_is_the_median_of_what_is_measured_there() -> None:
    depth = np.full((60, 80), 1500)
    depth[26:34, 34:46] = 4070
    depth[30, 34:46] = 0
    frames = frames_of(depth)
    assert middle_depth_m(frames) == pytest.approx(4.07)
    finding = frames_finding("camera front", SECTION, frames)
    assert finding.ok
    assert finding.text.endswith("% of the pixels measured, 4.07 m in the middle of the image")


def test_where_the_middle_is_not_measured_no_depth_is_stated() -> None:
    depth = np.full((60, 80), 1500)
    depth[20:40, 20:60] = 0
    frames = frames_of(depth)
    assert middle_depth_m(frames) is None
    assert frames_finding("camera front", SECTION, frames).text.endswith("% of the pixels measured")


@pytest.mark.parametrize(("kind", "remedy"), [("oak", "USB 3"), ("simulated", "this computer renders them too slowly")])
def test_a_low_rate_has_the_remedy_of_the_kind_of_camera(kind: str, remedy: str) -> None:
    """A simulated camera was to be connected to USB 3."""
    section = CameraConfig(name="front", kind=kind, fps=60.0)
    finding = frames_finding("camera front", section, frames_of(np.full((60, 80), 1500)))
    assert finding.code == "camera_rate_low"
    assert remedy in finding.text


def test_one_frame_is_not_a_frame_rate() -> None:
    """A camera that opened just before the patience ended was reported with 0.0 Hz, and with the remedy of a USB 2 port."""
    finding = frames_finding("camera front", SECTION, frames_of(np.full((60, 80), 1500))[:1])
    assert not finding.ok
    assert finding.text == (
        "80x60, 1 ms from exposure to arrival, 100 % of the pixels measured: only one frame arrived, its rate is not measured; "
        "--patience gives it more time"
    )


@pytest.mark.parametrize(("min_measured_share", "code"), [(0.02, ""), (0.2, "camera_few_measured")])
def test_a_camera_whose_frames_are_invalid_is_a_fault(
    min_measured_share: float, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a greater [expert] min_measured_share the doctor found no fault, and the service was blind."""
    depth = np.zeros((60, 80))
    depth[:6] = 1500
    give(monkeypatch, depth)
    config = Config(extractor=Params(min_measured_share=min_measured_share))
    finding, _ = camera_finding(SECTION, config, 0.0)
    assert finding.code == code


def test_a_camera_whose_calibration_is_inaccurate_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    give(
        monkeypatch, np.full((60, 80), 1500), notice="camera front: the rows of both images differ by up to 0.8 px; ..."
    )
    finding, _ = camera_finding(SECTION, Config(), 0.0)
    assert not finding.ok
    assert finding.code == "camera_misaligned"
    assert "differ by up to 0.8 px" in finding.text


@pytest.mark.parametrize(
    ("loss", "text"),
    [
        (
            "camera front: the device was lost (X_LINK_ERROR); check cable and power",
            "lost after 4 frames: the device was lost (X_LINK_ERROR); check cable and power",
        ),
        ("the same image 91 times in a row", "lost after 4 frames: the same image 91 times in a row"),
    ],
)
def test_a_camera_that_was_lost_during_the_check_is_a_fault(
    loss: str, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that restarts a second after its start was ok; of one that is frozen the frame rate was reported."""
    give(monkeypatch, np.full((60, 80), 1500), last_loss=loss)
    finding, _ = camera_finding(SECTION, Config(), 0.0)
    assert not finding.ok
    assert finding.text == text
    assert finding.code == "camera_unavailable"


def test_a_camera_that_opened_and_is_silent_is_named_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    info = CameraInfo("front", Intrinsics(80, 60, 40.0, 40.0, 39.5, 29.5))
    give(monkeypatch, None, condition=CameraCondition.SILENT, cause="no frame for 25.0 s", info=info)
    finding, _ = camera_finding(SECTION, Config(), 0.01)
    assert finding.text.startswith(
        "no frame: it opened and sends none; check cable and power, and that it is on USB 3 ("
    )


def test_the_name_of_a_camera_is_stated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """`camera front: no frame: camera front: no OAK device`."""
    give(monkeypatch, None, condition=CameraCondition.LOST, last_loss="camera front: no OAK device; check the cable")
    finding, _ = camera_finding(SECTION, Config(), 0.0)
    assert (finding.part, finding.text) == ("camera front", "no frame: no OAK device; check the cable")


def give(monkeypatch: pytest.MonkeyPatch, depth: np.ndarray | None, **state: object) -> None:
    """Lets the camera of the doctor deliver frames of one image (None: no frames). state: of its status."""

    class Opened:
        """A camera that gives its frames when it is opened."""

        status = CameraStatus(
            **{"camera": "front", "condition": CameraCondition.RUNNING, "cause": "", "since_ns": 0, **state}
        )

        def __init__(
            self, section: object, on_info: object, on_frame: Callable[[DepthFrame], None], *_: object, **__: object
        ) -> None:
            self._on_frame = on_frame

        def open(self) -> None:
            for frame in frames_of(depth) if depth is not None else ():
                self._on_frame(frame)

        def close(self) -> None:
            """Does nothing."""

    monkeypatch.setattr(camera_check, "CameraSupervisor", Opened)
