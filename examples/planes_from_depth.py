"""From a depth image to obstacles. Run: .venv/bin/python examples/planes_from_depth.py"""

import numpy as np

from companion.kernels.warmup import ensure_compiled  # `companion` comes first: it names the cache of compiled kernels
from core.extractor import Extractor
from core.frames import R_CAMFRD_OPTICAL, rotation_from_euler, rotation_level_cam_optical
from core.types import CameraInfo, Intrinsics

ensure_compiled("extractor")  # takes a minute or two the first time on a computer, and shows its progress
depth = np.full((480, 640), 8000, np.uint16)  # millimetres (or float32 metres): a wall 8 m ahead, square to the camera
camera = CameraInfo("front", Intrinsics(width=640, height=480, fx=450.0, fy=450.0, cx=319.5, cy=239.5))
R_level_optical = rotation_level_cam_optical(rotation_from_euler(np.radians(5), 0.0, 0.0) @ R_CAMFRD_OPTICAL)  # roll
model, state = Extractor().extract(depth, camera, R_level_optical)  # give `state` to the next frame's call
if not model.valid:
    print(f"nothing is known, so nothing may be taken as free: {model.cause.text}")
for (a_x, a_y, b_x, b_y, top, bottom), margin in zip(model.planes, model.margin_m, strict=True):
    print(f"({a_x:.2f}, {a_y:.2f}) -> ({b_x:.2f}, {b_y:.2f}) m, {-bottom:.2f}..{-top:.2f} m up, margin {margin:.2f} m")
