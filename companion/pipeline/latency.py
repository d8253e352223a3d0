"""Latency of frames by stage: percentiles over the newest frames."""

from __future__ import annotations

from collections import deque

from core.codes import Code


class LatencyStage(Code):
    """Measured stages in processing order. EXTRACT exceeds EXTRACT_CPU by the time in which other threads or programs
    had the processor."""

    CAMERA = "camera", "exposure to arrival"
    WAIT = "wait", "waiting"
    EXTRACT = "extract", "extracting"
    EXTRACT_CPU = "extract_cpu", "extracting, processor time"
    PUBLISH = "publish", "publishing"
    EXPOSURE_TO_PUBLISH = "exposure_to_publish", "exposure to published"
    EXPOSURE_TO_AUTOPILOT = "exposure_to_autopilot", "exposure to obstacle message"


FRAME_STAGES = (
    LatencyStage.CAMERA,
    LatencyStage.WAIT,
    LatencyStage.EXTRACT,
    LatencyStage.EXTRACT_CPU,
    LatencyStage.PUBLISH,
    LatencyStage.EXPOSURE_TO_PUBLISH,
)
_WINDOW = 512


class Latencies:
    """`add` takes nanoseconds; `percentiles` returns milliseconds."""

    def __init__(self, stages: tuple[LatencyStage, ...] = FRAME_STAGES) -> None:
        self._newest_ns: dict[LatencyStage, deque[int]] = {stage: deque(maxlen=_WINDOW) for stage in stages}

    def add(self, stage: LatencyStage, took_ns: int) -> None:
        """Adds the time of one frame in a stage."""
        self._newest_ns[stage].append(took_ns)

    def percentiles(self) -> list[tuple[LatencyStage, float, float, float]]:
        """(stage, p50, p95, p99) in ms of the stages with frames. The p-th percentile is the smallest value that p % do
        not exceed."""
        found = []
        for stage, held in self._newest_ns.items():
            if held:
                ordered = sorted(held)
                last = len(ordered) - 1
                p50, p95, p99 = (ordered[min(last, -(-len(ordered) * p // 100) - 1)] / 1e6 for p in (50, 95, 99))
                found.append((stage, p50, p95, p99))
        return found
