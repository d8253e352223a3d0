"""Reads the factory calibration of a ZED: SN<serial>.conf, which the manufacturer provides for each camera.

Older files have no k3, TY and TZ, name the resolutions 2K, FHD, HD, VGA, and have trailing blanks; some have TY and TZ for each
resolution. Lengths are millimetres; angles are the components of a rotation vector in radians (CV is the one about y)."""

from __future__ import annotations

import configparser
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base import BadData, DeviceNotFound
from ..regular_file import regular

RESOLUTIONS = {"2K": (2208, 1242), "FHD": (1920, 1080), "HD": (1280, 720), "VGA": (672, 376)}
"""Name in the file -> image size of one eye."""

Floats = NDArray[np.float64]
MOST_TURNED_DEG, MOST_ASIDE = 10.0, 0.1
"""Greatest rotation between both eyes, and greatest offset across the baseline as a share of it: real files have 1.4 degrees and
a hundredth."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EyeCalibration:
    """matrix: (3, 3); distortion: (5,) k1, k2, p1, p2, k3, or (12,) with k4, k5, k6, s1, s2, s3, s4 too."""

    matrix: Floats
    distortion: Floats


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoCalibration:
    """The calibration for one resolution. p_right = R p_left + T, optical axes, T in metres: OpenCV's convention, T[0]
    < 0."""

    width: int
    height: int
    left: EyeCalibration
    right: EyeCalibration
    R: Floats
    T: Floats

    @property
    def baseline_m(self) -> float:
        """Distance between the optical centres."""
        return float(np.linalg.norm(self.T))


def load_zed_calibration(path: Path, width: int, height: int) -> StereoCalibration:
    """The calibration for images of width x height per eye. Raises DeviceNotFound and BadData."""
    try:
        text = regular(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not a text file"
        raise DeviceNotFound(
            f"{path}: {reason}; download the camera's SN<serial>.conf from the manufacturer's site"
        ) from error
    return parse_zed_calibration(text, str(path), width, height)


def parse_zed_calibration(text: str, source: str, width: int, height: int) -> StereoCalibration:
    """As load_zed_calibration, from the text of the file."""
    name = next((n for n, size in RESOLUTIONS.items() if size == (width, height)), None)
    if name is None:
        sizes = ", ".join(f"{w}x{h}" for w, h in RESOLUTIONS.values())
        raise BadData(f"{source}: no calibration for {width}x{height}; a ZED delivers {sizes} per eye")
    parser = configparser.ConfigParser(strict=False)
    try:
        parser.read_string(text, source)
        left, right = _eye(parser, f"LEFT_CAM_{name}"), _eye(parser, f"RIGHT_CAM_{name}")
        stereo = parser["STEREO"]
        baseline_mm = float(stereo["Baseline"])
        vector = np.array([float(stereo[f"{key}_{name}"]) for key in ("RX", "CV", "RZ")])
        aside = (float(stereo.get(f"{key}_{name}", stereo.get(key, "0"))) for key in ("TY", "TZ"))
        offset_mm = np.array([-baseline_mm, *aside])
    except (configparser.Error, KeyError, ValueError) as error:
        cause = " ".join(str(error).split())  # of configparser: several lines
        raise BadData(f"{source}: not a ZED calibration ({cause}); download it again") from error
    if not 20.0 <= baseline_mm <= 500.0:
        raise BadData(f"{source}: a baseline of {baseline_mm:g} mm; expected about 63 or 120")
    turned_deg, aside_mm = math.degrees(float(np.linalg.norm(vector))), float(np.abs(offset_mm[1:]).max())
    if not (turned_deg <= MOST_TURNED_DEG and aside_mm <= MOST_ASIDE * baseline_mm):  # also catches NaN
        raise BadData(
            f"{source}: eyes turned by {turned_deg:.1f} deg against each other and {aside_mm:g} mm above or behind each other cannot "
            "be those of a ZED; download the file again"
        )
    return StereoCalibration(
        width=width, height=height, left=left, right=right, R=rotation_from_vector(vector), T=offset_mm / 1000.0
    )


def rotation_from_vector(vector: Floats) -> Floats:
    """(3, 3) rotation by |vector| about it (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


def _eye(parser: configparser.ConfigParser, section: str) -> EyeCalibration:
    s = parser[section]
    fx, fy, cx, cy = (float(s[key]) for key in ("fx", "fy", "cx", "cy"))
    distortion = [float(s[key]) for key in ("k1", "k2", "p1", "p2")] + [float(s.get("k3", "0"))]
    further = [float(s.get(key, "0")) for key in ("k4", "k5", "k6", "s1", "s2", "s3", "s4")]
    if any(further):
        distortion += further
    if not all(map(math.isfinite, [fx, fy, cx, cy, *distortion])) or fx <= 0.0 or fy <= 0.0:
        raise ValueError(f"[{section}] contains invalid camera parameters")
    return EyeCalibration(
        matrix=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), distortion=np.array(distortion)
    )
