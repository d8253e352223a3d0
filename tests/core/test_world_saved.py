"""Saved worlds: small, read back, cut anywhere without losing what was whole, moved and made one."""

from __future__ import annotations

import functools
import math
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.streams.world_messages import plane_records
from core.world.params import WorldParams
from core.world.serialize import (
    MAGIC,
    MOST_MARGIN_M,
    ON_DISK,
    SavedSection,
    box_of_records,
    bytes_of,
    fitting,
    moved,
    sections_of,
)
from core.world.world import World
from osape_client.query.space import Occupancy
from osape_client.world.decode import PLANE_RECORD
from osape_client.world.space import WorldSpace

from ..nightly import examples
from .worlds import NS, house, seen, wall

SEED = st.integers(0, 2**32 - 1)


def flown(walls: np.ndarray, frames: range, turns: float = 1.0, seed: int = 1) -> World:
    """Part of a way around the origin."""
    world, rng = World(), np.random.default_rng(seed)
    for k in frames:
        a = turns * math.tau * k / 120
        world.add(seen(walls, (10 * math.cos(a), 10 * math.sin(a)), a + math.pi, k * NS // 10, noise=rng))
    return world


@functools.cache
def saved_house() -> SavedSection:
    """Part of a house, for tests that change copies."""
    (saved,) = flown(house(0.0, 0.0), range(20)).saved()
    return saved


def test_a_plane_takes_at_most_64_bytes() -> None:
    assert ON_DISK.itemsize <= 64
    assert PLANE_RECORD.itemsize <= 64
    world = flown(house(0.0, 0.0), range(120))
    assert len(plane_records(world.picture(0), 0)) == 4 * PLANE_RECORD.itemsize
    assert len(bytes_of(world.saved())) <= 4 * 64 + 64


@examples(0.8)
@given(SEED)
def test_coordinates_come_back_to_a_centimetre_and_never_smaller_in_height(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World(WorldParams(jump_m=100.0))
    at = rng.uniform(-300, 300, 2)
    walls = np.array(
        [wall(*(at + rng.uniform(-8, 8, 2)), *(at + rng.uniform(-8, 8, 2)), -3.333, 4.444) for _ in range(5)]
    )
    for k in range(8):
        world.add(seen(walls, tuple(at), k * math.pi / 4, k))
    (saved,) = world.saved()
    ((back,), fault) = sections_of(bytes_of((saved,)))
    assert not fault
    assert np.abs(back.box - saved.box).max(initial=0.0) <= 0.0151
    assert (back.box[:, 4] <= saved.box[:, 4] + 2e-5).all()
    assert (back.box[:, 5] >= saved.box[:, 5] - 2e-5).all()
    assert (back.margin_m >= saved.margin_m - 2e-6).all()
    assert np.allclose(back.moments, saved.moments, rtol=1e-6, atol=1e-3)
    assert np.array_equal(back.hits, saved.hits)
    records = np.frombuffer(plane_records(world.picture(8), 8), PLANE_RECORD)
    assert np.allclose(box_of_records(records), back.box)


def test_cut_at_any_byte_what_was_whole_is_kept_and_the_place_is_reported() -> None:
    world = World(WorldParams(jump_m=100.0))
    for k in range(3):
        world.add(seen(house(0.0, 0.0), (10.0, 1.0), math.pi, k, reset_counter=k))
    saved = world.saved()
    assert len(saved) == 3
    data = bytes_of(saved)
    ends = [data.index(b"PLAN", data.index(b"SECT", 0) + n) for n in (0,)]
    assert ends[0] > len(MAGIC)
    planes_before = 0
    for cut in range(len(data)):
        if cut < len(MAGIC):
            with pytest.raises(ValueError, match="no saved world"):
                sections_of(data[:cut])
            continue
        sections, fault = sections_of(data[:cut])
        assert fault.startswith("byte ")
        planes = sum(len(s.box) for s in sections)
        assert planes >= planes_before
        planes_before = planes
    assert planes_before == sum(len(s.box) for s in saved)
    assert sections_of(data)[1] == ""


def test_damage_and_what_follows_the_end_are_reported() -> None:
    data = bytearray(bytes_of((saved_house(),)))
    assert "3 bytes after its end" in sections_of(bytes(data) + b"abc")[1]
    for at in range(len(MAGIC), len(data), 7):
        broken = data.copy()
        broken[at] ^= 0x40
        assert sections_of(bytes(broken))[1]


@pytest.mark.parametrize(("field", "value"), [("moments", 0.0), ("moments", math.nan), ("height_cm", 0)])
def test_a_plane_that_cannot_be_is_refused(field: str, value: float) -> None:
    """Planes with a checksum that fits, of which a comparison would divide by zero, or that no reader accepts."""
    saved = saved_house()
    data = bytes_of((saved,))
    at = data.index(b"PLAN")
    length = int.from_bytes(data[at + 4 : at + 8], "little")
    records = np.frombuffer(data[at + 12 : at + 12 + length], ON_DISK).copy()
    records[field][1] = value
    part = b"PLAN" + length.to_bytes(4, "little")
    part += zlib.crc32(b"PLAN" + records.tobytes()).to_bytes(4, "little") + records.tobytes()
    (section,), fault = sections_of(data[:at] + part + data[at + 12 + length :])
    assert fault.startswith(f"byte {at}: plane 1 of this part")
    assert len(section.box) == 0, "no plane of the part is used"
    World().load((section,))


def test_a_saved_world_goes_on_and_nothing_of_it_is_free() -> None:
    first = flown(house(0.0, 0.0), range(120))
    world = World()
    world.load(sections_of(bytes_of(first.saved()))[0])
    space = WorldSpace(world.picture(0))
    assert [p.closed for p in space.prisms] == [True]
    assert space.points([[0, 0, 0], [8, 0, 0]], 0.3).tolist() == [Occupancy.OCCUPIED, Occupancy.UNKNOWN]
    for k in range(30):
        world.add(seen(house(0.0, 0.0), (10.0, 0.01 * k), math.pi, 77 * NS + k * NS // 10, reset_counter=9))
    assert world.counts.sections == 1
    assert len(world.picture(80 * NS).planes) == 4
    assert WorldSpace(world.picture(80 * NS)).points([[8, 0, 0]], 0.3).tolist() == [Occupancy.FREE]


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_two_halves_of_a_house_from_two_frames_are_one(yaw: float) -> None:
    """The second flight's frame is turned and shifted, which is known."""
    one, two = flown(house(0.0, 0.0), range(65)), flown(house(0.0, 0.0), range(55, 125), seed=3)
    there = (40.0, -25.0, 2.0)
    (second,) = (moved(s, yaw, there) for s in two.saved())
    c, s = math.cos(-yaw), math.sin(-yaw)
    back = (-(c * there[0] - s * there[1]), -(s * there[0] + c * there[1]), -there[2])
    world = World()
    world.load((*one.saved(), moved(second, -yaw, back)))
    p = world.picture(0)
    assert len(p.planes) == 4
    assert [prism.closed for prism in WorldSpace(p).prisms] == [True]
    x = np.sort(np.abs(p.planes[:, :4].astype(float)).ravel())
    assert abs(x - 3.0).max() < 0.1


def test_a_move_that_is_no_number_is_refused() -> None:
    (saved,) = flown(house(0.0, 0.0), range(3)).saved()
    with pytest.raises(ValueError, match="not finite"):
        moved(saved, math.nan, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("field", "column", "value", "cause"),
    [
        ("box", 5, 700.0, "a height of more than 655.3 m"),
        ("box", 4, 50.0, "a lower edge above its upper edge"),
        ("box", 4, math.nan, "not finite"),
        ("box", 0, math.inf, "not finite"),
        ("box", 2, 700.0, "more than 655 m along x or y"),
        ("box", 1, -700.0, "more than 655 m along x or y"),
        ("box", slice(0, 4), 3e7, "a coordinate beyond"),
        ("margin_m", None, 65.6, "a margin outside of"),
        ("margin_m", None, -0.1, "a margin outside of"),
        ("margin_m", None, math.nan, "not finite"),
        ("moments", 3, math.nan, "moments"),
        ("moments", 0, 0.0, "moments"),
        ("moments", 5, 1e39, "moments"),
    ],
)
def test_a_plane_that_does_not_fit_is_refused_and_never_changed(
    field: str, column: int | slice | None, value: float, cause: str
) -> None:
    saved = saved_house()
    array = getattr(saved, field).copy()
    array[(1,) if column is None else (1, column)] = value
    broken = replace(saved, **{field: array})
    with pytest.raises(ValueError, match=rf"plane 1 of {len(saved.box)} does not fit in a file: .*{cause}"):
        bytes_of((broken,))
    with pytest.raises(ValueError, match=rf"plane 1 of {len(saved.box)} cannot be loaded: .*{cause}"):
        World().load((broken,))
    kept, causes = fitting(broken)
    assert list(causes) == [1]
    assert np.array_equal(kept.box, np.delete(saved.box, 1, axis=0))
    assert len(sections_of(bytes_of((kept,)))[0][0].box) == len(saved.box) - 1


@pytest.mark.parametrize("field", ["box", "margin_m"])
def test_what_just_fits_comes_back(field: str) -> None:
    saved = saved_house()
    most = getattr(saved, field).copy()
    if field == "box":
        most[0] = (-327.5, -327.5, 327.5, 327.5, -655.0, 0.3)
    else:
        most[0] = MOST_MARGIN_M
    ((back,), fault) = sections_of(bytes_of((replace(saved, **{field: most}),)))
    assert not fault
    assert np.abs(getattr(back, field) - most).max() <= 0.011


def test_an_old_plane_and_one_of_an_unknown_age_are_still_obstacles() -> None:
    saved = saved_house()
    aged = replace(saved, age_s=np.array([1e12, math.nan, *saved.age_s[2:]]), hits=np.zeros_like(saved.hits))
    ((back,), fault) = sections_of(bytes_of((aged,)))
    assert not fault
    assert len(back.box) == len(saved.box)
    assert (back.hits == 1).all()


def test_planes_that_are_seen_one_above_another_are_not_joined_beyond_what_a_message_holds() -> None:
    """A cliff that the vehicle climbs along. A message would cut it, and its foot would be missing."""
    saved = saved_house()
    edges = [(-900.0, -500.0), (-510.0, -200.0), (-210.0, 0.0)]
    box = np.array([[*saved.box[0, :4], top, bottom] for top, bottom in edges])
    first = {
        name: np.repeat(getattr(saved, name)[:1], 3, axis=0)
        for name in ("moments", "margin_m", "flags", "hits", "age_s")
    }
    cliff = replace(saved, box=box, **first)
    world = World()
    world.load((cliff, cliff))
    planes = box_of_records(np.frombuffer(plane_records(world.picture(0), 0), PLANE_RECORD))
    assert (planes[:, 5] - planes[:, 4]).max() <= 655.3
    for z in range(-900, 0, 10):
        assert ((planes[:, 4] <= z) & (planes[:, 5] >= z)).any(), f"nothing is left at {z} m"


def test_only_the_first_frame_after_loading_belongs_to_the_section_at_any_position() -> None:
    walls = np.array([wall(8.0, -4.0, 8.0, 4.0)])
    before = World()
    before.add(seen(walls, (0.0, 0.0), 0.0, 0))
    world = World()
    world.load(before.saved())
    for k, x in enumerate((0.0, 0.1, 50.0)):
        observation = seen(np.zeros((0, 6)), (x, 20.0), 0.0, (100 + k) * NS // 10)
        world.add(replace(observation, estimate=(3,)))
        assert world.counts.sections == (1 if x < 1.0 else 2)
    assert world.past[0].age_s.min() >= 0.0
