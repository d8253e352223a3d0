"""Parameters of the printed form: those of the extractor, and five that only the paper has."""

from __future__ import annotations

from dataclasses import dataclass

from core.param_field import number
from core.params import Params


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperParams(Params):
    """Parameters of `PaperExtractor`. Raises ValueError naming the field, its value and its range."""

    paper_roll_deg: float = number(2.0, 0.0, 30.0, "deg", "the image is rotated when the camera rolls more [phi0]")
    paper_line_tolerance_m: float = number(
        0.2, 0.02, 1.0, "m", "greatest misfit of a plane, if line_tolerance_m is less [eps_l]"
    )
    horizontal_correlation: float = number(
        0.05, 0.001, 0.5, "", "a surface is horizontal when 1 - |r| of its rows and disparities is below this [eps_r]"
    )
    horizontal_centre_px: float = number(
        20.0, 1.0, 200.0, "px", "greatest distance of its vanishing row from the horizon [eps_v]"
    )
    horizontal_min_px: int = number(6, 3, 100, "px", "least number of pixels of a horizontal surface")
