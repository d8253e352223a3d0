"""The extractor in one of its two forms: "safe", which flies, or "paper", as printed."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.printed.extractor import PaperExtractor
from benchmarks.paper.printed.params import PaperParams
from core.extractor import Extractor
from core.frames import Rotation
from core.params import Params
from core.types import CameraInfo, ExtractorState, FrameModel

MODES = ("safe", "paper")


class AnyExtractor(Protocol):
    """What both forms offer."""

    def extract(
        self,
        depth: NDArray[np.uint16] | NDArray[np.float32],
        info: CameraInfo,
        R_level_optical: Rotation,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        """See `Extractor.extract`."""


def params_of(mode: str, **values: Any) -> Params:
    """The parameters of a form, with some of them changed. Raises ValueError for an unknown form."""
    if mode not in MODES:
        raise ValueError(f"no form {mode!r}; there are {', '.join(MODES)}")
    return PaperParams(**values) if mode == "paper" else Params(**values)


def mode_of(params: Params) -> str:
    """The form that parameters belong to."""
    return "paper" if isinstance(params, PaperParams) else "safe"


def extractor_of(params: Params) -> AnyExtractor:
    """An extractor of the form that the parameters belong to."""
    return PaperExtractor(params) if isinstance(params, PaperParams) else Extractor(params)
