"""Places that cannot be written: each error names the place, the cause and the remedy, and no existing file is lost."""

from __future__ import annotations

import errno
import os
import pwd
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from companion.config.loader import Config, load_config
from companion.config.service import RecordParams
from companion.doctor import computer_check
from companion.doctor.autopilot_check import autopilot_findings
from companion.doctor.computer_check import computer_findings
from companion.kernels import jit_cache
from companion.kernels.compilation import WarmupError, cache_warning
from companion.kernels.manifest import Manifest, add_groups, write_manifest
from companion.kernels.run_kernels import GROUPS
from companion.kernels.warmup import warm_up
from companion.paths import FolderError, cache_folder, folders
from companion.whole_file import whole_file, write_whole
from osape_client.run_folder import SYSTEM_RUN, run_folder
from tests.ports import free_port

FULL_DISK = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (16, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
"""
"""Files of the process cannot grow beyond 16 bytes."""


def with_full_disk(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs code with arguments in a process of its own: the limit holds for a whole process, and in that of the tests it
    would end pytest's worker at its next write."""
    return subprocess.run(
        [sys.executable, "-B", "-c", FULL_DISK + code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )


def companion_with_full_disk(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command line of the companion."""
    return with_full_disk("from companion.cli import main\nsys.exit(main(sys.argv[1:]))", *arguments)


@pytest.fixture
def no_folder(tmp_path: Path) -> Path:
    """A path below which nothing can be made."""
    (tmp_path / "file").touch()
    return tmp_path / "file" / "home"


@pytest.mark.process
def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "a.toml"
    target.write_text("old")
    code = "from pathlib import Path; from companion.whole_file import write_whole\nwrite_whole(Path(sys.argv[1]), 'x' * 100)"
    done = with_full_disk(code, str(target))
    assert done.stderr.splitlines()[-1] == f"OSError: [Errno {errno.EFBIG}] File too large: '{target}'"
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
    write_whole(target, "new")
    assert target.read_text() == "new"


def test_a_full_disk_is_named_in_words_whatever_the_library_says(tmp_path: Path) -> None:
    """`batch --compare` printed "Error writing bytes to file. Detail: [errno 28] No space left on device"."""
    with pytest.raises(OSError, match=r"No space left on device") as caught, whole_file(tmp_path / "a.parquet"):
        raise OSError(errno.ENOSPC, "Error writing bytes to file. Detail: [errno 28] No space left on device")
    assert caught.value.strerror == "No space left on device"


def test_the_content_is_on_the_disk_before_the_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a power failure the file would be empty on file systems that write names first."""
    steps: list[str] = []
    for name in ("fsync", "replace"):
        done = getattr(os, name)

        def noted(*arguments: Any, name: str = name, done: Any = done) -> Any:
            steps.append(name)
            return done(*arguments)

        monkeypatch.setattr(os, name, noted)
    write_whole(tmp_path / "a.toml", "new", 0o600)
    assert steps == ["fsync", "replace"]
    assert (tmp_path / "a.toml").stat().st_mode & 0o777 == 0o600


@pytest.mark.process
def test_a_full_disk_keeps_the_configuration_of_before(tmp_path: Path) -> None:
    target = tmp_path / "my.toml"
    target.write_text("# mine\n")
    arguments = ["setup", "--yes", "--replace", "--no-doctor", "--camera", "simulated", "--autopilot", "none"]
    done = companion_with_full_disk(*arguments, "-o", str(target))
    assert done.returncode == 1
    assert str(target) in done.stderr
    assert target.read_text() == "# mine\n"


@pytest.mark.process
@pytest.mark.parametrize("name", ["keys", "signing.key"])
def test_a_full_disk_leaves_no_part_of_a_key(name: str, tmp_path: Path) -> None:
    """An empty key was taken for a key: the next `companion keys` kept it, and the service could not use it."""
    path = tmp_path / name
    done = companion_with_full_disk("keys", *(["--signing", str(path)] if name == "signing.key" else [str(path)]))
    assert done.returncode == 1
    assert str(path) in done.stderr
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


@pytest.mark.process
def test_a_full_disk_leaves_no_empty_copy_of_a_configuration(tmp_path: Path) -> None:
    target = tmp_path / "oak.toml"
    done = companion_with_full_disk("configs", "oak", "-o", str(target))
    assert done.returncode == 1
    assert f"{target}: File too large: its disk" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_home_that_cannot_be_written_is_named_with_the_remedy(
    no_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("HOME", str(no_folder))
    with pytest.raises(FolderError, match=f"{no_folder}.*Not a directory.*XDG_RUNTIME_DIR"):
        folders()


def test_a_user_without_a_home_is_answered_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in a container with a number for a user: a traceback."""

    def no_user(number: int) -> None:
        raise KeyError(number)

    for name in (
        "HOME",
        "XDG_RUNTIME_DIR",
        "XDG_CACHE_HOME",
        "RUNTIME_DIRECTORY",
        "STATE_DIRECTORY",
        "CACHE_DIRECTORY",
    ):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", no_user)
    with pytest.raises(FolderError, match="no home directory; set HOME, or XDG_RUNTIME_DIR and STATE_DIRECTORY"):
        folders()
    with pytest.raises(FolderError, match="no home directory; set HOME, or CACHE_DIRECTORY"):
        cache_folder()
    assert run_folder() == SYSTEM_RUN
    assert main(["status", "--timeout", "0.1"]) == 1
    assert "Traceback" not in capsys.readouterr().err
    monkeypatch.setenv("HOME", str(tmp_path))
    assert folders().state.is_relative_to(tmp_path)


@pytest.mark.parametrize("what", ["file", "link to nowhere"])
def test_the_doctor_names_a_log_directory_that_cannot_be_made(what: str, tmp_path: Path) -> None:
    """It found the place free to write."""
    place = tmp_path / "place"
    place.touch() if what == "file" else place.symlink_to("nowhere")
    for folder in (place, place / "logs"):
        config = Config(record=RecordParams(folder=str(folder)))
        finding = next(iter(computer_findings(config)))
        assert not finding.ok
        assert f"{folder} cannot be written" in finding.text


def test_a_log_directory_in_the_home_is_that(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before, it was a directory with the name ~."""
    monkeypatch.setenv("HOME", "/home/me")
    assert RecordParams(folder="~/logs").place(Path("/state")) == Path("/home/me/logs")
    assert RecordParams().place(Path("/state")) == Path("/state/logs")


def test_the_variable_that_is_in_use_is_named(no_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(no_folder))
    with pytest.raises(FolderError, match=f"{no_folder}.*variable RUNTIME_DIRECTORY"):
        folders()


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, "home/.local/state/osape-companion"),
        ({"XDG_STATE_HOME": ""}, "home/.local/state/osape-companion"),
        ({"XDG_STATE_HOME": "relative"}, "home/.local/state/osape-companion"),
        ({"XDG_STATE_HOME": "{tmp}/s"}, "s/osape-companion"),
        ({"XDG_STATE_HOME": "{tmp}/s", "STATE_DIRECTORY": "{tmp}/given"}, "given"),
    ],
)
def test_state_is_kept_where_the_user_keeps_state(
    variables: dict[str, str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """XDG_STATE_HOME was ignored. A relative path in it is invalid and to be ignored (XDG Base Directory Specification)."""
    for name in ("STATE_DIRECTORY", "XDG_STATE_HOME", "RUNTIME_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    for name, value in variables.items():
        monkeypatch.setenv(name, value.format(tmp=tmp_path))
    assert folders().state == tmp_path / expected


def test_a_state_folder_that_cannot_be_made_is_named_with_the_remedy(
    no_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(no_folder))
    with pytest.raises(FolderError, match=f"{no_folder}.*logs and state.*STATE_DIRECTORY"):
        folders()


def test_the_doctor_goes_on_without_a_writable_home(
    no_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("HOME", str(no_folder))
    (finding,) = autopilot_findings(_with_autopilot(tmp_path), 0.1)
    assert not finding.ok
    assert "XDG_RUNTIME_DIR" in finding.text


def _with_autopilot(folder: Path) -> Config:
    path = folder / "a.toml"
    path.write_text(f'[autopilot]\naddress = "udpin:127.0.0.1:{free_port()}"\n')
    return load_config(path)


@pytest.mark.process
def test_kernels_that_cannot_be_stored_do_not_prevent_a_check(no_folder: Path, tmp_path: Path) -> None:
    """Each command that imports kernels ended with a traceback of numba."""
    config = tmp_path / "a.toml"
    config.write_text("")
    done = companion_without_cache(no_folder, "check-config", str(config))
    assert (done.returncode, done.stderr) == (0, "")
    assert "a.toml: usable" in done.stdout


@pytest.mark.process
def test_without_any_writable_folder_the_remedy_is_named(no_folder: Path, tmp_path: Path) -> None:
    code = (
        f"import sys, tempfile\ntempfile.tempdir = {str(no_folder)!r}\n"
        "from companion.cli import main\nsys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "check-config", str(tmp_path / "a.toml")],
        env=os.environ | {jit_cache.VARIABLE: str(no_folder)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "set NUMBA_CACHE_DIR to a folder" in line


@pytest.mark.process
def test_warmup_names_the_place_that_cannot_be_written(no_folder: Path) -> None:
    done = companion_without_cache(no_folder, "warmup")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert f"compiled kernels cannot be stored in {no_folder}" in line
    assert "set NUMBA_CACHE_DIR" in line


def companion_without_cache(cache: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command line of the companion, with a cache that cannot be written."""
    return subprocess.run(
        [sys.executable, "-m", "companion", *arguments],
        env=os.environ | {jit_cache.VARIABLE: str(cache)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )


@pytest.mark.parametrize("unwritable", [True, False])
def test_a_read_only_cache_is_announced_where_kernels_are_missing(
    tmp_path: Path, unwritable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "kernels-0123456789abcdef"
    folder.mkdir()
    write_manifest(folder, Manifest())
    monkeypatch.setenv(jit_cache.VARIABLE, str(folder))
    monkeypatch.setattr(jit_cache, "_unwritable", [tmp_path / "cache"] if unwritable else [])
    add_groups(folder, GROUPS[:-1])
    assert cache_warning(GROUPS[:-1]) == ""
    if unwritable:
        assert f"stored in {tmp_path / 'cache'}, and those of {GROUPS[-1]} are missing" in cache_warning(GROUPS)
        with pytest.raises(WarmupError, match="NUMBA_CACHE_DIR"):
            warm_up()
    else:
        assert cache_warning(GROUPS) == ""


def test_the_doctor_names_kernels_that_cannot_be_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It compiled them for itself, which takes minutes, and found no fault: the service compiles them again."""
    folder = tmp_path / "kernels-0123456789abcdef"
    folder.mkdir()
    write_manifest(folder, Manifest())
    monkeypatch.setenv(jit_cache.VARIABLE, str(folder))
    monkeypatch.setattr(jit_cache, "_unwritable", [tmp_path / "cache"])
    monkeypatch.setattr(computer_check, "ensure_compiled", lambda *groups: 0)
    monkeypatch.setattr(computer_check, "run_kernels", lambda groups: None)
    *_, finding = computer_findings(Config())
    assert (finding.part, finding.code) == ("kernels", "kernels_not_compiled")
    assert f"cannot be stored in {tmp_path / 'cache'}" in finding.text
    assert "set NUMBA_CACHE_DIR" in finding.text


def test_a_failure_between_leaves_the_file_of_before(tmp_path: Path) -> None:
    """Whatever wrote to the temporary file."""
    target = tmp_path / "a.csv"
    target.write_text("old")

    def write() -> None:
        with whole_file(target) as part:
            part.write_text("half")
            raise ValueError("no such column")

    with pytest.raises(ValueError, match="no such column"):
        write()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]
