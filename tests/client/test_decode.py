"""The client's types of a decoded message have the fields of the algorithm's types."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import core.types
import core.world.snapshot
import osape_client
from companion.pipeline.encode_model import set_model
from osape_client import Message
from osape_client.clock import clock_ns
from osape_client.decode import model_from_message
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import PlacedModel, Space
from tests.core.worlds import house, seen

OF_THE_SERVICE_ONLY = {"cause", "stats", "ke_per_m", "strips"}
"""Fields of a FrameModel that a client reads from the message itself, or that are not published."""


@pytest.mark.parametrize(
    ("client", "service"),
    [
        (osape_client.Ground, core.types.Ground),
        (osape_client.FreeProfile, core.types.FreeProfile),
        (osape_client.Prism, core.types.Prism),
        (osape_client.CameraModel, core.types.FrameModel),
        (osape_client.WorldSnapshot, core.world.snapshot.WorldSnapshot),
    ],
)
def test_the_fields_are_those_of_the_algorithm(client: type, service: type) -> None:
    theirs = {f.name: f.type for f in fields(service) if f.name not in OF_THE_SERVICE_ONLY}
    ours = {f.name: f.type for f in fields(client)}
    assert list(ours) == list(theirs)
    assert ours == theirs


@pytest.mark.parametrize("name", ["PlaneFlags", "FreeEnd"])
def test_the_numbers_of_enums_are_those_of_the_algorithm(name: str) -> None:
    client, service = getattr(osape_client, name), getattr(core.types, name)
    assert {m.name: m.value for m in client} == {m.name: m.value for m in service}


def test_a_decoded_model_gives_the_answers_of_the_model_that_was_sent() -> None:
    model = seen(house(9.0, 0.0), (0.0, 0.0), 0.0, 0).model
    message = pb.PrismsFrame(valid=True)
    set_model(message, model)
    decoded = model_from_message(message)
    assert decoded is not None
    points = np.random.default_rng(1).uniform([-1.0, -8.0, -4.0], [14.0, 8.0, 4.0], (4000, 3))
    here = (0.0, 0.0, 0.0)
    answers = [Space([PlacedModel(m, here)]).points(points, 0.2) for m in (model, decoded)]
    assert (answers[0] == answers[1]).all()
    assert len(set(answers[0].tolist())) == 3


@pytest.mark.parametrize(
    ("name", "value"),
    [("corners_m", np.nan), ("corners_m", np.inf), ("corners_m", 1e30), ("margin_m", np.nan), ("margin_m", -1.0)],
)
def test_a_plane_that_is_not_finite_is_refused(name: str, value: float) -> None:
    """It would touch nothing: the space that it occupies would be free as far as the profile reaches. So would one with an end at
    1e30 m, of which the other end is lost in rounding."""
    message = pb.PrismsFrame(valid=True)
    set_model(message, seen(house(9.0, 0.0), (0.0, 0.0), 0.0, 0).model)
    getattr(message.planes, name)[0] = value
    with pytest.raises(ValueError, match=name):
        model_from_message(message)
    received = Message(message, clock_ns())
    assert not received.space.knows


@pytest.mark.parametrize(
    ("name", "value"), [("support_px", 2**31), ("corners_m", 5.0), ("flags", 0), ("margin_m", 0.1)]
)
def test_columns_of_planes_that_do_not_fit_are_refused(name: str, value: float) -> None:
    message = pb.PrismsFrame(valid=True, frame="level")
    set_model(message, seen(house(9.0, 0.0), (0.0, 0.0), 0.0, 0).model)
    message.transform.SetInParent()
    if name == "support_px":
        message.planes.support_px[0] = int(value)
    else:
        getattr(message.planes, name).append(value)
    with pytest.raises(ValueError, match=name):
        model_from_message(message)
    assert not Message(message, clock_ns()).space.knows


def test_flags_of_a_newer_version_are_left_out() -> None:
    message = pb.PrismsFrame(valid=True)
    set_model(message, seen(house(9.0, 0.0), (0.0, 0.0), 0.0, 0).model)
    message.planes.flags[0] = 256 + 8
    model = model_from_message(message)
    assert model is not None
    assert model.flags[0] == 8


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize("name", ["free_from_m", "free_to_m"])
def test_a_free_range_without_an_end_is_refused(name: str, value: float) -> None:
    message = pb.PrismsFrame(valid=True)
    set_model(message, seen(house(9.0, 0.0), (0.0, 0.0), 0.0, 0).model)
    getattr(message.free, name)[0] = value
    with pytest.raises(ValueError, match=name):
        model_from_message(message)


@pytest.mark.parametrize("wrong", [{"planes": np.zeros((2, 5), np.float32)}, {"hits": np.zeros(3, np.int64)}])
def test_both_snapshots_take_and_refuse_the_same_arrays(wrong: dict[str, np.ndarray]) -> None:
    for kind in (osape_client.WorldSnapshot, core.world.snapshot.WorldSnapshot):
        empty = kind.empty()
        assert not any(len(getattr(empty, f.name)) for f in fields(kind) if f.name not in ("section", "ground"))
        with pytest.raises(ValueError, match=next(iter(wrong))):
            replace(empty, **wrong)


def test_a_valid_frame_with_a_cause_is_refused() -> None:
    message = pb.PrismsFrame(valid=True, cause=pb.CAUSE_TOO_STEEP, stats=pb.FrameStats())
    with pytest.raises(ValueError, match="cause"):
        model_from_message(message)


def test_a_frame_without_a_model_has_none() -> None:
    assert model_from_message(pb.PrismsFrame(valid=False, cause=pb.CAUSE_CAMERA)) is None
