"""A client in a time namespace, as of a container: its clock is not that of a service outside."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from osape_client import boot
from osape_client.boot import boot_id

from .test_cpp_subscriber import compiled

pytestmark = pytest.mark.process
INSIDE = ("unshare", "-T", "--boottime", "-1")
"""The clock is a second behind."""
IS_STALE = """
import sys
from osape_client import Message
from osape_client.clock import clock_ns
from osape_client.proto import osape_v1_pb2 as pb
MS = 1_000_000
waited = pb.PrismsFrame(schema_version=1, valid=True, t_exposure_ns=clock_ns() + (1000 - 1200) * MS)
waited.publication.CopyFrom(pb.Publication(boot_id=sys.argv[1], suspended_ns=0))
print(Message(waited, clock_ns() - 1200 * MS).stale)
"""
"""Of a message that has waited in the socket for 1.2 s since it was sent outside."""
IS_STALE_CPP = """
#include <iostream>
#include "osape_client/subscriber.h"
int main(int, char** argv) {
  using namespace std::chrono_literals;
  osape_client::Message waited;
  const auto now = osape_client::Clock::now();
  waited.content.set_t_exposure_ns((now + 1000ms - 1200ms).time_since_epoch().count());
  waited.content.mutable_publication()->set_boot_id(argv[1]);
  waited.content.mutable_publication()->set_suspended_ns(0);
  waited.received = now - 1200ms;
  std::cout << (waited.stale() ? "True" : "False");
}
"""


def inside(command: Sequence[str | Path]) -> str:
    return subprocess.run([*INSIDE, *command], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(autouse=True)
def namespaces() -> None:
    if subprocess.run([*INSIDE, "true"], capture_output=True, check=False).returncode != 0:
        pytest.skip("no time namespace can be made here")


def test_a_message_that_waited_in_the_socket_is_stale_there_too() -> None:
    assert inside([sys.executable, "-c", IS_STALE, boot_id()]) == "True"


def test_it_is_stale_in_the_library_for_cpp_too(program: Path, tmp_path: Path) -> None:
    assert inside([compiled(program, tmp_path, IS_STALE_CPP), boot_id()]) == "True"


def test_two_programs_of_one_namespace_have_one_clock() -> None:
    print_twice = "from osape_client.boot import boot_id; print(boot_id())"
    both = inside(["sh", "-c", f"'{sys.executable}' -c '{print_twice}'; '{sys.executable}' -c '{print_twice}'"])
    one, other = both.split()
    assert one == other != boot_id()


def test_the_clocks_of_an_older_kernel_are_no_offsets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Linux 5.6 names them by their numbers. The library for C++ leaves the names out too."""
    expected = boot_id()
    monkeypatch.setattr(boot, "OFFSETS_FILE", tmp_path / "offsets")
    boot.OFFSETS_FILE.write_text("1 0 0\n7 0 0\n")
    assert boot_id.__wrapped__() == expected
    boot.OFFSETS_FILE.write_text("1 0 0\n7 -1 0\n")
    assert boot_id.__wrapped__() == f"{expected}+0.0.-1.0"
