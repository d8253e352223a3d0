"""State of the service and its cameras as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from osape_client.proto import osape_v1_pb2 as pb

from .message_types import RosMessages

DIAGNOSTIC_ARRAY, _STATUS = "diagnostic_msgs/msg/DiagnosticArray", "diagnostic_msgs/msg/DiagnosticStatus"

_SERVICE_LEVELS: Final = {
    pb.Health.STATE_ACTIVE: "OK",
    pb.Health.STATE_DEGRADED: "WARN",
    pb.Health.STATE_STARTING: "WARN",
    pb.Health.STATE_BLIND: "ERROR",
}


@dataclass(frozen=True, slots=True)
class Part:
    """One status."""

    name: str
    level: str  # OK, WARN, ERROR or STALE, as of DiagnosticStatus
    text: str
    values: Mapping[str, str]


def service_part(health: pb.Health | None, silence: str) -> Part:
    """The service by its newest health report. silence: why nothing is received; STALE then, "": the report is current."""
    if silence or health is None:
        return Part("service", "STALE", silence or "no health report received yet", {})
    level = _SERVICE_LEVELS.get(health.state, "ERROR")
    text = health.diagnostics[0].text if health.diagnostics else ""
    state = pb.Health.State.Name(health.state).removeprefix("STATE_").lower()
    return Part("service", level, f"{state}: {text}" if text else state, {"state": state})


def camera_part(camera: str, cause: str, code: str, age_s: float | None) -> Part:
    """A camera. cause: why it has no current frame; "": it has one. age_s: of its newest exposure."""
    age = {} if age_s is None else {"age_s": f"{age_s:.2f}"}
    return Part(camera, "ERROR" if cause else "OK", cause or "current", {"code": code, **age} if code else age)


def diagnostic_array(ros: RosMessages, prefix: str, parts: Sequence[Part], stamp_ns: int) -> Any:
    """The message. prefix: before the name of each status."""
    status = [
        ros.make(
            _STATUS,
            level=ros.constant(_STATUS, part.level),
            name=f"{prefix}: {part.name}",
            message=part.text,
            hardware_id="osape-companion",
            values=[
                ros.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in part.values.items()
            ],
        )
        for part in parts
    ]
    return ros.make(DIAGNOSTIC_ARRAY, header=ros.header(stamp_ns, ""), status=status)
