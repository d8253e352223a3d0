"""The two distributions: everything that an installation without the checkout needs, and osape-client in an environment
that has only its three dependencies."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path

import pytest
import zmq

from companion.pipeline.encode import prisms_message
from companion.pipeline.pipeline import Pipeline
from companion.pipeline.results import PrismsResult
from companion.streams.publisher import Publisher, Stream
from osape_client.proto import osape_v1_pb2 as pb
from tests.companion.small_recordings import INFO, MS, START_NS, EasyExtractor, attitude, frame

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[2]
PARTS = {
    "osape-client": (ROOT / "clients" / "python", ("osape_client",)),
    "osape-companion": (ROOT, ("core", "drivers", "companion", "systemd", "configs", "docs")),
}
DEPENDENCIES = ("numpy", "pyzmq", "protobuf")
BUILD = "import sys; from setuptools import build_meta; build_meta.build_wheel('dist'); build_meta.build_sdist('dist')"
SUBSCRIBE = """
import importlib.util, sys
absent = "core drivers companion numba scipy cv2 mcap pydantic pymavlink".split()
assert [name for name in absent if importlib.util.find_spec(name)] == []
from osape_client import Subscriber, WorldMirror
with Subscriber(sys.argv[1]) as subscriber:
    message = subscriber.wait(60.0)
    assert message is not None, subscriber.stats
    print(message.frame, message.valid, message.stale, message.space.points([[0.5, 0, 0]]).tolist())
with WorldMirror(sys.argv[1], sys.argv[1]) as mirror:
    print(mirror.usable, mirror.space.points([[0, 0, 0]]).tolist())
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Distribution -> the folder with its wheel and its sdist, built from a copy of the sources."""
    folders = {}
    for name, (source, parts) in PARTS.items():
        copy = tmp_path_factory.mktemp(name)
        for part in parts:
            shutil.copytree(
                source / part, copy / part, ignore=shutil.ignore_patterns("__pycache__", "pictures", "research")
            )
        for file in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
            shutil.copy2(source / file, copy / file)
        for file in ("MANIFEST.in", "setup.cfg"):
            if (source / file).exists():
                shutil.copy2(source / file, copy / file)
        (copy / "tests").mkdir()
        (copy / "tests" / "test_part.py").write_text("")
        (copy / "dist").mkdir()
        done = subprocess.run([sys.executable, "-c", BUILD], cwd=copy, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        folders[name] = copy / "dist"
    return folders


@pytest.fixture(scope="module")
def interpreter(built: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of a fresh environment with the client's wheel and links to its three dependencies, without an index."""
    home = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    python = home / "bin" / "python"
    (wheel,) = built["osape-client"].glob("*.whl")
    pip = [sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check", "install", "--quiet"]
    subprocess.run([*pip, "--no-index", "--no-deps", wheel], check=True)
    site = Path(sysconfig.get_path("purelib", vars={"base": str(home), "platbase": str(home)}))
    for name in DEPENDENCIES:
        installed = distribution(name)
        assert installed.files is not None
        for top in {file.parts[0] for file in installed.files} - {"..", "__pycache__"}:
            (site / top).symlink_to(Path(str(installed.locate_file(top))).resolve())
    return python


def a_frame() -> pb.PrismsFrame:
    pipeline = Pipeline((INFO,), EasyExtractor)
    for t in range(START_NS - 40 * MS, START_NS + 1, 20 * MS):
        pipeline.handle(attitude(t))
    result = pipeline.handle(frame(1, START_NS))[1]
    assert isinstance(result, PrismsResult)
    return prisms_message(result)


@pytest.fixture
def publisher(tmp_path: Path) -> Iterator[Publisher]:
    context: zmq.Context = zmq.Context()
    publisher = Publisher(Stream("prisms", f"ipc://{tmp_path}/s"), context)
    yield publisher
    publisher.close()
    context.term()


def test_the_wheel_needs_three_distributions_and_receives_frames(interpreter: Path, publisher: Publisher) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "COV"))}
    message = a_frame()
    with subprocess.Popen(
        [interpreter, "-I", "-c", SUBSCRIBE, publisher.stream.address],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as child:
        while child.poll() is None:
            message.publication.number += 1
            message.publication.age_ns = 20 * MS
            publisher.publish(message)
            try:
                child.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        output, errors = child.communicate()
    assert child.returncode == 0, errors
    assert output.splitlines() == ["level True False [0]", "False [0]"]


def test_the_named_dependencies_are_these_three() -> None:
    project = tomllib.loads((ROOT / "clients" / "python" / "pyproject.toml").read_text())["project"]
    assert {re.split(r"[<>=]", r)[0] for r in project["dependencies"]} == set(DEPENDENCIES)


def test_all_places_name_one_version() -> None:
    projects = [tomllib.loads((source / "pyproject.toml").read_text())["project"] for source, _ in PARTS.values()]
    (version,) = {project["version"] for project in projects}
    assert f"osape-client=={version}" in projects[1]["dependencies"]
    assert f"project(osape_client VERSION {version} " in (ROOT / "clients" / "cpp" / "CMakeLists.txt").read_text()
    assert f"/osape-companion_{version}_" in (ROOT / "docs" / "how-to" / "install.md").read_text()


def held(folder: Path) -> set[str]:
    """The names of the files in the wheel in a folder."""
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        return set(packed.namelist())


def test_the_service_s_wheel_is_complete(built: dict[str, Path]) -> None:
    names, packages = held(built["osape-companion"]), ("core", "drivers", "companion")
    files = [f for part in packages for f in (ROOT / part).rglob("*") if f.is_file() and "__pycache__" not in f.parts]
    assert {str(f.relative_to(ROOT)) for f in files} - names == set()
    shared = {name.partition("/data/share/osape-companion/")[2] for name in names if "/data/" in name}
    for folder, pattern in (
        ("configs", "*.toml"),
        ("systemd", "*"),
        ("docs/how-to", "*.md"),
        ("docs/reference", "*.md"),
    ):
        assert {str(f.relative_to(ROOT)) for f in (ROOT / folder).glob(pattern)} - shared == set()
    assert any(name.endswith("LICENSE.three") for name in names)


def test_the_client_s_wheel_is_complete(built: dict[str, Path]) -> None:
    names, (source, _) = held(built["osape-client"]), PARTS["osape-client"]
    files = [f for f in (source / "osape_client").rglob("*.py*") if f.suffix != ".pyc"]
    assert {str(f.relative_to(source)) for f in files} - names == set()
    assert {"osape_client/proto/osape_v1.proto", "osape_client/py.typed"} <= names
    assert {name.partition("/")[0] for name in names if ".dist-info" not in name} == {"osape_client"}


@pytest.mark.parametrize("name", PARTS)
def test_wheel_and_sdist_contain_the_licence(built: dict[str, Path], name: str) -> None:
    (wheel,), (sdist,) = built[name].glob("*.whl"), built[name].glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as packed:
        licences = {Path(f).name: packed.read(f) for f in packed.namelist() if ".dist-info/licenses/" in f}
    assert licences["LICENSE"] == (ROOT / "LICENSE").read_bytes()
    assert b"The osape-companion authors" in licences["NOTICE"]
    with tarfile.open(sdist) as packed:
        assert {"LICENSE", "NOTICE"} <= {Path(f).name for f in packed.getnames() if f.count("/") == 1}


@pytest.mark.parametrize(
    ("name", "module"), [("osape-client", "osape_client/decode.py"), ("osape-companion", "core/codes.py")]
)
def test_a_wheel_contains_no_file_of_an_earlier_build(built: dict[str, Path], name: str, module: str) -> None:
    """An earlier version in place of a newer one, with the times of its archive: pip installed a mixture of both."""
    checkout = built[name].parent
    earlier = checkout / "build" / "lib" / module
    assert earlier.exists()
    earlier.write_text("# of another version")
    os.utime(earlier, (2**32, 2**32))
    command = "from setuptools import build_meta; build_meta.build_wheel('again')"
    (checkout / "again").mkdir()
    subprocess.run([sys.executable, "-c", command], cwd=checkout, capture_output=True, check=True)
    (wheel,) = (checkout / "again").glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        assert packed.read(module) == (checkout / module).read_bytes()


def test_the_sdist_contains_no_part_of_the_tests(built: dict[str, Path]) -> None:
    """setuptools adds tests/test_*.py, without the modules that they import."""
    (sdist,) = built["osape-companion"].glob("*.tar.gz")
    with tarfile.open(sdist) as packed:
        assert [f for f in packed.getnames() if "/tests" in f] == []


def test_the_client_has_the_licence_of_the_project() -> None:
    assert (ROOT / "clients" / "python" / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
