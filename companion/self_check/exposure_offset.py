"""The measured offset between a camera's exposure stamps and the attitude, its text and its remedy.

Measured by exposure_monitor.py."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

WARN_S = 0.004
"""A larger measured offset is reported: at 60 deg/s it rotates the model by a quarter of a degree."""


class OffsetState(StrEnum):
    """Whether the offset is measured, otherwise why not."""

    NO_ATTITUDE = "no_attitude"
    NOT_ENOUGH_MOTION = "not_enough_motion"
    COLLECTING = "collecting"
    UNCERTAIN = "uncertain"
    MEASURED = "measured"


STATE_TEXTS = {
    OffsetState.NO_ATTITUDE: "not measured: no attitude around the exposures",
    OffsetState.NOT_ENOUGH_MOTION: "not measured: the vehicle has not turned enough; turn left and right for 20 s",
    OffsetState.COLLECTING: "not measured yet: collecting motion",
    OffsetState.UNCERTAIN: "not measured: images and attitude do not determine it; turn left and right for 20 s near obstacles",
    OffsetState.MEASURED: "measured",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureOffset:
    """The estimate of one camera."""

    camera: str
    state: OffsetState
    offset_s: float | None = None  # stamp minus true exposure on the attitude's time, None unless measured
    sigma_s: float | None = None  # its standard deviation
    pairs: int = 0  # number of image pairs

    @property
    def warns(self) -> bool:
        """Whether the offset is measured and significantly too large."""
        if self.offset_s is None or self.sigma_s is None:
            return False
        return abs(self.offset_s) > max(WARN_S, 3.0 * self.sigma_s)

    @property
    def text(self) -> str:
        """The state as text."""
        if self.offset_s is None or self.sigma_s is None:
            return STATE_TEXTS[self.state]
        late = "later" if self.offset_s >= 0.0 else "earlier"
        return (
            f"exposure stamps are {abs(self.offset_s) * 1000.0:.1f} ms {late} than the attitude indicates "
            f"(standard deviation {self.sigma_s * 1000.0:.1f} ms, {self.pairs} pairs of images)"
        )


def config_line(measured_s: float, configured_ms: float) -> str:
    """The configuration line that removes a measured offset."""
    return f"exposure_offset_ms = {round(configured_ms + 1000.0 * measured_s, 1):g}"


def warning_text(offset: ExposureOffset, configured_ms: float | None) -> str:
    """The diagnostic with its remedy; empty: none. configured_ms: the present value, None: unknown."""
    if not offset.warns or offset.offset_s is None:
        return ""
    if configured_ms is None:
        remedy = f"add {1000.0 * offset.offset_s:.1f} to exposure_offset_ms"
    else:
        remedy = f"set `{config_line(offset.offset_s, configured_ms)}`"
    return f'camera {offset.camera}: {offset.text}; {remedy} in [[camera]] "{offset.camera}"'
