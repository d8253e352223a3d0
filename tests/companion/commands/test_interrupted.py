"""Ctrl-C: status 130, a line that says what was done, and no part of a log at the place of the output."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import pytest

from companion.cli import main
from companion.kernels.warmup import ensure_compiled
from companion.log.log_writer import LogWriter
from drivers.base import Event

from ..recordings import write_folder

LOG = Path(__file__).parents[2] / "data" / "street.mcap"


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """A command that has to compile kernels prints its progress before all else."""
    ensure_compiled("extractor")


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C at the tenth event that a log is written with."""
    event, events = LogWriter.event, []

    def write(log: LogWriter, item: Event) -> None:
        events.append(item)
        if len(events) == 10:
            raise KeyboardInterrupt
        event(log, item)

    monkeypatch.setattr(LogWriter, "event", write)


@pytest.mark.usefixtures("interrupted")
@pytest.mark.parametrize("there", [False, True], ids=["new", "replaced"])
@pytest.mark.parametrize("command", ["replay", "import"])
def test_no_part_of_a_log_is_left(
    command: str, there: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It printed nothing and left OUT.mcap.active."""
    source = LOG if command == "replay" else write_folder(tmp_path / "rec")
    out = tmp_path / "out" / "out.mcap"
    out.parent.mkdir()
    if there:
        out.write_bytes(LOG.read_bytes())
    assert main([command, str(source), "-o", str(out), "--replace"]) == 130
    err = capsys.readouterr().err
    assert err.startswith("companion: error: interrupted")
    assert f"{out} was not written" in err
    assert list(out.parent.iterdir()) == [out] * there
    assert not there or out.read_bytes() == LOG.read_bytes()


def test_a_replay_without_output_says_how_far_it_came(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def replay(path: Path, options: object, on_progress: object) -> None:
        assert callable(on_progress)
        on_progress(0.25)
        raise KeyboardInterrupt

    monkeypatch.setattr("companion.replay.command.replay", replay)
    assert main(["replay", str(LOG)]) == 130
    assert capsys.readouterr().err == f"companion: error: interrupted after 25% of {LOG}\n"


_INTERRUPTED_IMPORT = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "{}":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
"""
_PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]


def ended_by_ctrl_c(
    module: str,
    folder: Path,
    *command: str,
    hook: str = _INTERRUPTED_IMPORT,
    environment: Mapping[str, str] = MappingProxyType({}),
) -> subprocess.CompletedProcess[str]:
    """Runs Python with these words and Ctrl-C at the import of a module."""
    (folder / "sitecustomize.py").write_text(hook.format(module))
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env={**os.environ, **environment, "PYTHONPATH": f"{folder}:{Path(__file__).parents[3]}"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.process
@pytest.mark.parametrize("module", ["companion.kernels.jit_cache", "companion.cli", "companion.log.provenance"])
@pytest.mark.parametrize("way", ["script", "module"])
def test_an_interrupted_start_prints_no_traceback(way: str, module: str, tmp_path: Path) -> None:
    """The first 0.3 s of a command are imports: Ctrl-C printed a traceback of them, and the status was 1."""
    name, function = _PROJECT["scripts"]["companion"].split(":")
    script = tmp_path / "bin" / "companion"
    script.parent.mkdir()
    script.write_text(f"import sys\nfrom {name} import {function}\nsys.exit({function}())\n")
    command = [str(script)] if way == "script" else ["-m", "companion"]
    ended = ended_by_ctrl_c(module, tmp_path, *command, "--version")
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


_SWALLOWED_IMPORT = """
import signal, sys
class Swallowing:
    def find_spec(self, name, path=None, target=None):
        if name == "{}":
            try:
                signal.raise_signal(signal.SIGINT)
            except BaseException:
                pass
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell lets its background jobs ignore it
sys.meta_path.insert(0, Swallowing())
"""


@pytest.mark.process
@pytest.mark.parametrize(
    "module",
    [
        "companion.kernels.jit_cache",
        "companion.cli",
        "companion.config.loader",
        "companion.kernels.loading",
        "companion.live.service",
    ],
)
def test_ctrl_c_within_an_import_that_catches_everything_ends_the_start(module: str, tmp_path: Path) -> None:
    """One of 40 interrupted starts of the service ran on: the KeyboardInterrupt was raised within an import and lost."""
    environment = failing_start(tmp_path)
    command = ["-m", "companion", "run", "-c", "live.toml"]
    ended = ended_by_ctrl_c(module, tmp_path, *command, hook=_SWALLOWED_IMPORT, environment=environment)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")


def failing_start(folder: Path) -> dict[str, str]:
    """Writes live.toml. Returns an environment in which a start of the service that goes on fails after the imports."""
    (folder / "live.toml").write_text('[[camera]]\nname = "front"\nkind = "simulated"\n')
    (folder / "file").write_text("")
    return {"RUNTIME_DIRECTORY": str(folder / "file"), "STATE_DIRECTORY": str(folder / "file")}


@pytest.mark.process
def test_a_program_that_starts_the_service_is_not_ended_at_once(tmp_path: Path) -> None:
    """It ended with status 130, with nothing of what it does at its end."""
    content = "from companion.cli import main\nprint(main(['run', '-c', 'live.toml']))\n"
    environment = failing_start(tmp_path)
    ended = ended_by_ctrl_c(
        "companion.live.service", tmp_path, "-c", content, hook=_SWALLOWED_IMPORT, environment=environment
    )
    assert (ended.returncode, ended.stdout) == (0, "1\n")


@pytest.mark.process
@pytest.mark.parametrize("way", ["text", "script", "module", "package"])
def test_a_program_that_imports_the_package_gets_its_own_interrupt(way: str, tmp_path: Path) -> None:
    """It got SystemExit, which `except KeyboardInterrupt` does not catch and which ends it without a word."""
    content = "try:\n    import companion\nexcept KeyboardInterrupt:\n    print('mine')\n"
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "__init__.py").write_text(content)
    (tmp_path / "planner" / "__main__.py").write_text("")
    (tmp_path / "program.py").write_text(content)
    command = {
        "text": ["-c", content],
        "script": ["program.py"],
        "module": ["-m", "program"],
        "package": ["-m", "planner"],
    }[way]
    ended = ended_by_ctrl_c("companion.kernels.jit_cache", tmp_path, *command)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "mine\n", "")


@pytest.mark.process
def test_a_batch_ends_at_once_and_prints_one_line(tmp_path: Path) -> None:
    """Workers printed tracebacks and were started again: it ended after its running flights, an hour for long ones."""
    pytest.importorskip("pyarrow")
    for k in range(3):
        (tmp_path / "v").mkdir(exist_ok=True)
        (tmp_path / "v" / f"flight{k}.mcap").write_bytes(LOG.read_bytes())
    code = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell lets its background jobs ignore it
from companion.batch import task
from companion.cli import main
from tests.companion.batch_processes import endless
task.run_task = endless
sys.exit(main(sys.argv[1:]))
"""
    process = subprocess.Popen(
        [sys.executable, "-c", code, "batch", str(tmp_path / "v"), "-o", str(tmp_path / "out"), "--workers", "1"],
        cwd=Path(__file__).parents[3],
        start_new_session=True,
        stderr=subprocess.PIPE,
        text=True,
    )
    while process.poll() is None and not list((tmp_path / "out").glob("flight*")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all its processes
    try:
        _, err = process.communicate(timeout=60.0)
    finally:
        process.kill()
    assert process.returncode == 130
    assert not list((tmp_path / "out").glob("copies-*"))
    assert err == "companion: error: interrupted: processed 0 of 3 flights; the same command continues\n"
