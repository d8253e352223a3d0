"""What rows that differ cost: rendered stereo whose right camera is rotated by an error of the calibration.

    python -m benchmarks.open_air.rows_apart
    python -m benchmarks.open_air.rows_apart --scenes field,street --errors 0:0,0.5:0,0:0.1

--errors: pitch in pixels and roll in degrees. Per scene and error: the measured pixels, planes, directions that are free or
open to 10 m, and wrong cells, once as it is and once with the rows aligned as the driver aligns them; and the rotation that is
left then. Only a driver that matches on the host aligns the rows; both state the error of all depths that follows."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.open_air.open_claims import claims_of, marked
from benchmarks.open_air.view_options import add_view_options, views, words
from benchmarks.open_air.views import View, pose_of, profile_of, scene_of
from companion.argument_parser import ArgumentParser
from core.extractor import Extractor
from core.frames import rotation_level_cam_optical
from core.open_sky_params import OpenSkyParams
from core.params import Params
from core.types import CameraInfo, ExtractorState, FrameModel, Intrinsics, is_measured
from drivers.base import BadData
from drivers.cameras.right_rotation import RightRotation
from drivers.cameras.row_alignment import MEASUREMENTS, RowAlignment
from drivers.cameras.stereo_errors import bias_coefficient
from drivers.simulation.source import Rendered, look
from drivers.simulation.stereo.pair_renderer import PairBrightness, StereoPair, brightness, expose_pair
from drivers.simulation.stereo.shading import Light
from drivers.simulation.stereo.stereo_profiles import StereoCamera
from drivers.simulation.stereo.stereo_scenes import StereoScene

FRAMES = 2
"""The last one is judged, as in `views.see`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Camera:
    """A stereo camera at its place before a scene, with a rotated right eye."""

    camera: StereoCamera
    scene: StereoScene
    R_ned_optical: NDArray[np.float64]
    at_ned_m: NDArray[np.float64]
    left: NDArray[np.float32]
    right: NDArray[np.float32]

    def pair(self, frame: int) -> StereoPair:
        """The images of a frame."""
        bright = PairBrightness(left=self.left, right=self.right)
        return expose_pair(bright, self.camera.profile.view.exposure, 0, frame)

    def model(self, extractor: Extractor, rotation: RightRotation, row_error_px: float) -> tuple[Rendered, FrameModel]:
        """The last frame, aligned by a rotation, and its model."""
        profile, state = self.camera.profile, ExtractorState()
        k = profile.view.intrinsics
        info: CameraInfo = replace(
            profile.info(), bias_per_m=bias_coefficient(k, profile.view.baseline_m, row_error_px)
        )
        R_level = rotation_level_cam_optical(self.R_ned_optical)
        for frame in range(FRAMES):
            pair = self.pair(frame)
            depth = self.camera.depth_of(replace(pair, right=rotation.turned(pair.right, k)))
            model, state = extractor.extract(depth, info, R_level, state=state)
        truth = look(self.scene.scene, info, self.R_ned_optical, self.at_ned_m)
        return Rendered(self.scene.scene, info, depth, self.R_ned_optical, R_level, self.at_ned_m, truth), model


def bent(camera: StereoCamera, view: View, left: NDArray[np.float32] | None, error: RightRotation) -> Camera:
    """The camera of a view. left: its left image where it was rendered before."""
    scene = scene_of(view.scene, view.seed, view.sky)
    R, at = pose_of(view, scene)
    light = Light(sky=scene.sky, fog_per_m=scene.fog_per_m, seed=view.seed)
    k, baseline_m = camera.profile.view.intrinsics, camera.profile.view.baseline_m
    eye = (scene.surfaces, scene.panes, k)
    return Camera(
        camera=camera,
        scene=scene,
        R_ned_optical=R,
        at_ned_m=at,
        left=brightness(*eye, R, at, light, at) if left is None else left,
        right=brightness(*eye, R @ error.R_rectified_right, at + R[:, 0] * baseline_m, light, at),
    )


def align(seen: Camera, k: Intrinsics) -> RowAlignment | None:
    """The alignment after as many frames as it needs; None: the driver refuses the camera."""
    alignment = RowAlignment("front", "", corrects=True)
    try:
        for frame in range(MEASUREMENTS):
            pair = seen.pair(frame)
            alignment.take(pair.left, alignment.rotation.turned(pair.right, k), k)
    except BadData:
        return None
    alignment.opened(k)
    return alignment


def row(name: str, frame: Rendered, model: FrameModel, camera: StereoCamera, params: Params) -> list[str]:
    """Cells of a table."""
    profile = camera.profile
    claims = claims_of(frame, model, profile.unmatched_left_px, params, profile.unmatched_right_px)
    return [
        name,
        f"{100.0 * is_measured(frame.depth_mm).mean():.1f}",
        str(len(model.planes)),
        f"{claims.opened} of {claims.directions}",
        str(claims.wrong_free + len(claims.wrong_open)),
    ]


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    p = ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_view_options(p)
    p.set_defaults(scenes=["field", "hill_crest", "street"], heights=["2"], skies=["clear"])
    p.add_argument(
        "--errors",
        type=words,
        default=["0:0", "0.1:0", "0.2:0", "0.3:0", "0.5:0", "1:0", "1.4:0", "0:0.05", "0:0.1", "0:0.2"],
    )
    return p.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Prints a table; returns 1 where a cell is wrong."""
    a = parse(arguments)
    camera = StereoCamera(marked(profile_of(a.profile)))
    k = camera.profile.view.intrinsics
    extractor = Extractor(Params(), OpenSkyParams(mode="presume"))
    wrong = 0
    print("| scene | pitch px, roll deg | rows | measured % | planes | open | wrong | left px |")
    print("|---|---|---|---:|---:|---:|---:|---:|")
    for scene in a.scenes:
        for view in views(a, scene):
            left = None
            for text in a.errors:
                pitch_px, roll_deg = (float(part) for part in text.split(":"))
                error = RightRotation(pitch_px / k.fy, math.radians(roll_deg))
                seen = bent(camera, view, left, error)
                left = seen.left
                alignment = align(seen, k)
                judged = [("as they are", RightRotation(), error.error_px(k))]
                if alignment is not None and alignment.settled:
                    judged.append(("aligned", alignment.rotation, alignment.row_error_px))
                for name, rotation, row_error_px in judged:
                    cells = row(name, *seen.model(extractor, rotation, row_error_px), camera, extractor.params)
                    wrong += int(cells[-1])
                    rest = f"{(error - rotation).greatest_row_px(k):.2f}"
                    print("| " + " | ".join([f"{scene} {view.height_m:g} m", text, *cells, rest]) + " |", flush=True)
                if len(judged) == 1:
                    print(f"| {scene} | {text} | {'refused' if alignment is None else 'not measured'} |", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
