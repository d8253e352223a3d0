"""The ground through messages: a planner's process answers as the service's, for one camera and for all as one."""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.pipeline.encode import prisms_message
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause
from companion.pipeline.transform import LevelTransform, transform_model
from core.types import FrameModel
from drivers.simulation.scenes import SceneBuilder
from osape_client import Message
from osape_client.decode import free_from_message, ground_from_message
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy, PlacedModel, Space
from tests.client.test_solid_ground import ahead, model_of, street


def result(camera: str, model: FrameModel, transform: LevelTransform) -> PrismsResult:
    return PrismsResult(
        camera=camera,
        sequence=1,
        t_exposure_ns=10,
        t_arrival_ns=11,
        frame="level",
        drop=DropCause.NONE,
        model=transform_model(model, transform),
        transform=transform,
    )


def space_of(*results: PrismsResult) -> Space:
    """What a planner asks who heard these cameras as one model."""
    cameras = [pb.PrismsFrame.FromString(prisms_message(r).SerializeToString()) for r in results]
    return Message(pb.SurroundFrame(schema_version=1, frame="level", valid=True, cameras=cameras), 0, math.inf).space


def moved(p: NDArray[np.float64], transform: LevelTransform) -> NDArray[np.float64]:
    c, s = math.cos(transform.yaw_rad), math.sin(transform.yaw_rad)
    return np.column_stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]]) + transform.translation_m


def test_a_planner_answers_as_the_service_below_the_ground() -> None:
    model, transform = model_of(street(slope_x=0.03, slope_y=-0.02)), LevelTransform(0.5, (0.2, -0.1, 0.05))
    sent = result("front", model, transform)
    assert sent.model is not None
    read = prisms_message(sent)
    assert asdict(ground_from_message(read.ground)) == asdict(sent.model.ground)
    p = moved(np.concatenate([ahead(z) for z in (0.5, 1.5, 2.1, 2.4, 2.95)]), transform)
    answers = space_of(sent).points(p, 0.1)
    assert np.array_equal(answers, Space([PlacedModel(sent.model, transform.translation_m)]).points(p, 0.1))
    below = p[:, 2] > 2.85
    assert Occupancy.FREE not in answers[below]
    assert Occupancy.OCCUPIED in answers[below]


def test_no_camera_frees_what_is_below_the_ground_of_another() -> None:
    blank = SceneBuilder("nothing")
    blank.box("far", 40.0, 0.0, 1.0, 1.0, 1.0)
    unaware = result("other", model_of(blank, pitch_rad=0.0), LevelTransform(0.1, (0.0, 0.3, 0.0)))
    aware = result("front", model_of(street()), LevelTransform(0.0, (0.3, 0.0, 0.1)))
    p = np.array([[11.0, y, z] for y in (-0.5, 0.0, 0.5) for z in (2.3, 2.6, 2.9)])
    assert set(space_of(unaware).points(p).tolist()) == {Occupancy.FREE}
    assert set(space_of(unaware, aware).points(p).tolist()) == {Occupancy.OCCUPIED}
    assert set(space_of(aware, unaware).points(p).tolist()) == {Occupancy.OCCUPIED}


def test_ground_of_an_older_version_frees_nothing_below_it() -> None:
    sent = result("front", model_of(street()), LevelTransform(0.0, (0.0, 0.0, 0.0)))
    message = prisms_message(sent)
    for name in ("tolerance_m", "noise_per_m", "seen_from_m", "seen_to_m"):
        message.ground.ClearField(name)
    space = Message(message, 0, math.inf).space
    for z in (1.5, 2.1, 2.4, 2.95):
        assert Occupancy.FREE not in space.points(ahead(z))
    assert space.points([[5.0, 0.0, 1.3]]).tolist() == [Occupancy.FREE]


def seen_from_front() -> pb.PrismsFrame:
    return prisms_message(result("front", model_of(street()), LevelTransform(0.0, (0.0, 0.0, 0.0))))


@pytest.mark.parametrize("name", ["height_m", "slope_x", "slope_y", "tolerance_m", "noise_per_m"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_ground_of_numbers_that_are_none_is_refused(name: str, bad: float) -> None:
    message = seen_from_front()
    setattr(message.ground, name, bad)
    with pytest.raises(ValueError, match="ground"):
        ground_from_message(message.ground)
    assert set(Message(message, 0, math.inf).space.points(ahead(1.0)).tolist()) == {Occupancy.UNKNOWN}


@pytest.mark.parametrize("name", ["tolerance_m", "noise_per_m"])
def test_a_ground_whose_margin_is_negative_is_refused(name: str) -> None:
    """A negative margin would make free what lies below the ground."""
    message = seen_from_front()
    setattr(message.ground, name, -5.0)
    with pytest.raises(ValueError, match=name):
        ground_from_message(message.ground)


def test_ranges_that_are_no_numbers_or_do_not_fit_the_profile_free_nothing_below_the_ground() -> None:
    message = seen_from_front()
    del message.ground.seen_to_m[-1]
    assert Occupancy.FREE not in Message(message, 0, math.inf).space.points(ahead(2.1))
    message.ground.seen_from_m[0] = math.nan
    with pytest.raises(ValueError, match="seen_from_m"):
        ground_from_message(message.ground)


@pytest.mark.parametrize("name", ["azimuth_edges_rad", "layer_edges_m"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -1e3])
def test_a_profile_whose_edges_do_not_rise_is_refused(name: str, bad: float) -> None:
    message = seen_from_front()
    getattr(message.free, name)[-1] = bad
    with pytest.raises(ValueError, match=name):
        free_from_message(message.free)
    assert set(Message(message, 0, math.inf).space.points(ahead(1.0)).tolist()) == {Occupancy.UNKNOWN}
