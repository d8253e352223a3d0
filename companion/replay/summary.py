"""Counts the inputs and outputs of a pipeline."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from core.codes import texts_of
from core.types import AttitudeSample, DepthFrame, InvalidCause
from drivers.base import Event

from ..pipeline.results import FrameDecision, Output
from ..pipeline.sync import DropCause
from .advice import Advice, ViewTally, advice_of


@dataclass(slots=True)
class ReplayCounts:
    """Numbers of inputs and outputs."""

    frames: int = 0
    samples: int = 0
    planes: int = 0
    prisms: int = 0
    # blind, dropped: by the code of the cause
    blind: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    attitude: Counter[str] = field(default_factory=Counter)
    frames_in: Counter[str] = field(default_factory=Counter)
    first_dropped: FrameDecision | None = None
    ke_per_m: dict[str, float] = field(default_factory=dict)
    """Depth noise of the last valid frame of each camera."""
    view: ViewTally = field(default_factory=ViewTally)
    _attitude_ns: list[int] = field(default_factory=list)

    def event(self, event: Event) -> None:
        """Counts an input."""
        if isinstance(event, DepthFrame):
            self.frames += 1
        else:
            self.samples += 1
            if isinstance(event, AttitudeSample):
                self._attitude_ns.append(event.t_ns)

    def output(self, output: Output) -> None:
        """Counts an output."""
        if isinstance(output, FrameDecision):
            if output.used:
                self.attitude[output.attitude.name.lower()] += 1
            else:
                self.dropped[output.cause.value] += 1
                self.first_dropped = self.first_dropped or output
            return
        self.frames_in[output.frame] += 1
        if output.model is None:
            return
        if not output.valid:
            self.blind[output.cause.value] += 1
            return
        self.ke_per_m[output.camera] = output.model.ke_per_m
        self.planes += len(output.model.planes)
        self.prisms += len(output.model.prisms)
        self.view.add(output.model, 0.0 if output.transform is None else output.transform.translation_m[2])

    @property
    def valid(self) -> int:
        """Number of valid frames."""
        return self.view.frames

    @property
    def attitude_hz(self) -> float:
        """Usual rate of the attitude, from the median interval; 0 with less than three."""
        stamps = np.unique(self._attitude_ns)
        return float(1e9 / np.median(np.diff(stamps))) if len(stamps) > 2 else 0.0

    def advice(self) -> list[Advice]:
        """What limits the use of the results."""
        causes = (DropCause.NO_ATTITUDE, DropCause.ATTITUDE_STALE, DropCause.GAP_TOO_WIDE)
        return advice_of(self.view, self.frames, sum(self.dropped[c.value] for c in causes), self.attitude_hz)

    def as_json(self) -> dict[str, Any]:
        """The counts for `--json`."""
        return {
            "frames": self.frames,
            "samples": self.samples,
            "valid": self.valid,
            "invalid": dict(sorted(self.blind.items())),
            "dropped": dict(sorted(self.dropped.items())),
            "texts": texts_of(sorted(self.blind), InvalidCause) | texts_of(sorted(self.dropped), DropCause),
            "attitude": dict(sorted(self.attitude.items())),
            "published_in": dict(sorted(self.frames_in.items())),
            "planes": self.planes,
            "prisms": self.prisms,
            "ground_seen": self.view.ground_seen,
            "free_share": round(self.view.mean_free_share, 4),
            "measured_share": round(self.view.mean_measured_share, 4),
            "attitude_hz": round(self.attitude_hz, 2),
            "advice": [{"code": str(a.code), "text": a.text} for a in self.advice()],
        }
