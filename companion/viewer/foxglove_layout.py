"""A layout for Foxglove and Lichtblick: 3D panel, depth images, decisions and plots of a log's cameras.

Format: the layout file that Lichtblick and Foxglove import with "Import from file"."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from drivers.logs.topics import TOPICS

from ..whole_file import write_whole

LAYOUT_NAME: Final = "foxglove-layout.json"
DEPTH_MAX_MM: Final = 10_000
_SCENE: Final = "3D!obstacles"


def write_layout(path: Path, cameras: Sequence[str], *, health: bool) -> None:
    """Writes the layout file. cameras: names, at least one; health: whether the log has health reports. Raises OSError."""
    write_whole(path, json.dumps(layout(cameras, health=health), indent=1) + "\n")


def layout(cameras: Sequence[str], *, health: bool = True) -> dict[str, Any]:
    """The layout as a JSON object. health: with a panel of the health report, which a replayed or imported log lacks."""
    panels: dict[str, Any] = {_SCENE: _scene(cameras)}
    side: list[str] = []
    for name in cameras:
        panels[f"Image!{name}"] = _depth(name)
        side.append(f"Image!{name}")
    panels["StateTransitions!decisions"] = {
        "paths": [
            {"value": f"{TOPICS['decision'].of(name)}.cause", "label": name, "timestampMethod": "receiveTime"}
            for name in cameras
        ],
        "isSynced": True,
    }
    panels["Plot!counts"] = {"paths": _series(cameras), "showLegend": True, "isSynced": True}
    side += ["StateTransitions!decisions", "Plot!counts"]
    if health:
        panels["RawMessages!health"] = {"topicPath": TOPICS["health"].of()}
        side.append("RawMessages!health")
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": _SCENE, "second": _column(side), "direction": "row", "splitPercentage": 64},
    }


def _scene(cameras: Sequence[str]) -> dict[str, Any]:
    """The 3D panel: obstacles from behind and above the vehicle, which stays in the centre."""
    return {
        "cameraState": {"distance": 25, "perspective": True, "phi": 60, "thetaOffset": 90, "fovy": 45,
                        "near": 0.1, "far": 2000, "target": [0, 0, 0], "targetOffset": [0, 0, 0],
                        "targetOrientation": [0, 0, 0, 1]},
        "followMode": "follow-position",
        "followTf": "level",
        "scene": {"transforms": {"labelSize": 0.06, "axisSize": 0.6}},
        "transforms": {},
        "topics": {TOPICS["scene"].of(name): {"visible": True} for name in cameras},
        "layers": {"grid": {"layerId": "foxglove.Grid", "instanceId": "grid", "label": "Grid, 1 m", "visible": True,
                            "frameId": "up", "size": 40, "divisions": 40, "color": "#3b4a5aff"}},
    }  # fmt: skip


def _depth(camera: str) -> dict[str, Any]:
    """A panel with the depth image in colours, and the obstacles over it."""
    return {
        "imageMode": {
            "imageTopic": TOPICS["depth"].of(camera),
            "imageSchemaName": TOPICS["depth"].schema,
            "calibrationTopic": TOPICS["calibration"].of(camera),
            "colorMode": "colormap",
            "colorMap": "turbo",
            "minValue": 0,
            "maxValue": DEPTH_MAX_MM,
        },
        "topics": {},
    }


def _series(cameras: Sequence[str]) -> list[dict[str, Any]]:
    wanted = (("measured_share", "measured"), ("unknown_share", "unknown"))
    return [
        {
            "value": f"{TOPICS['prisms'].of(name)}.stats.{key}",
            "label": f"{name}: {label}",
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for name in cameras
        for key, label in wanted
    ]


def _column(panels: Sequence[str]) -> Any:
    """The panels below each other, each of the same height."""
    if len(panels) == 1:
        return panels[0]
    return {
        "first": panels[0],
        "second": _column(panels[1:]),
        "direction": "column",
        "splitPercentage": 100 / len(panels),
    }
