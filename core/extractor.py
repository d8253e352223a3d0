"""The algorithm on one page: `Extractor.extract` calls the stages in the order of Figure 3 of the paper."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .buffers import Buffers
from .frames import Rotation
from .open_sky_params import OpenSkyParams
from .params import Params
from .stages.classify import classify, clear_range_m, depth_to_mm, pixel_limits
from .stages.depth_bias import DepthBias
from .stages.free_profile import PlaneStops, free_profile
from .stages.free_space import FreeObservation, WalkedView, observe_free
from .stages.ground import POINT, find_ground
from .stages.ground_ranges import with_ranges
from .stages.level import LevelledView, level_view
from .stages.model import PublishedPlanes, blind_model, pixel_stats, published_planes, strip_table
from .stages.noise_check import is_no_measurement
from .stages.open_space import observe_open
from .stages.plane_shaping import find_planes
from .stages.prisms import layered_prisms
from .stages.ramps import ramp_limits
from .stages.settings import Settings, settings_of
from .stages.smeared_edges import SmearedEdges, height_line, judge_edges, remove_smeared_edges
from .stages.strip_search import is_noise, search_strips
from .stages.temporal_noise import estimate_noise
from .stages.view_geometry import ViewGeometry, is_rotation, source_of, tilt_rad, view_geometry
from .types import (
    CameraInfo,
    ExtractorState,
    FrameModel,
    FrameStats,
    FreeProfile,
    Ground,
    InvalidCause,
    StripTable,
)


class Extractor:
    """Converts depth images to models. It holds parameters and scratch memory, no state between frames. Not
    thread-safe."""

    def __init__(self, params: Params | None = None, open_sky: OpenSkyParams | None = None) -> None:
        self.params = params or Params()
        self.open_sky = open_sky or OpenSkyParams()
        self._settings: Settings | None = None
        self._buffers = Buffers()

    def extract(
        self,
        depth: NDArray[np.uint16] | NDArray[np.float32],
        info: CameraInfo,
        R_level_optical: Rotation,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        """Returns the model of one depth image, and the state for the next image.

        The result depends on the arguments and the parameters only. A frame without information gives a model with
        valid = False and its cause.

        Args:
            depth: (H, W) uint16 millimetres or float32 metres along the optical axis.
            info: intrinsics, range and noise of the camera.
            R_level_optical: (3, 3) rotation from `optical` to `level_cam` at mid-exposure.
            state: state that the last image of this camera returned; None: the first image.
            keep_strips: the model contains its strips, for drawing and tests.

        Raises:
            ValueError: the image does not fit the intrinsics."""
        p, k, state = self.params, info.intrinsics, state or ExtractorState()
        R = np.ascontiguousarray(R_level_optical, np.float64)
        depth_mm = depth_to_mm(depth, self._buffers("depth", (k.height, k.width), np.uint16))
        is_marked = info.marks_smooth and depth.dtype == np.uint16
        view = usable_view(info, R, p)
        if isinstance(view, InvalidCause):
            return blind_model(info, view, p), state
        ke = state.ke_per_m if math.isfinite(state.ke_per_m) else info.ke_per_m
        limits = pixel_limits(info, ke, p)
        marks = self._buffers("marks", depth_mm.shape, np.uint16)
        counts = classify(depth_mm, limits, marks)
        if is_no_measurement(depth_mm, limits, counts, p):
            return blind_model(info, InvalidCause.NO_MEASUREMENT, p, pixel_stats(counts, depth_mm.size)), state
        source = source_of(info, R, clear_range_m(info, ke, p))
        ke, next_state = estimate_noise(state, depth_mm, marks, info, limits, p)
        points = self._buffers("ground_points", (p.ground_max_samples,), POINT)
        ground = find_ground(marks, info, R, ke, state.ground_height_m, p, points)
        next_state, smear = self._without_smears(next_state, depth_mm, marks, info, R, ke, ground)
        stats = pixel_stats(smear.remaining(counts), depth_mm.size, smeared_px=smear.pixels)
        # free space ends at the near end of a ramp; obstacles are searched without the pixels of ramps, below
        levelled = level_view(smear.free_marks, info, R, view, ke, p, self._buffers)
        free, opened = self._free_ranges(levelled, source, ground, ke, depth_mm if is_marked else None)
        if smear.active:
            levelled = level_view(marks, info, R, view, ke, p, self._buffers)
        settings = self._settings = settings_of(levelled.view, ke, p, self._settings, smear.active)
        strips = search_strips(levelled, source, ground, settings, p, self._buffers)
        if is_noise(strips, levelled, p):
            stats = replace(stats, dropped_strips=strips.before)
            return blind_model(info, InvalidCause.NO_MEASUREMENT, p, stats), state
        planes = find_planes(levelled, strips, source, settings, p, self._buffers)
        bias = DepthBias(info.bias_per_m, float(R[0, 2]), float(R[2, 2]))
        published = published_planes(planes, ground, levelled.view, bias, settings.view)
        if published is None:
            return blind_model(info, InvalidCause.NON_FINITE, p, stats), state
        if ground.seen:
            next_state = replace(next_state, ground_height_m=ground.height_m)
            ground = with_ranges(ground, points, free.edges_t)
        stops = PlaneStops(planes[: len(published.rows)], published.noise_margin_m)
        profile = free_profile(free, stops, bias, opened, self.open_sky.open_max_range_m)
        table = strip_table(strips.found.table, strips.found.count) if keep_strips else None
        return self._model(published, profile, ground, strips.counted(stats), ke, table), next_state

    def _without_smears(
        self,
        state: ExtractorState,
        depth_mm: NDArray[np.uint16],
        marks: NDArray[np.uint16],
        info: CameraInfo,
        R_level_optical: Rotation,
        ke_per_m: float,
        ground: Ground,
    ) -> tuple[ExtractorState, SmearedEdges]:
        """Makes the ramps in `marks` unknown if the camera smears its edges; returns the state after this frame, and what
        was removed."""
        limits = ramp_limits(info, ke_per_m)
        state, is_smeared = judge_edges(state, depth_mm, limits, self.params)
        if not is_smeared:
            return state, SmearedEdges(active=False, free_marks=marks)
        heights = height_line(info, R_level_optical, ground, self.params)
        return state, remove_smeared_edges(depth_mm, marks, limits, heights, self._buffers)

    def _free_ranges(
        self,
        levelled: LevelledView,
        source: NDArray[Any],
        ground: Ground,
        ke_per_m: float,
        marked_mm: NDArray[np.uint16] | None,
    ) -> tuple[FreeObservation, FreeObservation | None]:
        """Returns the free ranges by the pixels, and the free or open ones; None: nothing is presumed.

        marked_mm: the depth image if its driver marks smooth surfaces (CameraInfo.marks_smooth), else None."""
        walked = WalkedView(
            codes=levelled.exact_codes,
            geometry=levelled.exact_view,
            source=source,
            ground=ground,
            ke_per_m=ke_per_m,
        )
        free, opened = observe_free(walked, self.params), None
        if marked_mm is not None:
            opened = observe_open(marked_mm, walked, self.params, self.open_sky, self._buffers)
        return free, None if opened is None else opened.seen

    def _model(
        self,
        published: PublishedPlanes,
        profile: FreeProfile,
        ground: Ground,
        stats: FrameStats,
        ke: float,
        strips: StripTable | None,
    ) -> FrameModel:
        """Returns the model: planes as rectangles, layered prisms (Section 3), and the free-range profile."""
        p, rows, margin, cluster = self.params, published.rows, published.margin_m, published.cluster
        prisms = layered_prisms(rows, margin, cluster, p.layer_join_m, p.profile_join_m)
        return FrameModel(
            valid=True,
            cause=InvalidCause.NONE,
            planes=rows,
            support_px=published.support_px,
            margin_m=margin,
            flags=published.flags,
            cluster=cluster,
            prisms=prisms,
            free=profile,
            ground=ground,
            stats=replace(stats, clusters=len(set(cluster.tolist())), planes=len(rows), prisms=len(prisms)),
            ke_per_m=ke,
            strips=strips,
        )


def usable_view(info: CameraInfo, R_level_optical: Rotation, params: Params) -> ViewGeometry | InvalidCause:
    """Returns the geometry of the levelled view, or why there is none."""
    R = R_level_optical
    if R.shape != (3, 3) or not is_rotation(R, 1e-3):
        return InvalidCause.BAD_ROTATION
    if abs(R[1, 2]) > 0.02 or R[0, 2] < -0.02:
        return InvalidCause.BAD_ROTATION  # level_cam's x is the optical axis' own heading
    if tilt_rad(R) > math.radians(params.max_tilt_deg):
        return InvalidCause.TOO_STEEP
    view = view_geometry(info, R, params)
    return InvalidCause.TOO_STEEP if view.is_empty else view
