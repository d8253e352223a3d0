"""A self-contained page: prisms in 3-D, stepped through time, with the depth image.

Everything, including three.js, is in one file; the page's security policy forbids network access."""

from __future__ import annotations

import base64
import gzip
import json
import re
from importlib import resources
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.frames import rotation_from_euler
from core.types import CameraInfo, FrameModel, FreeProfile, Prism

from ..pipeline.transform import LevelTransform, transform_model
from .colors import depth_index, palette
from .frame import FrameStatus, ViewFrame

DEPTH_BUDGET_BYTES: Final = 3_000_000
"""Size limit of all depth images in a page; many frames make each image smaller."""
DEPTH_WIDTHS_PX: Final = (320, 240, 200, 160, 120)
_BYTES_PER_PX: Final = 0.5
"""Bytes per pixel of a noisy depth image as PNG in base64."""
_PLACE: Final = re.compile(r"@@([\w.]+)@@")


class PageBuilder:
    """Collects frames and writes the page; keeps small images only."""

    def __init__(self, title: str, expected_frames: int) -> None:
        self._title = title
        self._cameras: dict[str, CameraInfo] = {}
        self._frames: list[dict[str, Any]] = []
        self._t_start_ns: int | None = None
        self._width_px = depth_width_px(expected_frames)

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, frame: ViewFrame) -> None:
        """Adds a frame."""
        if self._t_start_ns is None:
            self._t_start_ns = frame.t_ns
        self._cameras.setdefault(frame.info.camera, frame.info)
        camera = list(self._cameras).index(frame.info.camera)
        self._frames.append(frame_data(frame, camera, self._t_start_ns, self._width_px))

    def page(self, note: str = "") -> str:
        """The page. note: shown to the reader, for example that it contains a part of the frames.

        Raises ValueError without frames."""
        if not self._frames:
            raise ValueError("a page needs at least one frame")
        data = {
            "title": self._title,
            "note": note,
            "palette": palette().tobytes().hex(),
            "cameras": [camera_data(info) for info in self._cameras.values()],
            "frames": sorted(self._frames, key=lambda f: float(f["t"])),
        }
        return _fill(data, "")


def live_page(data: dict[str, Any]) -> str:
    """The live page, which requests new frames from its own server only."""
    return _fill(data, "; connect-src 'self'")


def _fill(data: dict[str, Any], policy: str) -> str:
    """The template with each @@name@@ replaced by a computed part or by the file of that name."""
    packed = gzip.compress(json.dumps(data, separators=(",", ":"), allow_nan=False).encode(), mtime=0)
    made = {"data": base64.b64encode(packed).decode(), "policy": policy}
    files = resources.files(__package__) / "static"

    def put(match: re.Match[str]) -> str:
        name = match.group(1)
        text = made[name] if name in made else (files / name).read_text("utf-8")
        if "</script" in text:
            raise ValueError(f"viewer/static/{name} contains the end of a script element")
        return text

    return _PLACE.sub(put, (files / "template.html").read_text("utf-8"))


def depth_width_px(frames: int) -> int:
    """Width of the page's depth images that keeps them within the budget."""
    for width in DEPTH_WIDTHS_PX:
        if frames * width * width * 0.75 * _BYTES_PER_PX <= DEPTH_BUDGET_BYTES:
            return width
    return DEPTH_WIDTHS_PX[-1]


def small_index(
    depth_mm: NDArray[np.uint16], info: CameraInfo, width_px: int, ke_per_m: float | None = None
) -> NDArray[np.uint8]:
    """(h, w) bytes of a depth image on the common scale, reduced by subsampling (depth is never averaged)."""
    height, width = depth_mm.shape
    w = min(width_px, width)
    h = max(1, round(height * w / width))
    rows = ((np.arange(h) + 0.5) * height / h).astype(np.intp)
    columns = ((np.arange(w) + 0.5) * width / w).astype(np.intp)
    return depth_index(depth_mm[np.ix_(rows, columns)], info, ke_per_m)


def frame_data(frame: ViewFrame, camera: int, t_start_ns: int, depth_width: int) -> dict[str, Any]:
    """One frame for the page in `level`: lengths in cm, angles in mrad, whole numbers."""
    yaw, t = frame.level_from_level_cam
    R = frame.R_level_cam_optical
    data: dict[str, Any] = {
        "c": camera,
        "sequence": frame.sequence,
        "t": round((frame.t_ns - t_start_ns) / 1e9, 4),
        "status": frame.status.name,
        "cause": frame.cause,
        "attitude": None if frame.attitude_deg is None else [round(a, 1) for a in frame.attitude_deg],
        "heading": round(frame.heading_rad, 5),
        "pos": None if frame.position_ned_m is None else [round(p, 3) for p in frame.position_ned_m],
        "cam": [round(float(v), 3) for v in t],
        "R": None if R is None else np.round(rotation_from_euler(0.0, 0.0, yaw) @ R, 5).ravel().tolist(),
        "depth": None,
        "facts": facts(frame.model, frame.info.max_range_m),
        "autopilot": frame.autopilot,
        "tracks": frame.tracks,
        **_nothing(),
    }
    if frame.depth_mm is not None:
        data["depth"] = packed_png(small_index(frame.depth_mm, frame.info, depth_width, frame.ke_per_m), 9)
    if frame.model is not None and frame.status is FrameStatus.VALID:
        data.update(_model(transform_model(frame.model, LevelTransform(yaw, (float(t[0]), float(t[1]), float(t[2]))))))
    return data


def packed_png(index: NDArray[np.uint8], level: int) -> str:
    """A depth image (h, w) of one byte per pixel as PNG in base64. level: 1 fast .. 9 small."""
    packed = cv2.imencode(".png", index, [cv2.IMWRITE_PNG_COMPRESSION, level])
    return base64.b64encode(packed[1].tobytes()).decode()


def facts(model: FrameModel | None, max_range_m: float) -> list[tuple[str, str]]:
    """The result as rows of a table."""
    if model is None:
        return []
    s, g = model.stats, model.ground
    ground = f"{g.height_m:.2f} m below the camera, {g.share:.0%} of the measured pixels" if g.seen else "none seen"
    rows = [
        (
            "obstacles",
            f"planes: {len(model.planes)}, clusters: {s.clusters}, prisms: {len(model.prisms)}, strips: {s.strips}",
        ),
        ("ground", ground),
        ("pixels", f"measured {s.measured_share:.0%}, unknown {s.unknown_share:.0%}, far {s.far_share:.0%}"),
        ("noise", f"sigma = {model.ke_per_m:.4f} Z² (metres)"),
    ]
    if g.blind_beyond_m < max_range_m:
        rows.append(("low things", f"not detected beyond {g.blind_beyond_m:.1f} m"))
    if s.overflow:
        rows.append(("overflow", f"{s.overflow} strips or planes were merged into coarser ones"))
    return rows


def _nothing() -> dict[str, Any]:
    """The model's part of an invalid frame."""
    return {
        "planes": [],
        "margin": [],
        "flags": [],
        "cluster": [],
        "support": [],
        "prisms": [],
        "free": None,
        "ground": None,
        "groundMargin": None,
    }


def _model(model: FrameModel) -> dict[str, Any]:
    g = model.ground
    return {
        "planes": _cm(model.planes),
        "margin": _cm(model.margin_m),
        "flags": model.flags.tolist(),
        "cluster": model.cluster.tolist(),
        "support": model.support_px.tolist(),
        "prisms": [_prism(prism) for prism in model.prisms],
        "free": _free(model.free),
        "ground": [round(g.height_m, 3), round(g.slope_x, 5), round(g.slope_y, 5)] if g.seen else None,
        "groundMargin": [round(g.tolerance_m, 3), round(g.noise_per_m, 5)] if g.seen else None,
    }


def _prism(prism: Prism) -> list[Any]:
    """[cluster, top, bottom, closed, margin, [x, y, ...], [plane, ...]]."""
    top, bottom, margin = (round(100 * v) for v in (prism.top_m, prism.bottom_m, prism.margin_m))
    return [prism.cluster, top, bottom, int(prism.closed), margin, _cm(prism.vertices_m), prism.plane.tolist()]


def _free(free: FreeProfile) -> dict[str, list[int]]:
    """By direction, then by layer. openFrom, openTo: what is presumed free, where the profile holds it."""
    opened = {"openFrom": _cm(free.open_from_m), "openTo": _cm(free.open_to_m)} if free.has_open else {}
    return {
        "azimuth": np.rint(1000.0 * free.azimuth_edges_rad.astype(np.float64)).astype(int).tolist(),
        "layers": _cm(free.layer_edges_m),
        "from": _cm(free.free_from_m),
        "to": _cm(free.free_to_m),
        **opened,
    }


def _cm(metres: NDArray[np.float32]) -> list[int]:
    """Flat whole centimetres; values that are not finite become 1 km, beyond any camera's range."""
    finite = np.nan_to_num(metres.astype(np.float64), nan=0.0, posinf=1000.0, neginf=-1000.0)
    return [int(v) for v in np.rint(100.0 * finite).ravel()]


def camera_data(info: CameraInfo) -> dict[str, Any]:
    """The description of a camera for the page."""
    k = info.intrinsics
    return {
        "name": info.camera,
        "width": k.width,
        "height": k.height,
        "fx": k.fx,
        "fy": k.fy,
        "cx": k.cx,
        "cy": k.cy,
        "min_m": info.min_range_m,
        "max_m": info.max_range_m,
    }
