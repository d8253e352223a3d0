"""The extractor in one of its two forms: "safe", which flies, or "paper", as printed."""

from __future__ import annotations

from typing import Any

from benchmarks.paper.printed.extractor import PaperExtractor
from benchmarks.paper.printed.params import PaperParams
from core.extractor import Extractor
from core.params import Params

MODES = ("safe", "paper")


AnyExtractor = Extractor | PaperExtractor
"""Both are called in the same way, see `Extractor.extract`."""


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
