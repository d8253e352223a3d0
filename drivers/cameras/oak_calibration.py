"""The baseline of a Luxonis OAK, from the calibration that is stored on the device."""

from __future__ import annotations

from typing import Any

from ..base import BadData

MOST_DIFFERENCE = 0.05
"""Relative. A measured baseline that differs more from the design is of another device or of a failed calibration: a depth is
proportional to the baseline. A difference of 2.5 % has been reported from a correct device (depthai-core issue 358)."""


def baseline_m(calibration: Any, camera: str) -> float:
    """The distance of both cameras by design, with which the device computes its own depth; the measured one where the
    design is not stored. The maker states that the design is the more accurate one (depthai-core issue 847).

    calibration: dai.CalibrationHandler. Raises BadData where neither is stored, and where they differ by more than
    MOST_DIFFERENCE."""
    design_m, measured_m = _distance_m(calibration, design=True), _distance_m(calibration, design=False)
    found_m = design_m if design_m > 0.0 else measured_m
    if not found_m > 0.0:
        raise BadData(
            f"camera {camera}: the device reports no baseline; check that it has its factory calibration, and restart it"
        )
    if measured_m > 0.0 and abs(measured_m - found_m) > MOST_DIFFERENCE * found_m:
        raise BadData(
            f"camera {camera}: the calibration of the device has a measured baseline of {measured_m:.4f} m, its design has "
            f"{design_m:.4f} m; a depth would be wrong by {abs(measured_m / found_m - 1.0):.0%}. Calibrate the device again"
        )
    return found_m


def _distance_m(calibration: Any, design: bool) -> float:
    """0: not stored."""
    try:
        return float(calibration.getBaselineDistance(useSpecTranslation=design)) / 100.0
    except RuntimeError:
        return 0.0
