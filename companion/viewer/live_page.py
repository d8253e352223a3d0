"""Responses to the page of `companion view --live`: frames to draw, their ages, blind cameras and missing streams."""

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
from osape_client.decode import cause_code
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.subscriber import TIMEOUT_S

from ..live.health import STATES
from ..live.message_json import message_json
from ..live.status import status_lines
from ..pipeline.encode import prisms_from_message
from ..pipeline.results import PrismsResult
from .autopilot_view import autopilot_data
from .colors import depth_index, palette
from .frame import ViewFrame
from .log import view_frame
from .page import camera_data, frame_data, live_page, packed_png
from .subscriber import HEALTH_OLD_NS, NS, LiveSubscriber, Shown
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


NO_CURRENT_MESSAGE = "no_current_message"
"""Code of a camera whose newest message is missing, too old or cannot be drawn."""


def camera_status(
    subscriber: LiveSubscriber, name: str, shown: Shown | None, decode_error: str, now_ns: int
) -> dict[str, Any]:
    """State of a camera. blind: cause as text, code: its code, both empty if it is not blind; age_s: age of the newest
    exposure; shown_s: age of the drawn exposure. decode_error: why the newest message cannot be drawn; empty: it can.
    """
    camera = subscriber.cameras[name]
    m, code = camera.newest, ""
    age_s = (now_ns - camera.exposed_ns) / NS
    if m is None:
        blind, age = silence_text(subscriber, now_ns) or "no message received yet", None
    elif now_ns - camera.received_ns > TIMEOUT_S * NS:
        quiet_s = (now_ns - camera.received_ns) / NS
        blind, age = silence_text(subscriber, now_ns) or f"no message for {quiet_s:.1f} s", age_s
        if is_removed(subscriber, name, now_ns):
            blind += "; the service has no such camera any more: restart this command to leave it out"
    elif not m.valid:
        blind, age = m.cause_text or "no cause reported", age_s
        code = cause_code(m.cause)
    else:
        blind, age = (f"the newest frame is {age_s:.1f} s old" if age_s > TIMEOUT_S else ""), age_s
    if not blind and decode_error:
        blind = decode_error
    if not blind and camera.info is None:
        blind = "its description has not arrived yet (health report): nothing can be drawn"
    shown_s = None if shown is None else (now_ns - shown.exposed_ns) / NS
    info = None if camera.info is None else camera_data(camera.info)
    if blind and not code:
        code = NO_CURRENT_MESSAGE
    return {"name": name, "blind": blind, "code": code, "age_s": age, "shown_s": shown_s, "info": info}


def is_removed(subscriber: LiveSubscriber, name: str, now_ns: int) -> bool:
    """Whether a current health report does not contain the camera: the service was restarted with other ones."""
    h = subscriber.health
    current = h is not None and now_ns - subscriber.health_ns <= HEALTH_OLD_NS
    return h is not None and current and name not in {camera.camera for camera in h.cameras}


def silence_text(subscriber: LiveSubscriber, now_ns: int) -> str:
    """That the service sends nothing, as text; empty: it sends."""
    if not subscriber.running:
        return "companion view does not receive any more: restart it"
    if subscriber.health is None:
        return f"no message from the service on {subscriber.streams.health}: check that it runs (companion status)"
    newest_ns = max([subscriber.health_ns, *(c.received_ns for c in subscriber.cameras.values())])
    quiet_s = (now_ns - newest_ns) / NS
    if now_ns - newest_ns > TIMEOUT_S * NS and any(c.received_ns for c in subscriber.cameras.values()):
        return f"no message from the service for {quiet_s:.1f} s: check that it runs (companion status)"
    return ""


def service_status(subscriber: LiveSubscriber, now_ns: int) -> dict[str, Any]:
    """The health report as text, and the streams that are missing."""
    h = subscriber.health
    missing = []
    if h is None or now_ns - subscriber.health_ns > HEALTH_OLD_NS:
        age = "" if h is None else f" for {(now_ns - subscriber.health_ns) / NS:.0f} s"
        missing.append(f"no health report on {subscriber.streams.health}{age}: check that the service runs")
    elif not subscriber.cameras:
        missing.append("the service has no camera: add a [[camera]] to its configuration")
    if not subscriber.streams.depth:
        missing.append("no depth images: [publish] depth is empty")
    elif subscriber.depth_missing(now_ns) and not missing and any(c.received_ns for c in subscriber.cameras.values()):
        missing.append(f"no depth images on {subscriber.streams.depth} ([publish] depth)")
    if subscriber.undecodable:
        missing.append(f"not understood: {subscriber.undecodable}")
    return {
        "state": "" if h is None else STATES.get(h.state, "unknown"),
        "age_s": None if h is None else (now_ns - subscriber.health_ns) / NS,
        "lines": [] if h is None else status_lines(h),
        "diagnostics": [] if h is None else [message_json(d) for d in h.diagnostics],
        "missing": missing,
        "autopilot": None if h is None else autopilot_data(h, h.t_ns + now_ns - subscriber.health_ns),
    }
