"""Recomputes the strips of a logged frame from its depth image, since a log does not contain them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.extractor import Extractor
from core.params import Params
from core.types import ExtractorState

from .frame import FrameStatus, ViewFrame

AGREE_M = 0.01
"""Largest difference between recomputed and logged planes: rounding and processor type."""


class StripFinder:
    """Computes strips with the parameters of the log; keeps its buffers between frames."""

    def __init__(self, params: Params) -> None:
        self._extractor = Extractor(replace(params, estimate_noise=False))

    def with_strips(self, frame: ViewFrame, state: ExtractorState) -> ViewFrame:
        """The frame with the strips behind its planes. Unchanged where they cannot be recomputed: no depth image, a
        blind frame, or planes of another version or configuration."""
        R = frame.R_level_cam_optical
        if frame.status is not FrameStatus.VALID or frame.depth_mm is None or frame.model is None or R is None:
            return frame
        # the log contains the noise estimate but not its input
        info = replace(frame.info, ke_per_m=frame.model.ke_per_m)
        found, _ = self._extractor.extract(frame.depth_mm, info, R, state, keep_strips=True)
        logged = frame.model.planes
        same = logged.shape == found.planes.shape and (np.abs(logged - found.planes) < AGREE_M).all()
        if found.strips is None or not same:
            return frame
        return replace(frame, model=replace(frame.model, strips=found.strips))
