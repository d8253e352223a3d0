"""Packets over zenoh."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.base import BadData
from drivers.sharing.link import ReceivedPacket
from drivers.sharing.zenoh_link import ZenohLink, checked, is_authenticated, sender_of, unchecked
from tests.ports import free_port

zenoh = pytest.importorskip("zenoh", reason="the extra `share` is not installed")


def test_a_damaged_sample_is_no_packet() -> None:
    sample = checked(b"\x12packet")
    assert unchecked(sample) == b"\x12packet"
    for at in range(len(sample)):
        damaged = bytearray(sample)
        damaged[at] ^= 1
        assert unchecked(bytes(damaged)) is None
    assert unchecked(b"") is None
    assert unchecked(sample[:4]) is None


def settings(folder: Path, name: str, **more: object) -> Path:
    """A configuration without multicast, other than `more`."""
    path = folder / f"{name}.json5"
    path.write_text(json.dumps({"mode": "peer", "scouting": {"multicast": {"enabled": False}}, **more}))
    return path


def users(folder: Path, user: str, password: str) -> dict[str, object]:
    names = folder / "users.txt"
    names.write_text("one:secret\ntwo:secret\n")
    return {"auth": {"usrpwd": {"user": user, "password": password, "dictionary_file": str(names)}}}


def wait_until(done: Callable[[], object], seconds: float) -> bool:
    end_s = time.monotonic() + seconds
    while not done() and time.monotonic() < end_s:
        time.sleep(0.02)
    return bool(done())


@pytest.mark.process
@pytest.mark.parametrize(("password", "arrives"), [("secret", True), ("wrong", False)])
def test_two_vehicles_with_user_and_password(tmp_path: Path, password: str, arrives: bool) -> None:
    port = free_port()
    first = settings(
        tmp_path, "one", listen={"endpoints": [f"tcp/127.0.0.1:{port}"]}, transport=users(tmp_path, "one", "secret")
    )
    second = settings(
        tmp_path,
        "two",
        listen={"endpoints": []},
        connect={"endpoints": [f"tcp/127.0.0.1:{port}"], "exit_on_failure": False},
        transport=users(tmp_path, "two", password),
    )
    assert is_authenticated(first)
    found: list[ReceivedPacket] = []
    one = ZenohLink("blue", first, found.append)
    two = ZenohLink("blue", second, lambda packet: None)
    one.open()
    try:
        assert wait_until(lambda: not one.fault, 60.0), one.fault
        two.open()

        def sent() -> bool:
            two.send([b"\x12packet"], 2)
            return bool(found)

        assert wait_until(sent, 60.0 if arrives else 2.0) is arrives
        if arrives:
            assert (found[0].data, found[0].sender, found[0].transport) == (b"\x12packet", 2, "zenoh")
    finally:
        two.close()
        one.close()


def test_a_file_that_is_no_configuration(tmp_path: Path) -> None:
    path = tmp_path / "bad.json5"
    path.write_text("{ no")
    with pytest.raises(BadData, match=r"bad\.json5"):
        is_authenticated(path)
    assert not is_authenticated(settings(tmp_path, "open"))


@pytest.mark.parametrize(
    ("last", "sender"),
    [("7", 7), ("255", 255), ("0", None), ("256", None), ("x", None), ("", None), ("9" * 5000, None)],
)
def test_a_key_without_the_number_of_a_vehicle_has_no_sender(last: str, sender: int | None) -> None:
    """Python does not convert more than 4300 digits: that was an error in a thread of the library."""
    assert sender_of(f"osape/blue/{last}") == sender
