"""The programs of the C++ library, built once for all tests of the client."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "clients" / "cpp"
PROTO = SOURCE.parent / "python" / "osape_client" / "proto" / "osape_v1.proto"


def missing() -> str:
    tools = [tool for tool in ("c++", "cmake", "protoc", "pkg-config") if shutil.which(tool) is None]
    if tools:
        return f"missing tools: {', '.join(tools)}"
    known = subprocess.run(["pkg-config", "--exists", "libzmq", "protobuf"], check=False)
    return "" if known.returncode == 0 else "missing headers of libzmq or protobuf"


def build_state() -> str:
    """Digest of what the programs are built from and with."""
    digest = hashlib.sha256(repr([os.environ.get(name) for name in ("CXX", "CXXFLAGS", "LDFLAGS")]).encode())
    for file in sorted([PROTO, *(path for path in SOURCE.rglob("*") if path.is_file())]):
        digest.update(b"\0" + file.name.encode() + b"\0" + file.read_bytes())
    tools = (["c++", "--version"], ["protoc", "--version"], ["pkg-config", "--modversion", "libzmq", "protobuf"])
    for command in tools:
        digest.update(subprocess.run(command, capture_output=True, check=True).stdout)
    return digest.hexdigest()


@pytest.fixture(scope="module")
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Kept in the cache directory of pytest while nothing of it changes: to build it takes 20 s of processor time. CMake itself
    goes by the times of files, and by the place and the compiler of the first build."""
    if missing():
        pytest.skip(f"the C++ library cannot be built: {missing()}")
    cache = getattr(request.config, "cache", None)  # None: -p no:cacheprovider
    folder = tmp_path_factory.mktemp("cpp") if cache is None else Path(cache.mkdir("cpp-client"))
    build = folder / "build"
    with (folder / "state").open("a+") as state:
        fcntl.flock(state, fcntl.LOCK_EX)  # another run of the tests may build or use it
        state.seek(0)
        if state.read() != (now := build_state()):
            state.truncate(0)
            shutil.rmtree(build, ignore_errors=True)
            for command in (["cmake", "-S", SOURCE, "-B", build], ["cmake", "--build", build]):
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                assert done.returncode == 0, done.stdout + done.stderr
            state.write(now)
            state.flush()
        yield build / "subscriber"
