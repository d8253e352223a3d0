"""Whether this computer keeps up with its cameras, from the health report."""

from __future__ import annotations

from typing import Final

from osape_client.proto import osape_v1_pb2 as pb

from ..pipeline.latency import LatencyStage
from ..pipeline.sync import DropCause

BUSY_SHARE, BUSY_MS = 0.5, 20.0
"""A frame that waits for a processor for a greater share of its time than this, and longer, is delayed by other work."""
FULL_SHARE: Final = 0.9
"""Share of the time in which a frame is processed from which frames are superseded: their times vary."""


def load_text(h: pb.Health) -> str:
    """Why frames are late or left out, with the remedy: other work of this computer, or a computer that is too slow for its
    cameras; empty: neither."""
    median_ms = {latency.stage: latency.p50_ms for latency in h.latencies}
    took_ms = median_ms.get(LatencyStage.EXTRACT.value, 0.0)
    cpu_ms = median_ms.get(LatencyStage.EXTRACT_CPU.value, took_ms)
    if took_ms - cpu_ms > max(BUSY_MS, BUSY_SHARE * took_ms):
        return (
            f"this computer is busy: a frame took {took_ms:.0f} ms for {cpu_ms:.0f} ms of processor time (median); end "
            "other programs"
        )
    whole_ms = took_ms + median_ms.get(LatencyStage.PUBLISH.value, 0.0)
    rate_hz = sum(c.hz for c in h.cameras)
    superseded = h.frames_dropped.get(DropCause.BUSY.value, 0)
    if not superseded or rate_hz * whole_ms < 1000.0 * FULL_SHARE:
        return ""
    return (
        f"this computer is too slow: a frame takes {whole_ms:.0f} ms (median), and {rate_hz:.0f} arrive a second; {superseded} "
        f"of {superseded + h.frames_used} were superseded by newer ones. Lower fps or the image size of [[camera]], or set "
        "[extractor] column_step = 2, which may lose thin obstacles; `companion bench` measures this computer"
    )
