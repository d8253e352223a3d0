"""Open ranges of a frame: through messages, through a change of frame, and absent in older messages."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from companion.pipeline import encode
from companion.pipeline.decode_model import model_from_message
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from core.transformed import turned
from core.types import FrameModel, FreeProfile
from osape_client import decode
from osape_client.proto import osape_v1_pb2 as pb

from ..small_recordings import INFO, EasyExtractor, easy_model, flight


def with_open(model: FrameModel) -> FrameModel:
    """The model with some cells open from 0.3 m on."""
    f = model.free
    to_dm = np.arange(f.free_to_m.size, dtype=np.uint8).reshape(f.free_to_m.shape) + np.uint8(40)
    opened = FreeProfile(
        azimuth_edges_rad=f.azimuth_edges_rad,
        layer_edges_m=f.layer_edges_m,
        free_from_m=f.free_from_m,
        free_to_m=f.free_to_m,
        end=f.end,
        open_from_dm=np.full_like(to_dm, 3),
        open_to_dm=to_dm,
    )
    return dataclasses.replace(model, free=opened)


def result() -> PrismsResult:
    line = Pipeline((INFO,), EasyExtractor)
    return next(o for e in flight(3) for o in line.handle(e) if isinstance(o, PrismsResult) and o.valid)


def test_open_ranges_return_unchanged_from_a_message() -> None:
    before = result()
    assert before.model is not None
    model = with_open(before.model)
    message = encode.prisms_message(dataclasses.replace(before, model=model))
    after = model_from_message(message)
    assert after is not None
    assert after.free.has_open
    for name in ("open_from_dm", "open_to_dm", "free_from_m", "free_to_m", "end", "azimuth_edges_rad"):
        assert np.array_equal(getattr(after.free, name), getattr(model.free, name)), name
    read = decode.free_from_message(message.free)
    assert np.allclose(read.open_to_m, 0.1 * model.free.open_to_dm)


def test_a_message_without_open_ranges_presumes_nothing() -> None:
    before = result()
    assert before.model is not None
    assert not before.model.free.has_open
    message = encode.prisms_message(before)
    assert not message.free.open_to_dm
    assert not decode.free_from_message(message.free).has_open


def test_a_message_with_open_ranges_is_at_most_a_third_longer_in_its_profile() -> None:
    before = result()
    assert before.model is not None
    plain = encode.prisms_bytes(before)
    opened = encode.prisms_bytes(dataclasses.replace(before, model=with_open(before.model)))
    assert len(opened) - len(plain) <= 2 * before.model.free.free_to_m.size + 16


@pytest.mark.parametrize("name", ["open_from_dm", "open_to_dm"])
def test_open_ranges_that_do_not_fit_are_refused(name: str) -> None:
    message = encode.prisms_message(result())
    free = pb.FreeProfile.FromString(message.free.SerializeToString())
    setattr(free, name, bytes([1, 2]))
    with pytest.raises(ValueError, match="open_"):
        decode.free_from_message(free)


def test_open_ranges_keep_their_values_in_another_frame() -> None:
    model = with_open(easy_model(5.0, 2.0))
    after = turned(model, 0.7, (1.0, 2.0, -3.0))
    assert np.array_equal(after.free.open_to_dm, model.free.open_to_dm)
    assert np.array_equal(after.free.open_from_dm, model.free.open_from_dm)


def test_an_open_range_shorter_than_its_profile_is_refused() -> None:
    f = easy_model(5.0, 2.0).free
    with pytest.raises(ValueError, match="open_to_dm"):
        FreeProfile(
            azimuth_edges_rad=f.azimuth_edges_rad,
            layer_edges_m=f.layer_edges_m,
            free_from_m=f.free_from_m,
            free_to_m=f.free_to_m,
            end=f.end,
            open_from_dm=np.ones(f.end.shape, np.uint8),
            open_to_dm=np.ones((1, 1), np.uint8),
        )
