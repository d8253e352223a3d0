"""The noise of a real D435 that stands still, with a range of 20 m."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler
from core.params import Params
from core.types import CameraInfo, ExtractorState, Intrinsics

K = Intrinsics(640, 480, 383.5, 383.5, 321.7, 236.8)
STILL = 7
"""The first frames of the recording, in which the camera hardly moves."""


@pytest.mark.parametrize("prior", [0.0015, 0.005])
def test_the_noise_of_a_still_camera_does_not_depend_on_what_was_told(shared_data: Path, prior: float) -> None:
    folder = shared_data / "rs_d435_handheld"
    with (folder / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))[:STILL]
    info = CameraInfo("d435", K, max_range_m=20.0, ke_per_m=prior)
    extractor, state = Extractor(Params()), ExtractorState()
    for row in rows:
        depth = np.asarray(cv2.imread(str(folder / row["file"]), cv2.IMREAD_UNCHANGED), np.uint16)
        R = rotation_from_euler(float(row["roll_rad"]), float(row["pitch_rad"]), 0.0) @ R_CAMFRD_OPTICAL
        model, state = extractor.extract(depth, info, R, state)
    assert 0.0033 <= model.ke_per_m <= 0.0065, "the differences of its frames over time are as large as that"
