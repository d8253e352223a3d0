"""Reads intrinsics.json: the camera of a folder of depth images."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from core.types import CameraInfo, Intrinsics
from drivers.base import BadData
from drivers.regular_file import regular

from .png import MAX_SIDE_PX
from .report import ImportOptions

_EXAMPLE: Final = 'an object such as {"width": 640, "height": 480, "fx": 383.5, "fy": 383.5, "cx": 320, "cy": 240}'


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCoding:
    """Encoding of depth in the PNGs: millimetres per step, and the values without a measurement."""

    unit_mm: float = 1.0
    invalid: tuple[int, ...] = (0, 65535)


def read_intrinsics(path: Path, options: ImportOptions, usual_unit_mm: float = 1.0) -> tuple[CameraInfo, DepthCoding]:
    """The camera and the encoding of its images. usual_unit_mm: where the file states none. Raises BadData."""
    content = _json_object(path)
    numbers: dict[str, float] = {}
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        value = content.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadData(f"{path}: {key} is {'missing' if value is None else repr(value)}; expected a number (pixels)")
        numbers[key] = value
    unit_mm = content.get("depth_unit_mm", usual_unit_mm)
    if isinstance(unit_mm, bool) or not isinstance(unit_mm, int | float) or not 1e-3 <= unit_mm <= 1000.0:
        raise BadData(f"{path}: depth_unit_mm = {unit_mm!r}; expected millimetres per step, 0.001..1000")
    invalid = content.get("invalid", [0, 65535])
    if not isinstance(invalid, list) or not all(type(v) is int and 0 <= v <= 65535 for v in invalid):
        raise BadData(f"{path}: invalid = {invalid!r}; expected a list of pixel values 0..65535")
    for key in ("width", "height"):
        if not 16 <= numbers[key] <= MAX_SIDE_PX or numbers[key] % 1:  # also NaN
            raise BadData(f"{path}: {key} is {numbers[key]}; expected a whole number of pixels, 16..{MAX_SIDE_PX}")
    try:
        size = int(numbers["width"]), int(numbers["height"])
        intrinsics = Intrinsics(*size, *(float(numbers[key]) for key in ("fx", "fy", "cx", "cy")))
        info = options.camera.applied_to(CameraInfo(options.camera.name, intrinsics))
    except OverflowError as error:
        raise BadData(f"{path}: a value is too large; expected fx, fy, cx, cy in pixels") from error
    except ValueError as error:
        raise BadData(f"{path}, or its override on the command line: {error}") from error
    return info, DepthCoding(unit_mm=float(unit_mm), invalid=tuple(invalid))


def _json_object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(regular(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BadData(
            f"{path}: cannot be read ({error.strerror}); it must contain width, height, fx, fy, cx, cy"
        ) from error
    except ValueError as error:  # not JSON, not UTF-8, or a number of thousands of digits
        raise BadData(f"{path}: not valid JSON in UTF-8 ({error}); expected {_EXAMPLE}, decimals with a dot") from error
    except RecursionError as error:
        raise BadData(f"{path}: nested too deeply; it must contain width, height, fx, fy, cx, cy") from error
    if not isinstance(content, dict):
        raise BadData(f"{path}: expected {_EXAMPLE}")
    return content
