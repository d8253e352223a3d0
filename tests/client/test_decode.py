"""The client's types of a decoded message have the fields of the algorithm's types."""

from __future__ import annotations

from dataclasses import fields

import pytest

import core.types
import core.world.snapshot
import osape_client
from osape_client.decode import model_from_message
from osape_client.proto import osape_v1_pb2 as pb

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
    assert [f.name for f in fields(client)] == [f.name for f in fields(service) if f.name not in OF_THE_SERVICE_ONLY]


@pytest.mark.parametrize("name", ["PlaneFlags", "FreeEnd"])
def test_the_numbers_of_enums_are_those_of_the_algorithm(name: str) -> None:
    client, service = getattr(osape_client, name), getattr(core.types, name)
    assert {m.name: m.value for m in client} == {m.name: m.value for m in service}


def test_a_valid_frame_with_a_cause_is_refused() -> None:
    message = pb.PrismsFrame(valid=True, cause=pb.CAUSE_TOO_STEEP, stats=pb.FrameStats())
    with pytest.raises(ValueError, match="cause"):
        model_from_message(message)


def test_a_frame_without_a_model_has_none() -> None:
    assert model_from_message(pb.PrismsFrame(valid=False, cause=pb.CAUSE_CAMERA)) is None
