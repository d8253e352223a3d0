"""Writes the model of a frame into its message (osape.v1). The opposite direction: decode_model.py."""

from __future__ import annotations

from core.stages.prism_table import prism_table
from core.types import FrameModel, FreeProfile, Ground
from osape_client.proto import osape_v1_pb2 as pb

from .decode_model import STATS


def set_model(message: pb.PrismsFrame, model: FrameModel) -> None:
    """Fills the fields of the model. Floats are float32 on both sides, so nothing is rounded.

    Fields are set in place: a submessage passed to the constructor is encoded and decoded again."""
    _set_planes(message.planes, model)
    _add_prisms(message, model)
    _set_free(message.free, model.free)
    _set_ground(message.ground, model.ground)
    for name in STATS:
        setattr(message.stats, name, getattr(model.stats, name))
    message.ke_per_m = model.ke_per_m


def _set_planes(message: pb.Planes, model: FrameModel) -> None:
    message.corners_m.extend(model.planes.ravel().tolist())
    message.margin_m.extend(model.margin_m.tolist())
    message.support_px.extend(model.support_px.tolist())
    message.flags.extend(model.flags.tolist())
    message.cluster.extend(model.cluster.tolist())


def _add_prisms(message: pb.PrismsFrame, model: FrameModel) -> None:
    table = prism_table(model.prisms)
    vertices, planes = table.vertices_m.ravel().tolist(), table.plane.tolist()
    vertex_begin, edge_begin = table.vertex_begin.tolist(), table.edge_begin.tolist()
    rows = zip(
        table.cluster.tolist(), table.heights_m.tolist(), table.closed.tolist(), table.margin_m.tolist(), strict=True
    )
    for k, (cluster, (top_m, bottom_m), closed, margin_m) in enumerate(rows):
        message.prisms.add(
            cluster=cluster,
            top_m=top_m,
            bottom_m=bottom_m,
            closed=closed,
            margin_m=margin_m,
            vertices_m=vertices[2 * vertex_begin[k] : 2 * vertex_begin[k + 1]],
            plane=planes[edge_begin[k] : edge_begin[k + 1]],
        )


def _set_free(message: pb.FreeProfile, free: FreeProfile) -> None:
    message.azimuth_edges_rad.extend(free.azimuth_edges_rad.tolist())
    message.layer_edges_m.extend(free.layer_edges_m.tolist())
    message.free_from_m.extend(free.free_from_m.ravel().tolist())
    message.free_to_m.extend(free.free_to_m.ravel().tolist())
    message.end = free.end.tobytes()
    if free.has_open:
        message.open_from_dm = free.open_from_dm.tobytes()
        message.open_to_dm = free.open_to_dm.tobytes()


def _set_ground(message: pb.Ground, ground: Ground) -> None:
    message.seen, message.height_m, message.share = ground.seen, ground.height_m, ground.share
    message.slope_x, message.slope_y = ground.slope_x, ground.slope_y
    message.blind_beyond_m = ground.blind_beyond_m
    message.tolerance_m, message.noise_per_m = ground.tolerance_m, ground.noise_per_m
    message.seen_from_m.extend(ground.seen_from_m)
    message.seen_to_m.extend(ground.seen_to_m)
