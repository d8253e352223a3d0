"""The state of the pipeline that later frames depend on. A log holds it at its beginning."""

from __future__ import annotations

from dataclasses import dataclass, field

from core.self_check.mount_check import MountState
from core.types import AttitudeSample, ExtractorState, PoseSample

from .heading_jumps import HeadingState
from .position_sections import PositionState
from .tracking import NamedStates


@dataclass(frozen=True, slots=True)
class CameraState:
    """State of one camera that its next frame depends on."""

    extractor: ExtractorState = field(default_factory=ExtractorState)
    last_t_exposure_ns: int | None = None  # of the newest frame; None: none yet
    mount: MountState = field(default_factory=MountState)
    # first exposure of the frames in a row that lie far before it; None: the last frame does not
    back_since_ns: int | None = None


@dataclass(frozen=True, slots=True)
class PipelineState:
    """The complete state that later frames depend on; a pipeline started with it continues identically."""

    cameras: tuple[tuple[str, CameraState], ...] = ()
    attitudes: tuple[AttitudeSample, ...] = ()
    poses: tuple[PoseSample, ...] = ()
    trackers: NamedStates = ()
    # headings, sections: jumps of the estimate; None: they are detected in the samples
    headings: HeadingState | None = None
    sections: PositionState | None = None
