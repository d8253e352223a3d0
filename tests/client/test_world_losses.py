"""A copy of a random world whose messages are lost, damaged, repeated and out of order: it holds no free cell that the world does
not hold, and lacks no plane."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from google.protobuf.message import Message

from companion.live.world_thread import WorldThread
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher
from companion.streams.world_messages import snapshot_message, update_bytes
from core.world.params import WorldParams
from core.world.snapshot import WorldSnapshot
from osape_client.clock import clock_ns
from osape_client.world.mirror import WorldMirror
from tests.core.test_world_frames import random_frame
from tests.core.worlds import NS

pytestmark = pytest.mark.process


class Sent(NamedTuple):
    data: bytes
    picture: WorldSnapshot


class Kept(Publisher):
    """A publisher without a socket."""

    def __init__(self) -> None:
        self.sent, self.published = [b""], 0

    def publish(self, message: Message | bytes) -> None:
        assert isinstance(message, bytes)
        self.sent, self.published = [message], self.published + 1

    def close(self) -> None:
        pass


class Service(WorldThread):
    """A world of small tables, as its thread publishes it."""

    def __init__(self, jump_m: float) -> None:
        self.kept = Kept()
        params = WorldParams(jump_m=jump_m, free_age_s=4.0, most_free_blocks=64, most_planes=64)
        super().__init__(params, self.kept, Kept(), PublicationStamps("one"))

    def change(self, now_ns: int) -> Sent:
        self._publish_changes(now_ns)
        return Sent(self.kept.sent[0], self.world.picture(now_ns))

    def answer(self, now_ns: int) -> Sent:
        picture = self.world.picture(now_ns)
        self._blocks.add(picture)
        message = self._completed(snapshot_message(picture, now_ns), now_ns)
        return Sent(update_bytes(message), picture)


def delivered(rng: np.random.Generator, sent: list[Sent], waiting: list[Sent]) -> list[Sent]:
    """What arrives now: some messages are lost, damaged, or arrive later, once more or in another order."""
    found = []
    for message in sent:
        fate = rng.choice(["arrives", "lost", "damaged", "late", "twice"], p=[0.77, 0.05, 0.06, 0.07, 0.05])
        if fate in ("late", "twice"):
            waiting.append(message)
        if fate == "damaged":
            found.append(message._replace(data=message.data[: int(rng.integers(len(message.data)))]))
        elif fate in ("arrives", "twice"):
            found.append(message)
        if waiting and rng.random() < 0.3:
            found.insert(0, waiting.pop(int(rng.integers(len(waiting)))))
    return found


def masks_of(picture: WorldSnapshot) -> dict[tuple[int, ...], np.ndarray]:
    return dict(zip(map(tuple, picture.blocks.tolist()), picture.masks, strict=True))


@pytest.mark.parametrize("seed", range(4))
def test_a_copy_holds_no_more_free_space_than_the_world(tmp_path: Path, seed: int) -> None:
    rng, compared, now_ns = np.random.default_rng(seed), 0, 10 * NS
    waiting = list[Sent]()
    service = Service(float(rng.choice([1.0, 100.0])))
    with WorldMirror(f"ipc://{tmp_path}/w", f"ipc://{tmp_path}/r") as mirror:
        for _ in range(100):
            now_ns += round(rng.choice([0.03, 0.1, 0.3, 1.0], p=[0.4, 0.4, 0.15, 0.05]) * NS)
            frame = random_frame(rng, now_ns - round(rng.uniform(0.0, 0.9) * NS * (rng.random() < 0.2)))
            x, y, z = frame.place_m
            # so far apart that blocks replace each other
            service.world.add(replace(frame, place_m=(x + 30.0 * rng.integers(4), y, z)))
            assert service.world.section is not None
            service._newest_ns = service.world.section.newest_ns
            sent = [service.change(now_ns)] if rng.random() < 0.7 else []
            sent += [service.answer(now_ns)] if not mirror.complete and rng.random() < 0.5 else []
            for message in delivered(rng, sent, waiting):
                before = mirror.stats.messages
                mirror._read(message.data, clock_ns())
                if mirror.stats.messages == before or not mirror.complete:
                    continue
                copy, held = mirror._snapshot(), masks_of(message.picture)
                compared += 1
                nothing = np.zeros(256, np.uint64)
                assert not any((free & ~held.get(block, nothing)).any() for block, free in masks_of(copy).items())
                assert set(message.picture.slots.tolist()) <= set(copy.slots.tolist())
    assert compared > 20
    assert mirror.stats.gaps > 0
    assert mirror.stats.out_of_order > 0
    assert mirror.stats.undecodable > 0
