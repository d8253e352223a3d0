"""The paper on one page: `Extractor.extract` follows its Figure 3, with the stages in the order in which they run."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .buffers import Buffers
from .frames import Rotation
from .params import Params
from .stages.classify import classify, clear_range_m, depth_to_mm, estimate_ke, measured_mm
from .stages.columns import extract_strips
from .stages.free_space import SeenFree, free_profile, seen_free
from .stages.ground import find_ground, ground_noise_test, ground_threshold, with_ranges
from .stages.level import level_safe, pool_columns
from .stages.model import PublishedPlanes, blind_model, pixel_stats, published_planes, strip_table
from .stages.noise_check import flying_off_ramps, noisy_share
from .stages.openings import find_openings
from .stages.plane_shaping import plane_buffers, shape_planes
from .stages.prisms import layered_prisms
from .stages.settings import Settings, settings_of
from .stages.smeared_edges import drop_smeared_edges, observe_edges, ramp_limits, smears
from .stages.strip_search import settle_strips, strip_buffers
from .stages.strips import STRIP
from .stages.temporal_noise import observe
from .stages.view_geometry import ViewGeometry, is_rotation, pooled_geometry, source_of, tilt_rad, view_geometry
from .types import CameraInfo, ExtractorState, FrameModel, Ground, InvalidCause

_MORE_COLS, _MORE_STRIPS = 32, 512
"""Tables are made for a multiple of these: seldom anew, and hardly larger than the largest frame needs."""


class Extractor:
    """Turns depth frames into planes. Holds its parameters and scratch memory, nothing that outlives a frame.

    Not for two threads at once; make one each."""

    def __init__(self, params: Params | None = None) -> None:
        self.params = params or Params()
        self._settings: Settings | None = None
        self._make_strip_tables(0)
        self._room_for_strips = 0
        self._plane_buffers = plane_buffers(self._room_for_strips, self.params.merge_partners)
        self._buffer = Buffers()

    def extract(
        self,
        depth: NDArray[np.uint16] | NDArray[np.float32],
        info: CameraInfo,
        R_level_optical: Rotation,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        """(model, next state) of one depth frame.

        depth: (H, W) uint16 millimetres or float32 metres along the optical axis. R_level_optical: (3, 3) rotation from
        `optical` to `level_cam` at mid-exposure. A pure function of its arguments and the parameters. Raises
        ValueError where the image does not fit the intrinsics; a frame that says nothing comes back as
        valid = False with its cause."""
        state = state or ExtractorState()
        R = np.ascontiguousarray(R_level_optical, np.float64)
        k = info.intrinsics
        depth_mm = depth_to_mm(depth, self._buffer("depth", (k.height, k.width), np.uint16))
        cause = rotation_cause(R, self.params)
        if cause:
            return blind_model(info, cause, self.params), state
        exact_view = view_geometry(info, R, self.params)
        if exact_view.is_empty:
            return blind_model(info, InvalidCause.TOO_STEEP, self.params), state
        ke = state.ke_per_m if math.isfinite(state.ke_per_m) else info.ke_per_m
        marks, counts = self._classify(depth_mm, info, ke)
        measured, far, flying = counts
        too_few = (measured - flying) / depth_mm.size + far / depth_mm.size < self.params.min_measured_share
        if too_few or self._is_noise(depth_mm, info, ke, counts):
            stats = pixel_stats(counts, depth_mm.size)
            return blind_model(info, InvalidCause.NO_MEASUREMENT, self.params, stats), state
        clear_m = clear_range_m(info, ke, self.params)
        after = observe(state, depth_mm, marks, k.fx, measured_mm(info, ke, self.params), self.params)
        # the first measurement over time outranks all that was believed before it
        first = math.isfinite(after.still_ke_per_m) and not math.isfinite(state.still_ke_per_m)
        last = math.nan if first else state.ke_per_m
        ke = estimate_ke(marks, k.fx, info.ke_per_m, last, after.still_ke_per_m, self.params)

        ground = self._ground(marks, info, R, ke, state)
        limits = ramp_limits(info, ke, self.params)
        after = observe_edges(after, depth_mm, limits, self.params)
        smeared, seen_to = smears(after, self.params), marks
        if smeared:
            seen_to, lost, lost_far = drop_smeared_edges(
                depth_mm, marks, info, R, ground, limits, self.params, self._buffer
            )
            counts = measured - lost, far - lost_far, flying
        codes, view, exact = self._level(seen_to, info, R, ke, exact_view)
        settings = self._settings = settings_of(view, ke, self.params, self._settings, smeared)
        seen = seen_free(*exact, (k.width, k.height), ground, clear_m, ke, self.params)  # while the codes are at hand
        if smeared:
            codes, view, _ = self._level(marks, info, R, ke, exact_view)
        source = source_of(info, R, clear_m)
        n, found, ground_px, overflow = self._strips(codes, view, source, ground, ke, settings)
        if self._is_shreds(found, view):
            stats = pixel_stats(counts, depth_mm.size, dropped_strips=found)
            return blind_model(info, InvalidCause.NO_MEASUREMENT, self.params, stats), state
        count = self._planes(codes, n, view, source, info, settings)
        planes = self._plane_buffers.planes

        told = published_planes(count, planes, ground, view, self.params)
        if told is None:
            stats = pixel_stats(counts, depth_mm.size)
            return blind_model(info, InvalidCause.NON_FINITE, self.params, stats), state
        return self._model(
            told, seen, ground, ke, n, planes, keep_strips, counts, depth_mm.size, ground_px=ground_px, strips=n,
            dropped_strips=found - n, overflow=overflow, smeared_px=measured + far - counts[0] - counts[1],
        ), replace(
            after, ground_height_m=ground.height_m if ground.seen else state.ground_height_m, ke_per_m=ke
        )  # fmt: skip

    # ---- pixels -------------------------------------------------------------------------------------------------

    def _classify(
        self, depth_mm: NDArray[np.uint16], info: CameraInfo, ke: float
    ) -> tuple[NDArray[np.uint16], tuple[int, int, int]]:
        """The image with unknown and far marked, flying pixels taken out; counts (measured, far, flying)."""
        marks = self._buffer("marks", depth_mm.shape, np.uint16)
        counts = classify(
            depth_mm,
            *measured_mm(info, ke, self.params),
            self.params.flying_relative,
            self.params.flying_sigmas * ke,
            marks,
        )
        return marks, counts

    def _is_noise(
        self, depth_mm: NDArray[np.uint16], info: CameraInfo, ke: float, counts: tuple[int, int, int]
    ) -> bool:
        """Whether so many pixels fly that the rest is no measurement either, or many tiles of the picture are noise.

        Pure noise has 27 % flying, foliage 0.2 %; flying pixels on ramps are ground close below the camera and do not count.
        Without this such an image would cost minutes in the merge, and its model would be no one's."""
        p, (measured, _, flying) = self.params, counts
        if flying <= min(p.max_flying_share, p.noisy_look_share) * measured:
            return False
        limits = measured_mm(info, ke, p)
        if flying > p.max_flying_share * measured:
            scattered = flying_off_ramps(depth_mm, *limits, p.flying_relative, p.flying_sigmas * ke)
            if scattered > p.max_flying_share * measured:
                return True
        return noisy_share(depth_mm, *limits, ke, p) > p.max_noisy_share

    def _is_shreds(self, strips: int, view: ViewGeometry) -> bool:
        """Whether there are more strips than any scene has: noise whose pixels come in blocks, so that none flies by itself.

        The merge would take half a second of it. Blocks of 8 px give 27 to 55 strips a column, foliage at most 15."""
        return strips > self.params.max_strips_per_column * view.cols

    def _level(
        self, marks: NDArray[np.uint16], info: CameraInfo, R: Rotation, ke: float, view: ViewGeometry
    ) -> tuple[NDArray[np.uint16], ViewGeometry, tuple[NDArray[np.uint16], ViewGeometry]]:
        """Stage 0: the codes (cols, rows) of the levelled view and its geometry, pooled by the sampling interval. view: of
        `view_geometry`.

        Third: the exactly levelled view without pooling, by which free space is judged: pooled columns
        would hide what is unknown."""
        codes = self._buffer("codes", (view.cols, view.rows), np.uint16)
        level_safe(marks, info, R, view, codes, self._buffer("picked", (marks.size,), np.uint8))
        exact = codes, view
        step = self.params.column_step
        if step > 1:
            apart = math.sqrt(2.0) * self.params.column_agree_sigmas * max(ke * view.f_px, self.params.min_sigma_px)
            pooled = self._buffer("pooled", (-(-view.cols // step), view.rows), np.uint16)
            pool_columns(codes, step, int(apart * view.lsb_per_px), pooled)
            view = pooled_geometry(view, step)
            codes = pooled
        return codes, view, exact

    def _ground(
        self, marks: NDArray[np.uint16], info: CameraInfo, R: Rotation, ke: float, state: ExtractorState
    ) -> Ground:
        """The ground, before any density."""
        points = self._buffer("points", (self.params.ground_max_samples, 7), np.float32)
        return find_ground(marks, info, R, ke, state.ground_height_m, self.params, points)

    # ---- strips and clusters ------------------------------------------------------------------------------------

    def _make_strip_tables(self, cols: int) -> None:
        room = cols * self.params.max_column_strips
        self._strip_table = np.zeros(room, STRIP)
        self._first_of_column = np.zeros(cols + 1, np.int32)
        self._strip_buffers = strip_buffers(room)

    def _strips(
        self,
        codes: NDArray[np.uint16],
        view: ViewGeometry,
        source: NDArray[Any],
        ground: Ground,
        ke: float,
        settings: Settings,
    ) -> tuple[int, int, int, int]:
        """Sections 4.1-4.4 and 5.1: strips that stay, in clusters, gaps filled; strips found, ground pixels taken out, and strips
        merged for room. Writes the table of strips."""
        threshold = ground_threshold(ground, view, ke, self.params, self._buffer("threshold", (65536,), np.float32))
        if len(self._first_of_column) <= view.cols:
            self._make_strip_tables(-(-view.cols // _MORE_COLS) * _MORE_COLS)
        strips = self._strip_table
        found, ground_px, overflow = map(
            int, extract_strips(codes, threshold, view, settings.bins, settings.strips, strips)
        )
        noise_test = ground_noise_test(ground, view, ke, self.params)
        n, found = settle_strips(
            found,
            codes,
            view,
            source,
            threshold,
            noise_test,
            settings.strips,
            strips,
            self._first_of_column,
            self._strip_buffers,
        )
        return n, found, ground_px, overflow

    # ---- planes -------------------------------------------------------------------------------------------------

    def _planes(
        self,
        codes: NDArray[np.uint16],
        n: int,
        view: ViewGeometry,
        source: NDArray[Any],
        info: CameraInfo,
        settings: Settings,
    ) -> int:
        """Sections 5.2 and 5.3: the number of planes, in the buffers."""
        p, strips = self.params, self._strip_table
        if n > self._room_for_strips:
            self._room_for_strips = -(-n // _MORE_STRIPS) * _MORE_STRIPS
            self._plane_buffers = plane_buffers(self._room_for_strips, p.merge_partners)
        openings = find_openings(codes, strips, n, view, info.max_range_m, p, self._buffer)
        cell = p.evidence_cell_px
        cells = self._buffer("evidence", (-(-view.cols // cell), -(-view.rows // cell)), np.float32)
        return shape_planes(
            strips,
            n,
            self._first_of_column,
            view,
            source,
            settings.planes,
            settings.merge,
            openings,
            cells,
            self._plane_buffers,
        )

    # ---- what comes out -----------------------------------------------------------------------------------------

    def _model(
        self, told: PublishedPlanes, seen: SeenFree, ground: Ground, ke: float, n: int, planes: NDArray[Any], keep_strips: bool, pixels: tuple[int, int, int], px: int, **counted: int,
    ) -> FrameModel:  # fmt: skip
        """Section 3: planes as rectangles, layered prisms, and the free-range profile in front of them."""
        rows, margin, flags, support_px, cluster = told
        prisms = layered_prisms(rows, margin, cluster, self.params.layer_join_m, self.params.profile_join_m)
        ground = with_ranges(
            ground, self._buffer("points", (self.params.ground_max_samples, 7), np.float32), seen.edges_t
        )
        return FrameModel.written(
            valid=True, cause=InvalidCause.NONE, planes=rows, support_px=support_px, margin_m=margin, flags=flags,
            cluster=cluster, prisms=prisms, free=free_profile(seen, len(rows), planes, margin), ground=ground,
            stats=pixel_stats(
                pixels, px, **counted, clusters=len(set(cluster.tolist())), planes=len(rows), prisms=len(prisms)
            ),
            ke_per_m=ke, strips=strip_table(self._strip_table, n) if keep_strips else None,
        )  # fmt: skip


def rotation_cause(R: Rotation, params: Params) -> InvalidCause:
    """Why this rotation gives no model, NONE if it does."""
    if R.shape != (3, 3) or not is_rotation(R, 1e-3):
        return InvalidCause.BAD_ROTATION
    if abs(R[1, 2]) > 0.02 or R[0, 2] < -0.02:
        return InvalidCause.BAD_ROTATION  # level_cam's x is the optical axis' own heading
    return InvalidCause.TOO_STEEP if tilt_rad(R) > math.radians(params.max_tilt_deg) else InvalidCause.NONE
