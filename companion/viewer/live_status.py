"""The state of cameras and service as the live page shows it: blind cameras with the cause, and missing streams."""

from __future__ import annotations

from typing import Any

from osape_client.decode import cause_code
from osape_client.sources import CONFLICT_TEXT
from osape_client.subscriber import TIMEOUT_S

from ..live.health import STATES
from ..live.message_json import message_json
from ..live.status import status_lines
from .autopilot_view import autopilot_data
from .live_camera import NS, Shown
from .page import camera_data
from .subscriber import HEALTH_OLD_NS, LiveSubscriber

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
    """That the service sends nothing, or two do, as text; empty: one sends."""
    if not subscriber.running:
        return "companion view does not receive any more: restart it"
    if subscriber.conflict_ns and now_ns - subscriber.conflict_ns <= TIMEOUT_S * NS:
        return CONFLICT_TEXT
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
