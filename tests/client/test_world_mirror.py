"""The merged world over real sockets: late subscribers, lost messages and a restarted service; outdated space is never
free."""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import zmq

from companion.config.loader import config_of
from companion.live.published_blocks import with_empty_blocks
from companion.live.world_thread import WorldThread, open_world
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause, PoseAt, Source
from companion.pipeline.transform import LevelTransform
from companion.streams.publication import PublicationStamps
from companion.streams.publisher import Publisher, Stream
from companion.streams.world_messages import snapshot_message, update_bytes, world_message
from core.world.params import WorldParams
from core.world.snapshot import WorldSnapshot
from core.world.world import Observation, World
from drivers.base import DriverError
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
from osape_client.query.space import Occupancy
from osape_client.world.decode import MOST_BLOCKS, blocks_from_message, ground_from_message, records_from_message
from osape_client.world.mirror import WorldMirror
from tests.core.worlds import NS, blind, house, seen, wall
from tests.waiting import until

pytestmark = pytest.mark.process

WALLS = np.array([wall(8.0, -4.0, 8.0, 4.0)])


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """As the service does before it takes frames; of the extractor nothing is needed here."""
    world = World()
    for k in range(2):
        world.add(seen(WALLS, (0.0, 0.0), 0.0, k))


class Speaker:
    """A world that publishes its messages on request, as the thread of the service does."""

    def __init__(self, folder: Path, boot: str = "one", params: WorldParams | None = None) -> None:
        self.context: zmq.Context = zmq.Context()
        self.addresses = f"ipc://{folder}/w", f"ipc://{folder}/r"
        changes = Publisher(Stream("world", self.addresses[0]), self.context, newest_only=False)
        requests = Publisher(Stream("world_requests", self.addresses[1]), self.context, None, zmq.REP, False)
        self.service = WorldThread(params or WorldParams(), changes, requests, PublicationStamps(boot))

    def close(self) -> None:
        self.service.close()
        self.context.destroy(linger=0)


@pytest.fixture
def speaker(tmp_path: Path) -> Iterator[Speaker]:
    speaker = Speaker(tmp_path)
    yield speaker
    speaker.close()


def now() -> int:
    return time.monotonic_ns()


def test_a_request_of_another_form_does_not_stop_the_world(speaker: Speaker) -> None:
    """A socket of REP discards it only in the call that receives it, which then waits for the next one."""
    speaker.service.open()
    with speaker.context.socket(zmq.DEALER) as other, speaker.context.socket(zmq.REQ) as client:
        other.connect(speaker.addresses[1])
        other.send(b"no delimiter")
        begun_ns = now() + NS
        assert until(lambda: speaker.service.alive_ns > begun_ns)
        client.connect(speaker.addresses[1])
        client.send(b"")
        assert client.poll(60_000)
        assert pb.WorldUpdate.FromString(client.recv()).snapshot
        other.close(0)


def test_the_world_is_as_recent_as_its_newest_frame_not_as_the_last_one_read(speaker: Speaker) -> None:
    """A second camera whose frames are read 0.6 s later."""
    newest_ns, thread = now(), speaker.service
    for t_ns in (newest_ns, newest_ns - 600_000_000):
        thread.put(result(seen(WALLS, (0.0, 0.0), 0.0, t_ns)))
    thread._take()
    message = thread._completed(snapshot_message(thread.world.picture(newest_ns), newest_ns), newest_ns)
    assert (message.valid, message.t_ns, message.counts["frames"]) == (True, newest_ns, 2)


@pytest.mark.parametrize(
    ("age_ms", "cause"),
    [
        (None, pb.WorldUpdate.CAUSE_NO_POSITION),
        (500, pb.WorldUpdate.CAUSE_NONE),
        (501, pb.WorldUpdate.CAUSE_POSITION_STALE),
    ],
)
def test_a_world_without_a_new_frame_is_invalid_and_names_the_cause(
    speaker: Speaker, age_ms: int | None, cause: pb.WorldUpdate.Cause
) -> None:
    seen_ns, thread = 7 * NS, speaker.service
    thread._newest_ns = None if age_ms is None else seen_ns
    now_ns = seen_ns + (age_ms or 0) * NS // 1000
    message = thread._completed(snapshot_message(thread.world.picture(now_ns), now_ns), now_ns)
    assert message.cause == cause
    assert message.valid == (message.cause_text == "") == (cause == pb.WorldUpdate.CAUSE_NONE)
    assert message.t_ns == (0 if age_ms is None else seen_ns)
    assert message.publication.age_ns == now_ns - seen_ns


def followed(speaker: Speaker, mirror: WorldMirror) -> bool:
    """Publishes another observation of the walls; whether the mirror can be used then."""
    look(speaker)
    return mirror.update(0.1)


def result(observation: Observation, frame: str = "ned") -> PrismsResult:
    pose = PoseAt(observation.place_m, Source.EXACT, 0, observation.reset_counter)
    return PrismsResult(
        camera="front",
        sequence=0,
        t_exposure_ns=observation.t_ns,
        t_arrival_ns=observation.t_ns,
        frame=frame,
        drop=DropCause.NONE,
        model=observation.model,
        pose=pose if frame == "ned" else None,
        transform=LevelTransform(0.0, observation.place_m),
    )


def look(
    speaker: Speaker, walls: np.ndarray = WALLS, heading: float = 0.0, frame: str = "ned", counter: int = 0
) -> None:
    observation = seen(walls, (0.0, 0.0), heading, now(), reset_counter=counter)
    speaker.service.put(result(observation, frame))


def look_blind(speaker: Speaker) -> None:
    speaker.service.put(result(blind(now())))


def same_place(mirror: WorldMirror, world: World) -> bool:
    """Whether the copy holds the same planes, to a centimetre, and the same free cells."""
    a, b = mirror.space.snapshot, world.picture(now())
    if sorted(a.slots.tolist()) != b.slots.tolist():
        return False
    order = np.argsort(a.slots)
    if not np.allclose(a.planes[order], b.planes, atol=0.011):
        return False
    return np.array_equal(a.blocks, b.blocks) and np.array_equal(a.masks, b.masks)


def test_free_space_that_the_service_no_longer_holds_is_not_free_in_the_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long flight with a full table: new blocks replace those that were not seen for the longest time."""
    monkeypatch.setattr("companion.live.world_thread.SNAPSHOT_NS", 1000 * NS)
    speaker = Speaker(tmp_path, params=WorldParams(most_free_blocks=64, jump_m=100.0))
    world, north_m = speaker.service.world, 0.0
    try:
        speaker.service.open()
        with WorldMirror(*speaker.addresses) as mirror:

            def follows() -> bool:
                walls = np.array([wall(north_m + 8.0, -4.0, north_m + 8.0, 4.0)])
                speaker.service.put(result(seen(walls, (north_m, 0.0), 0.0, now())))
                return mirror.update(0.1)

            def advance() -> None:
                nonlocal north_m
                north_m, frames = north_m + 4.0, world.numbers()["frames"]
                follows()
                assert until(lambda: world.numbers()["frames"] > frames)

            assert until(follows, 60.0), mirror.cause
            begun = mirror.space.snapshot.blocks.tolist()
            while world.numbers()["free_blocks_dropped"] < 20:
                advance()
            assert until(lambda: follows() and same_place(mirror, world), 60.0)
            assert not any(block in mirror.space.snapshot.blocks.tolist() for block in begun)
    finally:
        speaker.close()


def test_a_late_subscriber_requests_a_snapshot_and_follows(speaker: Speaker) -> None:
    speaker.service.open()
    for _ in range(5):
        look(speaker)
    with WorldMirror(*speaker.addresses) as mirror:
        assert not mirror.usable
        assert mirror.space.points([[4, 0, 0]]).tolist() == [Occupancy.UNKNOWN]

        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0), mirror.cause
        assert mirror.stats.snapshots >= 1
        assert mirror.space.points([[4, 0, 0], [8, 0, 0], [10, 0, 0]], 0.2).tolist() == [1, 2, 0]
        # what is new comes as a change
        changes = mirror.stats.messages
        side = np.concatenate([WALLS, [wall(5.0, -4.0, 5.0, -3.0)]])

        def sent_all() -> bool:
            look(speaker, side)
            mirror.update(0.05)
            return len(mirror.space.snapshot.planes) == 2

        assert until(sent_all, 60.0)
        assert mirror.stats.messages > changes
        assert mirror.stats.gaps == 0


def test_one_that_missed_messages_is_right_again(speaker: Speaker) -> None:
    speaker.service.open()
    with WorldMirror(*speaker.addresses) as mirror:
        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0)

        def found_out() -> bool:
            assert mirror._updates.take(5000) is not None  # lost; no gap where a snapshot contained it already
            for _ in range(5):
                look(speaker, house(12.0, 0.0))
                mirror.update(0.1)
            return mirror.stats.gaps > 0

        assert until(found_out, 60.0)
        assert until(follows, 60.0)
        look(speaker)
        assert until(lambda: (follows(), same_place(mirror, speaker.service.world))[1], 60.0)


@pytest.mark.parametrize("boot", ["one", "two"])
def test_a_new_service_and_a_jump_reset_the_state(boot: str, tmp_path: Path) -> None:
    """boot: of the computer, which need not restart with the service. The first service began an hour ago."""
    first = Speaker(tmp_path, "one")
    first.service._sequence = max(18_000, first.service._sequence - 3_600_000 + 18_000)
    first.service.open()
    with WorldMirror(*first.addresses) as mirror:

        def follows(speaker: Speaker, walls: np.ndarray, counter: int = 0) -> bool:
            look(speaker, walls, counter=counter)
            return mirror.update(0.1) and np.isclose(mirror.space.snapshot.planes[0, 0], walls[0, 0], atol=0.02)

        assert until(lambda: follows(first, WALLS), 60.0)
        section = mirror.section
        farther = WALLS + np.array([4.0, 0, 4.0, 0, 0, 0])
        assert until(lambda: follows(first, farther, 1), 60.0)
        assert mirror.section == section + 1
        assert len(mirror.space.snapshot.planes) == 1
        first.close()
        second = Speaker(tmp_path, boot)
        second.service.open()
        try:
            nearer = WALLS - np.array([2.0, 0, 2.0, 0, 0, 0])
            assert until(lambda: follows(second, nearer), 60.0)
            assert len(mirror.space.snapshot.planes) == 1
            assert mirror.section not in (section, section + 1)  # a path from before is void
        finally:
            second.close()


def test_what_is_old_or_has_no_position_is_not_free(speaker: Speaker) -> None:
    speaker.service.open()
    with WorldMirror(*speaker.addresses, timeout_s=0.7) as mirror:
        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0)
        assert mirror.space.points([[4, 0, 0]]).tolist() == [Occupancy.FREE]
        # frames go on, without a position
        assert until(lambda: (look(speaker, frame="level"), not mirror.update(0.05))[1], 60.0)
        assert mirror.space.points([[4, 0, 0], [8, 0, 0]], 0.2).tolist() == [Occupancy.UNKNOWN, Occupancy.OCCUPIED]
        assert until(lambda: not mirror.update(0.05) and "no valid frame with a position for" in mirror.cause, 60.0)
        assert until(follows, 60.0)
        # frames go on, and are invalid: the camera is covered
        assert until(lambda: (look_blind(speaker), not mirror.update(0.05))[1], 60.0)
        assert mirror.space.points([[4, 0, 0], [8, 0, 0]], 0.2).tolist() == [Occupancy.UNKNOWN, Occupancy.OCCUPIED]
        assert until(follows, 60.0)
        speaker.close()  # a service that ended sends nothing
        assert until(lambda: not mirror.usable, 60.0)
        assert mirror.space.points([[4, 0, 0]]).tolist() == [Occupancy.UNKNOWN]
        assert "old" in mirror.cause


def test_what_waited_while_the_planner_was_busy_is_not_fresh(speaker: Speaker) -> None:
    """Changes of a service that has ended meanwhile are not news, though they come only now."""
    speaker.service.open()
    with WorldMirror(*speaker.addresses, timeout_s=0.7) as mirror:
        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0)
        look(speaker)
        assert mirror._updates.socket.poll(60_000)
        speaker.close()
        end_ns = now() + 9 * NS // 10
        assert until(lambda: now() >= end_ns, 60.0)
        assert not mirror.update()
        assert mirror.space.points([[4, 0, 0], [8, 0, 0]], 0.2).tolist() == [Occupancy.UNKNOWN, Occupancy.OCCUPIED]


def test_a_position_that_cannot_be_one_is_refused_and_leaves_nothing_free(speaker: Speaker) -> None:
    speaker.service.open()
    with WorldMirror(*speaker.addresses) as mirror:
        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0)
        observation = seen(WALLS, (0.0, 0.0), 0.0, now())

        def broken() -> bool:
            sent_all = replace(result(observation), transform=LevelTransform(0.0, (1e30, 0.0, 0.0)))
            speaker.service.put(sent_all)
            return not mirror.update(0.05)

        assert until(broken, 60.0)
        assert speaker.service.refused > 0
        assert Occupancy.FREE not in mirror.space.points([[4, 0, 0]])
        assert until(follows, 60.0)  # the thread lives


def test_foreign_and_broken_messages_are_counted_and_leave_nothing_free(speaker: Speaker) -> None:
    speaker.service.open()
    with WorldMirror(*speaker.addresses) as mirror:
        follows = partial(followed, speaker, mirror)
        assert until(follows, 60.0)
        good = world_message(speaker.service.world.picture(now()), np.zeros(0, np.int32), now())
        good.publication.boot_id = "one"  # without it, every message is cut short
        broken = []
        for change in (
            {"planes": good.planes[:-1]},
            {"masks": good.masks[: len(good.masks) // 2]},
            {"masks": good.masks[:-4]},  # without its checksum
            {"masks": good.masks + b"\0"},
            {"valid": True, "cause": pb.WorldUpdate.CAUSE_POSITION_STALE},
            {"blocks": [1, 2]},
            {"schema_version": 7},
            {"section": 0},
            {"section": 0, "planes": b""},
            {"section": 0, "planes": b"", "blocks": [], "masks": b"", "ground": b"", "valid": True},
        ):
            message = pb.WorldUpdate.FromString(good.SerializeToString())
            message.sequence = 10**6
            for name, value in change.items():
                if name == "blocks":
                    del message.blocks[:]
                    message.blocks.extend(value)
                else:
                    setattr(message, name, value)
            broken.append(message.SerializeToString())
        for k, data in enumerate([b"\xff\xfe nonsense", *broken], start=1):
            mirror._read(data, clock_ns())
            assert mirror.stats.undecodable == k, mirror.stats.last_error
            assert not mirror.usable
            assert Occupancy.FREE not in mirror.space.points([[4, 0, 0]])
        assert until(follows, 60.0)


def test_what_comes_twice_or_too_late_changes_nothing() -> None:
    """Without sockets: the messages of a service in another order than it sent them."""
    world, sent = World(), []
    for k in range(4):
        world.add(seen(WALLS + 0.01 * k, (0.0, 0.0), 0.0, now()))
        message = world_message(world.picture(now()), np.zeros(0, np.int32), now())
        message.schema_version, message.sequence, message.snapshot, message.valid = 1, k + 1, k == 0, True
        message.t_ns, message.publication.boot_id = now(), "one"
        sent.append(message.SerializeToString())
    with WorldMirror("ipc:///nowhere/w", "ipc:///nowhere/r") as mirror:
        for data in sent[:3]:
            mirror._read(data, clock_ns())
        assert mirror.usable
        before = mirror.space.snapshot.planes.copy()
        for data in (sent[2], sent[1], sent[0]):  # an old snapshot, too, is no new beginning
            mirror._read(data, clock_ns())
            assert mirror.usable
        assert (mirror.stats.out_of_order, mirror.stats.gaps, mirror.stats.messages) == (3, 0, 3)
        assert np.array_equal(mirror.space.snapshot.planes, before)
        mirror._read(sent[3], clock_ns())
        assert mirror.usable
        assert mirror.stats.messages == 4


def made(world: World, sequence: int, boot: str, snapshot: bool) -> bytes:
    """A message of a service with this world, which has just published it."""
    message = world_message(world.picture(now()), np.zeros(0, np.int32), now())
    message.schema_version, message.sequence, message.snapshot, message.valid = 1, sequence, snapshot, True
    message.t_ns, message.publication.boot_id = now(), boot
    return message.SerializeToString()


def test_a_snapshot_of_an_earlier_boot_is_refused() -> None:
    """The answer of a service that has ended waits in the socket of requests, and the stream is that of the next boot."""
    old, new = World(), World()
    old.add(seen(WALLS, (0.0, 0.0), 0.0, now()))
    new.add(seen(WALLS + 0.5, (0.0, 0.0), 0.0, now()))
    with WorldMirror("ipc:///nowhere/w", "ipc:///nowhere/r") as mirror:
        mirror._read(made(old, 10, "one", True), clock_ns())
        assert mirror.usable
        ended_ns = clock_ns()
        mirror._read(made(new, 3, "two", False), clock_ns())
        assert not mirror.usable
        mirror._read(made(old, 11, "one", True), ended_ns)
        assert not mirror.usable
        assert Occupancy.FREE not in mirror.space.points([[4, 0, 0]])
        assert mirror.stats.out_of_order == 1
        mirror._read(made(new, 4, "two", True), clock_ns())
        assert mirror.usable
        mirror._read(made(old, 12, "one", False), ended_ns)
        assert mirror.usable, "a late message of the earlier boot ends nothing, either"
        mirror._read(made(new, 5, "two", False), clock_ns())
        assert mirror.usable
        assert mirror.stats.out_of_order == 2


def test_a_planner_that_looks_less_often_than_the_service_publishes_gets_its_snapshot(tmp_path: Path) -> None:
    """The mirror took the changes first, found the answer to its request outdated and requested another one, until the service
    sent a snapshot by itself, up to 10 s later."""
    world = World()
    world.add(seen(WALLS, (0.0, 0.0), 0.0, now()))
    stream, requests = f"ipc://{tmp_path}/w", f"ipc://{tmp_path}/r"
    with zmq.Context() as context, context.socket(zmq.XPUB) as changes, context.socket(zmq.REP) as answers:
        changes.bind(stream)
        answers.bind(requests)
        with WorldMirror(stream, requests) as mirror:
            assert changes.poll(60_000)
            assert changes.recv() == b"\x01", "it subscribed"
            assert not mirror.update()
            assert answers.poll(60_000)
            answers.recv()
            changes.send(made(world, 7, "one", False))
            answers.send(made(world, 7, "one", True))
            changes.send(made(world, 8, "one", False))
            assert mirror._request is not None
            assert mirror._request.socket.poll(60_000)
            assert mirror._updates.socket.poll(60_000)
            assert until(lambda: mirror.update() or mirror.stats.messages > 1)
            assert mirror.usable, mirror.cause
            assert mirror.stats.snapshots == 1
            assert until(lambda: mirror.update() and mirror.stats.messages == 2)
            assert mirror.stats.gaps == 0


@pytest.mark.parametrize("addresses", [("foo", "ipc:///nowhere/r"), ("ipc:///nowhere/w", "tcp://localhost")])
def test_an_address_that_cannot_be_used_is_an_error_that_names_the_remedy(addresses: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match=r"use ipc://PATH or tcp://HOST:PORT"):
        WorldMirror(*addresses)


def test_blocks_that_became_empty_are_not_kept() -> None:
    world = World()
    world.add(seen(WALLS, (0.0, 0.0), 0.0, now()))
    with WorldMirror("ipc:///nowhere/w", "ipc:///nowhere/r") as mirror:
        mirror._read(made(world, 1, "one", True), clock_ns())
        blocks = np.array(sorted(mirror._blocks), np.int32)
        assert len(blocks) > 0
        picture = with_empty_blocks(
            replace(world.picture(now()), blocks=blocks[:0], masks=np.zeros((0, 256), np.uint64), ground=None), blocks
        )
        message = pb.WorldUpdate.FromString(made(world, 2, "one", False))
        emptied = world_message(picture, np.zeros(0, np.int32), now())
        message.ClearField("blocks")
        message.blocks.extend(emptied.blocks)
        message.masks, message.ground = emptied.masks, emptied.ground
        mirror._read(message.SerializeToString(), clock_ns())
        assert mirror.usable
        assert mirror._blocks == {}


def test_a_message_cut_at_any_byte_is_no_world(speaker: Speaker) -> None:
    """The ground was written behind the publication: without it, what touches the ground was free."""
    t_ns = now()  # one for all: later the position would be stale
    speaker.service.put(result(seen(WALLS, (0.0, 0.0), 0.0, t_ns)))
    speaker.service._take()
    message = speaker.service._completed(snapshot_message(speaker.service.world.picture(t_ns), t_ns), t_ns)
    assert message.blocks
    message.ground = zlib.compress(np.full((len(message.blocks) // 3, 256, 2), 500, "<u2").tobytes(), 1)
    whole = update_bytes(message)
    assert pb.WorldUpdate.FromString(whole) == message
    with WorldMirror(*speaker.addresses, timeout_s=60.0) as mirror:
        for size in range(len(whole)):
            mirror._read(whole[:size], clock_ns())
            assert not mirror.usable
            assert not mirror._planes
            assert not mirror._blocks
        assert mirror.stats.undecodable == len(whole)
        mirror._read(whole, clock_ns())
        assert mirror.usable
        assert len(mirror._planes) == 1


def test_a_request_of_many_parts_and_a_listener_that_hangs_cost_nothing(speaker: Speaker) -> None:
    speaker.service.open()
    rude, silent_reader = speaker.context.socket(zmq.REQ), speaker.context.socket(zmq.SUB)
    rude.connect(speaker.addresses[1])
    silent_reader.setsockopt(zmq.SUBSCRIBE, b"")
    silent_reader.connect(speaker.addresses[0])
    rude.send_multipart([b"a"] * 50)
    assert rude.poll(60_000)
    assert pb.WorldUpdate.FromString(rude.recv()).snapshot
    rude.send(b"never read")
    with WorldMirror(*speaker.addresses) as mirror:
        assert until(lambda: (look(speaker), mirror.update(0.1))[1], 60.0)
    rude.close(0)
    silent_reader.close(0)


def test_frames_that_wait_too_long_are_dropped_the_oldest_first(speaker: Speaker) -> None:
    for k in range(20):
        speaker.service.put(result(seen(WALLS, (0.0, 0.0), 0.0, now() + k)))
    assert speaker.service.dropped == 12
    speaker.service.open()
    with WorldMirror(*speaker.addresses) as mirror:

        def counts() -> dict[str, int]:
            mirror.update()  # a busy computer merges the frames when they are too old for a usable world
            return {} if mirror._newest is None else dict(mirror._newest.counts)

        assert until(lambda: counts().get("frames") == 8, 60.0)
        assert counts()["frames_dropped"] == 12


def test_a_message_that_announces_more_than_any_world_is_refused() -> None:
    """Ten million blocks and their masks are 30 MB, and took 20 GB."""
    assert WorldParams(most_free_blocks=MOST_BLOCKS).most_free_blocks == MOST_BLOCKS
    with pytest.raises(ValueError, match="most_free_blocks"):
        WorldParams(most_free_blocks=MOST_BLOCKS + 1)
    message = pb.WorldUpdate(blocks=[0] * 3 * (MOST_BLOCKS + 1))
    for decode in (blocks_from_message, ground_from_message):
        with pytest.raises(ValueError, match=f"{MOST_BLOCKS + 1} blocks, expected at most {MOST_BLOCKS}"):
            decode(message)


def test_there_and_back_loses_nothing_but_millimetres() -> None:
    world = World()
    rng = np.random.default_rng(1)
    for k in range(60):
        a = math.tau * k / 60
        world.add(seen(house(0.0, 0.0), (10 * math.cos(a), 10 * math.sin(a)), a + math.pi, k * NS // 10, noise=rng))
    p = world.picture(6 * NS)
    message = world_message(p, np.array([7, 9], np.int32), 6 * NS)
    assert list(message.removed) == [7, 9]
    blocks, masks = blocks_from_message(message)
    assert np.array_equal(blocks, p.blocks)
    assert np.array_equal(masks, p.masks)
    assert len(records_from_message(message)) == len(p.planes)
    empty = world_message(WorldSnapshot.empty(), np.zeros(0, np.int32), 0)
    assert len(records_from_message(empty)) == 0
    assert len(blocks_from_message(empty)[0]) == 0


def test_where_one_address_cannot_be_had_the_other_is_given_back(tmp_path: Path) -> None:
    context: zmq.Context = zmq.Context()
    broken = config_of(
        {"publish": {"world": "ipc://{run}/w", "world_requests": "ipc://{run}/none/r"}, "record": {"record": "off"}},
        "t",
    )
    good = config_of({"publish": {"world": "ipc://{run}/w", "world_requests": "ipc://{run}/r"}}, "t")
    try:
        with pytest.raises(DriverError, match="world_requests"):
            open_world(broken, tmp_path, context, None, PublicationStamps("one"))
        service = open_world(good, tmp_path, context, None, PublicationStamps("one"))
        service.close()
    finally:
        context.destroy(linger=0)
