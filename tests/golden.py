"""Golden streams: small recordings of the simulator, and what the pipeline makes of them, in a form for reading.

    make golden              writes the results anew from the recordings and shows what changed
    make golden-recordings   flies the recordings anew first: needed only when the simulator changes

A result holds, for each frame, the decision, the counts, the ground, every plane rounded to a millimetre and the free
profile as sums and a digest. On the kind of processor and with the packages that made it, it must come out exactly;
elsewhere sums are made in another order, and TOLERANCE_MM and TOLERANCE_COUNT are allowed.
"""

from __future__ import annotations

import hashlib
import json
import math
import platform
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding
import numpy as np

from companion.config.loader import Config
from companion.log.log_writer import write_recording
from companion.log.provenance import run_info
from companion.pipeline.configured import make_pipeline
from companion.pipeline.results import FrameDecision, PrismsResult
from companion.replay.replay import process
from companion.replay.summary import ReplayCounts
from core.types import FrameModel, FreeProfile, Ground
from drivers.logs.reader import McapRecording
from drivers.simulation.flight import Rates, SimulatedFlight

DATA = Path(__file__).resolve().parent / "data"

STREAMS: dict[str, tuple[int, float, float]] = {
    "street": (320, 2.1, 4.0),
    "trees": (160, 2.1, 4.0),
    "alley": (160, 2.4, 4.0),
    "window": (320, 2.1, 4.0),
    "tilted": (160, 2.4, 4.5),
    "broken": (160, 2.4, 6.0),
}
"""Flight -> width (4:3), frames a second, seconds. The rates put most exposures between two attitudes, and each of the
failures of `broken` on some frames."""

TOLERANCE_MM = 1
"""On another kind of processor: of every length (of the sums of free ranges: one direction's whole range)."""
TOLERANCE_COUNT = 1
"""On another kind of processor: of every count, and how many planes and directions of a frame may differ altogether."""
PLANE = ("a_x", "a_y", "b_x", "b_y", "top", "bottom", "margin")
"""The lengths of a plane's row; after them stand support_px, flags and cluster."""

Result = dict[str, Any]


def recording_path(name: str) -> Path:
    """Where the recording lies."""
    return DATA / f"{name}.mcap"


def result_path(name: str) -> Path:
    """Where the golden result lies."""
    return DATA / "golden" / f"{name}.json"


def record(name: str, path: Path) -> None:
    """Flies a stream and writes it as a log, as the service would on board."""
    width, depth_hz, duration_s = STREAMS[name]
    rates = Rates(depth_hz=depth_hz)
    flight = SimulatedFlight(name, width=width, height=width * 3 // 4, rates=rates, duration_s=duration_s)
    write_recording(flight, path, run_info("simulated"))


def made_with() -> list[str]:
    """What the last digits depend on."""
    return [f"{platform.machine()} {llvmlite.binding.get_host_cpu_name()}", *run_info("replay").packages]


def result_of(path: Path) -> Result:
    """What the pipeline with its defaults makes of a recording."""
    frames: list[Result] = []
    with McapRecording(path) as recording:
        pipeline = make_pipeline(Config(), recording.cameras)
        for _, outputs in process(recording.events(), pipeline, ReplayCounts()):
            for output in outputs:
                if isinstance(output, FrameDecision):
                    frames.append(_decided(output))
                else:
                    frames[-1].update(_content(output))
    return {"made_with": made_with(), "frames": frames}


def _decided(decision: FrameDecision) -> Result:
    return {
        "sequence": decision.sequence,
        "used": decision.used,
        "dropped": decision.cause.text,
        "attitude": decision.attitude.name,
        "attitude_cutoff_us": None if decision.attitude_cutoff_ns is None else decision.attitude_cutoff_ns // 1000,
        "pose": decision.pose.name,
    }


def _content(output: PrismsResult) -> Result:
    content: Result = {"frame": output.frame, "valid": output.valid, "cause": output.cause_text}
    if output.model is not None:
        content.update(_model(output.model))
    return content


def _model(model: FrameModel) -> Result:
    s = model.stats
    counts = ("flying_px", "ground_px", "strips", "dropped_strips", "clusters", "planes", "prisms", "overflow")
    return {
        "counts": {name: getattr(s, name) for name in counts},
        "share_permille": {n: round(1000 * getattr(s, f"{n}_share")) for n in ("measured", "unknown", "far")},
        "ke_e6_per_m": round(1e6 * model.ke_per_m),
        "ground": _ground(model.ground),
        "free": _free(model.free),
        "planes": [
            [*(_mm(v) for v in row), _mm(margin), int(support), int(flags), int(cluster)]
            for row, margin, support, flags, cluster in zip(
                model.planes, model.margin_m, model.support_px, model.flags, model.cluster, strict=True
            )
        ],
    }


def _ground(ground: Ground) -> Result:
    return {
        "seen": ground.seen,
        "height_mm": _mm(ground.height_m),
        "slope_x_mm_per_m": _mm(ground.slope_x),
        "slope_y_mm_per_m": _mm(ground.slope_y),
        "share_permille": _mm(ground.share),
        "blind_beyond_mm": _mm(ground.blind_beyond_m),
    }


def _free(free: FreeProfile) -> Result:
    """Per layer, in how many directions something was seen free and how far altogether; a digest of all of it."""
    depth_m = np.maximum(free.free_to_m.astype(np.float64) - free.free_from_m, 0.0)
    digest = hashlib.sha256()
    for edges, scale in ((free.azimuth_edges_rad, 1e4), (free.layer_edges_m, 1e3)):
        digest.update(np.rint(edges.astype(np.float64) * scale).astype("<i8").tobytes())
    for ranges in (free.free_from_m, free.free_to_m):
        digest.update(np.rint(np.nan_to_num(ranges.astype(np.float64)) * 1e3).astype("<i8").tobytes())
    digest.update(free.end.tobytes())
    return {
        "directions": len(free.azimuth_edges_rad) - 1,
        "layers_mm": [_mm(z) for z in free.layer_edges_m],
        "open": [int(n) for n in np.count_nonzero(depth_m > 0.0, axis=0)],
        "open_mm": [_mm(v) for v in depth_m.sum(axis=0)],
        "digest": digest.hexdigest()[:16],
    }


def _mm(value_m: float) -> int | None:
    """Whole millimetres; None for what JSON lacks (nan, inf)."""
    return round(1000 * float(value_m)) if math.isfinite(value_m) else None


def dumps(result: Result) -> str:
    """Indented JSON with each plane on a line of its own."""
    text = json.dumps(result, indent=1, allow_nan=False)
    text = re.sub(r"\[\s+((?:-?[\d.]+|null)(?:,\s+(?:-?[\d.]+|null))*)\s+\]", _one_line, text)
    return re.sub(r"(\{)\s+([^{}\[\]]*?)\s+(\})", _one_line, text) + "\n"


def _one_line(match: re.Match[str]) -> str:
    return re.sub(r"\s*\n\s*", " ", match.group(0)).replace("[ ", "[").replace(" ]", "]")


def load(name: str) -> Result:
    """The golden result."""
    return dict(json.loads(result_path(name).read_text()))


def differences(golden: Result, now: Result) -> Iterator[str]:
    """Each field that differs, as text. Exact where both were made with the same processor and packages."""
    exact = golden["made_with"] == now["made_with"]
    if len(golden["frames"]) != len(now["frames"]):
        yield f"frames: {len(golden['frames'])} -> {len(now['frames'])}"
    for before, after in zip(golden["frames"], now["frames"], strict=False):
        for found in _fields(before, after, "", exact):
            yield f"frame {before['sequence']}: {found}"


def _fields(before: Any, after: Any, path: str, exact: bool) -> Iterator[str]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted(before.keys() | after.keys()):
            if not exact and key == "digest":
                continue
            yield from _fields(before.get(key), after.get(key), f"{path}.{key}".lstrip("."), exact)
    elif path == "planes" and before is not None and after is not None:
        yield from _planes(before, after, exact)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for i, (one, other) in enumerate(zip(before, after, strict=True)):
            yield from _fields(one, other, f"{path}[{i}]", exact)
    elif not (before == after if exact else _near(before, after, path)):
        yield f"{path}: {before} -> {after}"


def _near(before: Any, after: Any, path: str) -> bool:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (before, after))
    if not numbers:
        return bool(before == after)
    if path.startswith("free.open_mm"):  # one direction more or less
        return abs(before - after) <= 20_000
    if path.startswith("counts.") and path.endswith("_px"):  # pixels: one in a hundred lies on an edge
        return abs(before - after) <= max(TOLERANCE_COUNT, before // 100)
    return abs(before - after) <= (TOLERANCE_MM if path.endswith("mm") else TOLERANCE_COUNT)


def _planes(before: list[list[Any]], after: list[list[Any]], exact: bool) -> Iterator[str]:
    """Planes that went and planes that came."""
    left: list[list[Any]] = list(after)
    gone: list[list[Any]] = []
    for row in before:
        match = next((other for other in left if row == other or (not exact and _same_plane(row, other))), None)
        if match is None:
            gone.append(row)
        else:
            left.remove(match)
    if exact and before != after and not gone and not left:
        yield "planes: the same in another order"
    if exact or max(len(gone), len(left)) > TOLERANCE_COUNT:
        for label, rows in (("gone", gone), ("new", left)):
            for row in rows:
                yield f"planes: {label} {plane_text(row)}"


def _same_plane(row: list[Any], other: list[Any]) -> bool:
    """Within the tolerance; the cluster's number is only a name."""
    lengths = all(abs(a - b) <= TOLERANCE_MM for a, b in zip(row[:7], other[:7], strict=True))
    return lengths and abs(row[7] - other[7]) <= max(TOLERANCE_COUNT, row[7] // 100) and row[8] == other[8]


def plane_text(row: list[Any]) -> str:
    """A plane's row with the names of its numbers."""
    lengths = ", ".join(f"{name} {value}" for name, value in zip(PLANE, row[:7], strict=True))
    return f"({lengths} mm; {row[7]} px, flags {row[8]}, cluster {row[9]})"


def totals(result: Result) -> dict[str, int]:
    """Summary figures that show whether a model became worse."""
    valid = [f for f in result["frames"] if f.get("valid")]
    return {
        "frames": len(result["frames"]),
        "used": sum(f["used"] for f in result["frames"]),
        "valid": len(valid),
        "ground seen": sum(f["ground"]["seen"] for f in valid),
        "planes": sum(len(f["planes"]) for f in valid),
        "prisms": sum(f["counts"]["prisms"] for f in valid),
        "strips": sum(f["counts"]["strips"] for f in valid),
        "dropped strips": sum(f["counts"]["dropped_strips"] for f in valid),
        "seen free, m": sum(sum(f["free"]["open_mm"]) for f in valid) // 1000,
        "support, px": sum(row[7] for f in valid for row in f["planes"]),
    }


def summary(name: str, golden: Result | None, now: Result, most: int = 12) -> str:
    """What an update changes: the totals, then the first fields."""
    if golden is None:
        return f"{name}: new; " + ", ".join(f"{key} {value}" for key, value in totals(now).items())
    found = list(differences({**golden, "made_with": now["made_with"]}, now))
    if not found:
        return f"{name}: as before"
    old, new = totals(golden), totals(now)
    lines = [f"{name}: {len(found)} differences"]
    lines += [f"  {key}: {old[key]} -> {new[key]}" for key in new if old[key] != new[key]]
    lines += [f"  {line}" for line in found[:most]]
    return "\n".join(lines + ([f"  ... and {len(found) - most} more"] if len(found) > most else []))


if __name__ == "__main__":
    (DATA / "golden").mkdir(parents=True, exist_ok=True)
    for stream in STREAMS:
        record(stream, recording_path(stream))
