"""Responses to the page of `companion view --live`: frames to draw, their ages, and the state of cameras and service."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osape_client.boot import boot_id
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.subscriber import TIMEOUT_S

from ..pipeline.encode import prisms_from_message
from ..pipeline.results import PrismsResult
from .colors import depth_index, palette
from .frame import ViewFrame
from .live_camera import NS, Shown
from .live_status import camera_status, service_status
from .log import view_frame
from .page import frame_data, live_page, packed_png
from .subscriber import LiveSubscriber
from .tracks import tracks_data

HOLD_S = 0.2
"""Longest wait for new frames; the response then contains the ages only."""
MAX_READY = 8


class LivePage:
    """Creates the responses for all pages. A drawn frame is kept for other pages."""

    def __init__(self, subscriber: LiveSubscriber, title: str) -> None:
        self.subscriber, self._title = subscriber, title
        self._name = f"{boot_id()}-{clock_ns()}"
        self._ready: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._drawing = threading.Lock()

    def page(self) -> str:
        """The HTML page."""
        return live_page(
            {
                "title": self._title,
                "note": "",
                "palette": palette().tobytes().hex(),
                "cameras": [],
                "frames": [],
                "live": {"stale_s": TIMEOUT_S},
            }
        )

    def answer(self, name: str, after: int, world: int = 0, team: int = 0) -> bytes:
        """A JSON response. name, after, world, team: of the newest response that the page has received; "" and 0: none."""
        began_ns = clock_ns()
        after, world, team = (after, world, team) if name == self._name else (0, 0, 0)
        subscriber, frames = self.subscriber, []
        subscriber.wait(after, HOLD_S)
        with subscriber.changed:
            shown = {camera: c.shown for camera, c in subscriber.cameras.items()}
            number = subscriber.number
        decode_errors = dict.fromkeys(shown, "")
        for k, (camera, s) in enumerate(shown.items()):
            if s is None:
                continue
            drawn = self._drawn(s)
            if s.number > after:
                frames.append(drawn | {"c": k})
            if s.message.valid:
                decode_errors[camera] = drawn["cause"]
        now_ns = clock_ns()
        with subscriber.changed:
            cameras = [camera_status(subscriber, c, s, decode_errors[c], now_ns) for c, s in shown.items()]
            service = service_status(subscriber, now_ns)
        response = {
            "name": self._name,
            "number": number,
            "held_ms": (now_ns - began_ns) / 1e6,
            "service": service,
            "cameras": cameras,
            "frames": frames,
            "world": subscriber.world.update(world),
            "team": subscriber.team.update(team),
        }
        return json.dumps(response, separators=(",", ":"), allow_nan=False).encode()

    def _drawn(self, shown: Shown) -> dict[str, Any]:
        with self._drawing:
            if shown.number not in self._ready:
                self._ready[shown.number] = frame_of(shown, self.subscriber.begun_ns)
                while len(self._ready) > MAX_READY:
                    self._ready.popitem(last=False)
            return self._ready[shown.number]


def decoded(message: pb.PrismsFrame) -> tuple[PrismsResult | None, str]:
    """(result, why there is none): a frame without a valid result, or with inconsistent numbers, has none."""
    if not message.valid:
        return None, message.cause_text or "no cause reported"
    try:
        return prisms_from_message(message), ""
    except ValueError as error:
        return None, f"its message is inconsistent ({error})"


def frame_of(shown: Shown, begun_ns: int) -> dict[str, Any]:
    """A frame as the page draws it. A frame with inconsistent numbers is blind."""
    m = shown.message
    result, cause = decoded(m)
    blind = ViewFrame(info=shown.info, sequence=m.sequence, t_ns=m.t_exposure_ns, dropped=cause)
    frame = blind if result is None else view_frame(result, shown.info, None)
    if result is not None and shown.tracks is not None:
        frame = replace(frame, tracks=tracks_data(shown.tracks, frame.heading_rad, frame.position_ned_m))
    data = frame_data(frame, 0, frame.t_ns, 0)
    if not _finite(data):
        not_finite = "its message is inconsistent (a number that is not finite)"
        data = frame_data(replace(blind, dropped=not_finite), 0, frame.t_ns, 0)
    data["t"] = (shown.exposed_ns - begun_ns) / NS
    depth_mm = None if shown.preview is None else preview_depth_mm(shown.preview)
    if depth_mm is not None:
        data["depth"] = packed_png(depth_index(depth_mm, shown.info, frame.ke_per_m), 1)
    return data


def preview_depth_mm(preview: pb.DepthPreview) -> NDArray[np.uint16] | None:
    """(H, W) uint16 millimetres; None where its bytes are not those of an image of this size."""
    size = preview.height_px, preview.width_px
    if not len(preview.depth_mm) == 2 * size[0] * size[1] > 0:
        return None
    return np.frombuffer(preview.depth_mm, "<u2").astype(np.uint16).reshape(size)


def _finite(data: dict[str, Any]) -> bool:
    """Whether all numbers are finite: JSON has no others."""
    try:
        json.dumps(data, allow_nan=False)
    except ValueError:
        return False
    return True
