"""The paper's algorithm as printed, with the interface of `core.extractor.Extractor`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.extractor import usable_view
from core.frames import Rotation
from core.stages.classify import classify, depth_to_mm, pixel_limits
from core.stages.free_profile import empty_profile
from core.stages.ground import NO_GROUND
from core.stages.model import blind_model, pixel_stats
from core.stages.pooling import pool_columns
from core.stages.prisms import layered_prisms
from core.stages.view_geometry import ViewGeometry, pooled_geometry
from core.types import CameraInfo, ExtractorState, FrameModel, InvalidCause, PlaneFlags, StripTable

from .clusters import cluster_strips
from .density import bin_table_paper
from .level import level_paper, view_geometry_paper
from .params import PaperParams
from .planes import planes_paper
from .strips import settings_of, strips_paper

_NEVER = np.float32(1e9)
"""A step of disparity that no pixel has: the paper takes no flying pixel out."""


class PaperExtractor:
    """Turns depth frames into planes by the printed algorithm. Its noise is the camera's, it finds no ground, calls
    nothing free, and keeps nothing from frame to frame."""

    def __init__(self, params: PaperParams | None = None) -> None:
        self.params = params or PaperParams()

    def extract(
        self,
        depth: NDArray[np.uint16] | NDArray[np.float32],
        info: CameraInfo,
        R_level_optical: Rotation,
        state: ExtractorState | None = None,
        *,
        keep_strips: bool = False,
    ) -> tuple[FrameModel, ExtractorState]:
        """(model, next state) of one depth frame; arguments as for `Extractor.extract`."""
        p, k = self.params, info.intrinsics
        state = state or ExtractorState()
        R = np.ascontiguousarray(R_level_optical, np.float64)
        depth_mm = depth_to_mm(depth, np.empty((k.height, k.width), np.uint16))
        cause = usable_view(info, R, p)
        if isinstance(cause, InvalidCause):
            return blind_model(info, cause, p), state
        marks = np.empty(depth_mm.shape, np.uint16)
        counts = classify(depth_mm, pixel_limits(info, info.ke_per_m, p)._replace(relative=_NEVER), marks)
        if (counts[0] + counts[1]) / depth_mm.size < p.min_measured_share:
            stats = pixel_stats(counts, depth_mm.size)
            return blind_model(info, InvalidCause.NO_MEASUREMENT, p, stats), state
        codes, view = self._level(marks, info, R)
        sigma_d_px = max(info.ke_per_m * view.f_px, p.min_sigma_px)
        bins = bin_table_paper(view.f_px, view.lsb_per_px, sigma_d_px, p)
        strips = strips_paper(codes, settings_of(view, info.ke_per_m, sigma_d_px, p), bins)
        cluster_strips(strips, view, p.passable_width_m, p.passable_height_m)
        rows, support, cluster = planes_paper(strips, view, p)
        if not (np.isfinite(rows).all() and (rows[:, 4] < rows[:, 5]).all()):
            return blind_model(info, InvalidCause.NON_FINITE, p, pixel_stats(counts, depth_mm.size)), state
        margin = np.zeros(len(rows), np.float32)
        prisms = layered_prisms(rows, margin, cluster, p.layer_join_m, p.profile_join_m)
        return FrameModel(
            valid=True,
            cause=InvalidCause.NONE,
            planes=rows,
            support_px=support,
            margin_m=margin,
            flags=np.full(len(rows), int(PlaneFlags.UNKNOWN_BEHIND), np.uint8),
            cluster=cluster,
            prisms=prisms,
            free=empty_profile(p),
            ground=NO_GROUND,
            stats=pixel_stats(
                counts,
                depth_mm.size,
                strips=len(strips),
                clusters=len(set(cluster.tolist())),
                planes=len(rows),
                prisms=len(prisms),
            ),
            ke_per_m=info.ke_per_m,
            strips=_strip_table(strips) if keep_strips else None,
        ), state

    def _level(
        self, marks: NDArray[np.uint16], info: CameraInfo, R: Rotation
    ) -> tuple[NDArray[np.uint16], ViewGeometry]:
        """Quantised disparity (cols, rows) of the printed view and its geometry, pooled by the sampling interval."""
        view, step = view_geometry_paper(info, R, self.params), self.params.column_step
        codes = np.empty((view.cols, view.rows), np.uint16)
        level_paper(marks, view.H, view.lateral, view.f_px * view.lsb_per_px, codes)
        if step == 1:
            return codes, view
        pooled = np.empty((-(-view.cols // step), view.rows), np.uint16)
        pool_columns(codes, step, 0, pooled)
        return pooled, pooled_geometry(view, step)


def _strip_table(strips: NDArray[np.void]) -> StripTable:
    column = {name: strips[name].copy() for name in strips.dtype.names or ()}
    return StripTable(
        u=column["u"],
        row_top=column["top"],
        row_bottom=column["bottom"],
        x_m=column["x_m"],
        y_m=column["y_m"],
        top_m=column["top_m"],
        bottom_m=column["bottom_m"],
        support_px=column["support"],
        cluster=column["cluster"],
    )
