"""Checks the cameras: opens each in a process of its own, as the service does, and measures its frames."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median

import numpy as np

from core.types import CameraInfo, DepthFrame, is_measured

from ..autopilot.clear_sectors import OpenedCamera, never_clear_texts
from ..cameras.masks import outside_text, unmeasured_mask
from ..cameras.status import CameraStatus
from ..cameras.supervisor import NO_FRAME_REMEDY, CameraSupervisor
from ..config.camera import CameraConfig
from ..config.camera_kinds import RECORDED, live_kinds
from ..config.loader import Config
from ..diagnostic import DiagnosticCode
from ..live.diagnostics import MIN_RATE_SHARE
from .finding import Finding
from .wait import wait_until

NS = 1_000_000_000
MIN_MEASURED_SHARE = 0.05
"""Least share of measured pixels on the ground, unless [expert] min_measured_share is greater: frames with fewer are invalid."""


def camera_findings(config: Config, patience_s: float) -> Iterator[Finding]:
    """Opens each camera, one after the other, and examines at last whether the sectors ahead of them can be clear."""
    opened: list[OpenedCamera] = []
    for section in config.cameras:
        finding, info = camera_finding(section, config, patience_s)
        yield finding
        if finding.ok and info is not None:
            hidden = unmeasured_mask(section, info, config.extractor.min_measured_share)
            opened.append(OpenedCamera(info, hidden))
            if text := outside_text(section, info):
                yield Finding(f"camera {section.name}", False, text)
    if config.avoid.send:
        for camera, text in never_clear_texts(opened, config.avoid, config.extractor).items():
            if text:
                yield Finding(f"camera {camera}", False, text, DiagnosticCode.NEVER_CLEAR)


def camera_finding(section: CameraConfig, config: Config, patience_s: float) -> tuple[Finding, CameraInfo | None]:
    """Whether a camera opens, its frame rate and the share of measured pixels; and the camera's description, if it opened."""
    part = f"camera {section.name}"
    if section.kind == RECORDED:
        text = f'kind = "{RECORDED}" is a recording; set the kind of a live camera: {live_kinds()}'
        return Finding(part, False, text, DiagnosticCode.NOT_A_LIVE_CAMERA), None
    frames: list[DepthFrame] = []
    infos: list[CameraInfo] = []
    least_share = config.extractor.min_measured_share
    supervisor = CameraSupervisor(section, infos.append, frames.append, config.supervision, least_share=least_share)
    supervisor.open()
    try:
        wait_until(lambda: len(frames) > 3 * section.fps or bool(supervisor.status.last_loss), patience_s)
        status = supervisor.status
    finally:
        supervisor.close()
    if not frames:
        text = f"no frame: {_no_frame_cause(status, patience_s)}"
        return Finding(part, False, text, DiagnosticCode.CAMERA_UNAVAILABLE), None
    if status.last_loss:
        text = f"lost after {len(frames)} frames: {_without_name(status.last_loss, section.name)}"
        return Finding(part, False, text, DiagnosticCode.CAMERA_UNAVAILABLE), None
    finding = frames_finding(part, section, frames, max(MIN_MEASURED_SHARE, least_share))
    if finding.ok and status.notice:
        finding = Finding(part, False, status.notice, DiagnosticCode.CAMERA_MISALIGNED)
    return finding, infos[-1] if infos else None


def _no_frame_cause(status: CameraStatus, patience_s: float) -> str:
    """Why a camera gave no frame, with the remedy."""
    if status.last_loss:
        return _without_name(status.last_loss, status.camera)
    opened = status.info is not None
    cause = f"it opened and sends none; {NO_FRAME_REMEDY}" if opened else _without_name(status.cause, status.camera)
    return f"{cause} (for {patience_s:g} s; --patience gives it more time)"


def _without_name(cause: str, camera: str) -> str:
    """A driver's message without the name of the camera, with which each finding begins."""
    return cause.removeprefix(f"camera {camera}: ")


def frames_finding(
    part: str, section: CameraConfig, frames: list[DepthFrame], least_share: float = MIN_MEASURED_SHARE
) -> Finding:
    """Frame rate, share of measured pixels and depth in the middle, of frames in their order, at least one. least_share: of
    measured pixels."""
    span_s = (frames[-1].t_exposure_ns - frames[0].t_exposure_ns) / NS
    hz = (len(frames) - 1) / span_s if span_s > 0.0 else 0.0
    rate = f"{hz:.1f} Hz, " if len(frames) > 1 else ""
    depth = frames[-1].depth_mm
    measured = float(np.mean(is_measured(depth)))
    delay_ms = median(f.t_arrival_ns - f.t_exposure_ns for f in frames) / 1e6
    text = (
        f"{depth.shape[1]}x{depth.shape[0]}, {rate}{delay_ms:.0f} ms from exposure to arrival, "
        f"{100 * measured:.0f} % of the pixels measured"
    )
    if measured < least_share:
        text += ": too few; check that the lens is clear, the scene is lit and objects are within range"
        return Finding(part, False, text, DiagnosticCode.CAMERA_FEW_MEASURED)
    if len(frames) == 1:
        text += ": only one frame arrived, its rate is not measured; --patience gives it more time"
        return Finding(part, False, text, DiagnosticCode.CAMERA_RATE_LOW)
    if hz < MIN_RATE_SHARE * section.fps:
        remedy = "check that the camera is on USB 3 and used by this process only"
        if section.kind == "simulated":
            remedy = "this computer renders them too slowly: end other programs, or lower fps or width_px"
        text += f": fps = {section.fps:g} is configured; {remedy}"
        return Finding(part, False, text, DiagnosticCode.CAMERA_RATE_LOW)
    middle_m = middle_depth_m(frames)
    if middle_m is not None:
        text += f", {middle_m:.2f} m in the middle of the image"
    return Finding(part, True, text)


def middle_depth_m(frames: list[DepthFrame]) -> float | None:
    """Median depth of the middle tenth of the image, in width and height, of all frames; None where less than half of it is
    measured. To be compared with a tape measure."""
    height, width = frames[0].depth_mm.shape
    rows, columns = slice(9 * height // 20, 11 * height // 20 + 1), slice(9 * width // 20, 11 * width // 20 + 1)
    middle = np.stack([f.depth_mm[rows, columns] for f in frames])
    measured = is_measured(middle)
    return float(np.median(middle[measured])) / 1000.0 if measured.mean() > 0.5 else None
