"""`companion install` and `uninstall` in the image of a system.

The same on a running systemd is in tests/system."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

import pytest

import companion.install.install as install
import companion.install.steps as steps
from companion.cli import main
from companion.install.steps import (
    InstallError,
    InstallPaths,
    folder_size_mb,
    run_command,
    start_command,
)

CHECKOUT = Path(__file__).resolve().parents[3]
OAK = str(CHECKOUT / "configs" / "oak.toml")


def needs(*tools: str) -> pytest.MarkDecorator:
    absent = [t for t in tools if shutil.which(t) is None]
    return pytest.mark.skipif(bool(absent), reason=f"{', '.join(absent)} not there: no systemd on this machine")


@pytest.fixture
def image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The root of an image; this test's interpreter may lie anywhere."""
    monkeypatch.setattr(install, "check_reachable", lambda paths, config: None)
    (tmp_path / "image" / "etc").mkdir(parents=True)
    return tmp_path / "image"


def lines_of(capsys: pytest.CaptureFixture[str], word: str) -> list[str]:
    return [line for line in capsys.readouterr().out.splitlines() if line.startswith(word)]


# ---- into an image and out again ----------------------------------------------------------------------------------


@needs("systemctl", "systemd-sysusers")
def test_into_an_image_once_and_not_twice(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = InstallPaths(image)
    assert main(["install", "--root", str(image), "-c", OAK]) == 0
    assert len(lines_of(capsys, "done")) == 6
    assert paths.config.read_text() == Path(OAK).read_text()
    assert paths.has_user()
    assert paths.enabled.is_symlink()
    unit = paths.unit.read_text()
    assert re.search(r"^ExecStart=/\S+/companion run -c /etc/osape-companion/config.toml$", unit, re.MULTILINE)
    assert "@" not in re.sub(r"[~]?@(system-service|privileged|resources)", "", unit)
    assert main(["install", "--root", str(image)]) == 0
    assert lines_of(capsys, "done") == []


def test_an_image_without_the_software_is_named(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The unit would start a command that is not there, again and again."""
    command = Path(sysconfig.get_path("scripts")) / "companion"
    assert main(["install", "--root", str(image), "-c", OAK, "--dry-run"]) == 0
    assert f"{image} has no {command}, which the unit starts" in capsys.readouterr().err
    there = image / str(command).lstrip("/")
    there.parent.mkdir(parents=True)
    there.touch()
    assert main(["install", "--root", str(image), "-c", OAK, "--dry-run"]) == 0
    assert "which the unit starts" not in capsys.readouterr().err


@needs("systemctl", "systemd-sysusers", "userdel")
def test_out_again_but_for_what_is_the_users(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths = InstallPaths(image)
    assert main(["install", "--root", str(image), "-c", OAK]) == 0
    flight = paths.state / "logs" / "flight.mcap"
    flight.parent.mkdir(parents=True)
    flight.write_bytes(bytes(200_000))
    (paths.settings / "keys").mkdir()
    capsys.readouterr()
    assert main(["uninstall", "--root", str(image)]) == 0
    assert [line.split()[1] for line in lines_of(capsys, "kept")] == [str(paths.settings), str(paths.state), "the"]
    assert [p for p in (paths.unit, paths.enabled, paths.rules, paths.sysusers) if os.path.lexists(p)] == []
    assert flight.exists()
    assert paths.config.exists()
    assert main(["uninstall", "--root", str(image), "--purge"]) == 0
    assert any("logs, 0.2 MB" in line for line in lines_of(capsys, "done"))
    assert [p for p in (paths.state, paths.settings) if p.exists()] == []
    assert not paths.has_user()
    assert main(["uninstall", "--root", str(image), "--purge"]) == 0
    assert lines_of(capsys, "done") == []


@needs("systemctl", "systemd-sysusers")
def test_a_configuration_that_is_there_stays_unless_it_is_to_go(
    image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install", "--root", str(image), "-c", OAK]) == 0
    zed = str(CHECKOUT / "configs" / "zed.toml")
    assert main(["install", "--root", str(image), "-c", zed]) == 1
    assert "--replace-config" in capsys.readouterr().err
    assert InstallPaths(image).config.read_text() == Path(OAK).read_text()
    assert main(["install", "--root", str(image), "-c", zed, "--replace-config"]) == 0
    assert InstallPaths(image).config.read_text() == Path(zed).read_text()


@needs("systemctl", "systemd-sysusers")
def test_a_configuration_and_users_in_another_encoding(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Damaged, or written by an editor in Latin-1: it can be replaced."""
    paths = InstallPaths(image)
    paths.config.parent.mkdir(parents=True)
    paths.config.write_bytes(b"# caf\xe9\n")
    (image / "etc/passwd").write_bytes(b"jos\xe9:x:1000:1000:Jos\xe9:/:/bin/sh\n")
    assert main(["install", "--root", str(image), "-c", OAK]) == 1
    assert f"{paths.config} exists and differs from {OAK}; add --replace-config" in capsys.readouterr().err
    assert main(["install", "--root", str(image)]) == 1
    assert f"{paths.config}: 1 mistake" in capsys.readouterr().err
    assert main(["install", "--root", str(image), "-c", OAK, "--replace-config"]) == 0
    assert paths.config.read_bytes() == Path(OAK).read_bytes()


def test_a_dry_run_prints_the_plan_and_changes_nothing(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["install", "--root", str(image), "-c", OAK, "--dry-run", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["dry_run"]
    assert [s["already"] for s in printed["steps"]] == [False] * 6
    assert list((image / "etc").iterdir()) == []
    assert main(["install", "--dry-run", "-c", OAK]) == 0
    assert any("warm" in line or "compile" in line for line in lines_of(capsys, "would"))


# ---- refused -----------------------------------------------------------------------------------------


def test_refused_without_root(image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    for command in (["install", "-c", OAK], ["uninstall"]):
        assert main(command) == 1
        assert "needs root: run it with sudo" in capsys.readouterr().err


def test_refused_without_a_configuration_or_with_mistakes_in_it(
    image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install", "--root", str(image)]) == 1
    assert "give a configuration with -c" in capsys.readouterr().err
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[service]\ntimeout = 1.0\n")
    assert main(["install", "--root", str(image), "-c", str(wrong)]) == 1
    assert "did you mean timeout_s" in capsys.readouterr().err
    assert list((image / "etc").iterdir()) == []


def test_refused_for_an_image_that_is_none(tmp_path: Path, image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["install", "-c", OAK], ["uninstall"]):
        assert main([*command, "--root", str(tmp_path / "typo")]) == 1
        assert "has no etc" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["/home/pi/osape", "/root/.venv/bin/companion", "/run/user/1000/x"])
def test_refused_where_the_service_could_not_read_it(place: str) -> None:
    with pytest.raises(InstallError, match="which the service cannot read; create the environment elsewhere"):
        install.check_reachable([Path(place)])


def test_the_remedy_installs_the_configuration_that_was_given() -> None:
    """It left out -c FILE: after its commands the service had no configuration."""
    with pytest.raises(InstallError, match=r"bin/companion install -c 'my files/my.toml'$"):
        install.check_reachable([Path("/root/.venv")], Path("my files/my.toml"))
    with pytest.raises(InstallError, match=r"bin/companion install$"):
        install.check_reachable([Path("/root/.venv")])


def test_refused_below_a_folder_that_is_closed(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    (closed / "venv").mkdir(parents=True)
    closed.chmod(0o700)
    with pytest.raises(InstallError, match="cannot be read by the service's user"):
        install.check_reachable([closed / "venv"])
    with pytest.raises(InstallError, match="does not exist"):
        install.check_reachable([Path("/opt/osape-companion-is-not-there")])


def test_an_environment_made_with_a_strict_umask_is_refused_with_the_command_that_opens_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The remedy was to make the same environment again; a package that a later pip had closed was not found."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "env"))
    package = tmp_path / "env" / "lib" / "numpy"
    package.mkdir(parents=True)
    with pytest.raises(InstallError, match=f"{tmp_path} cannot be read .*create the environment elsewhere"):
        install.check_reachable([package])  # the folder of the tests, in which all is open
    (package / "__init__.py").write_text("")
    for closed, mode in ((package / "__init__.py", 0o600), (package, 0o711), (tmp_path / "env", 0o700)):
        opened = closed.stat().st_mode
        closed.chmod(mode)
        with pytest.raises(InstallError, match=f"{closed} cannot be read .*chmod -R go\\+rX {tmp_path / 'env'}$"):
            install.check_reachable([closed if closed.is_file() else package])
        closed.chmod(opened)


def test_each_installed_package_must_be_readable() -> None:
    import numpy

    assert Path(numpy.__file__).parent in steps.interpreter_paths()


@pytest.fixture
def strict_umask() -> Iterator[None]:
    """Files and folders are made for their owner only, unless a mode is given."""
    before = os.umask(0o077)
    yield
    os.umask(before)


@pytest.mark.usefixtures("strict_umask")
def test_the_service_reads_what_is_installed_with_a_strict_umask(tmp_path: Path) -> None:
    """/etc/osape-companion was made with mode 700: the unit did not start, since its user could not read its configuration."""
    (tmp_path / "etc").mkdir(mode=0o755)
    target = InstallPaths(tmp_path).config
    steps.file_step(target, "", "the configuration").act()
    assert target.stat().st_mode & 0o777 == 0o644
    assert target.parent.stat().st_mode & 0o777 == 0o755


@pytest.mark.usefixtures("strict_umask")
def test_a_configuration_written_where_the_service_reads_it_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with `sudo companion setup -o /etc/osape-companion/config.toml` after the Debian package."""
    paths = InstallPaths(tmp_path)
    paths.config.parent.mkdir(parents=True)
    monkeypatch.setattr(steps, "install_paths", lambda root: paths)
    setup = ["setup", "--yes", "--no-doctor", "--camera", "simulated", "--autopilot", "none", "--replace", "-o"]
    for command in (["configs", "simulated", "-o"], setup):
        assert main([*command, str(paths.config)]) == 0
        assert paths.config.stat().st_mode & 0o777 == 0o644
        own = tmp_path / f"{command[0]}.toml"
        assert main([*command, str(own)]) == 0
        assert own.stat().st_mode & 0o777 == 0o600


def test_a_folder_of_logs_that_the_unit_does_not_open_is_reported(
    image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "elsewhere.toml"
    config.write_text('[record]\nfolder = "/data/my flights"\n')
    assert main(["install", "--root", str(image), "-c", str(config), "--dry-run"]) == 0
    assert 'ReadWritePaths="-/data/my flights"' in capsys.readouterr().err
    config.write_text('[record]\nfolder = "logs"\n')  # below the working directory of the unit
    assert main(["install", "--root", str(image), "-c", str(config), "--dry-run"]) == 0
    assert "ReadWritePaths" not in capsys.readouterr().err


ZED = """
[[camera]]
name = "front"
kind = "zed"
device = "/dev/v4l/by-id/usb-zed"
width_px = 672
height_px = 376
fps = 15.0
calibration = "{calibration}"
"""


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (
            ZED.format(calibration="/home/pilot/SN1.conf"),
            'calibration = "/home/pilot/SN1.conf": the service cannot read',
        ),
        (
            '[autopilot]\nsigning_key = "/root/signing.key"\n',
            'signing_key = "/root/signing.key": the service cannot read',
        ),
        ('[publish]\nkeys = "/run/user/1000/keys"\n', 'keys = "/run/user/1000/keys": the service cannot read'),
    ],
)
def test_a_file_that_the_service_cannot_read_is_refused(
    text: str, cause: str, image: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Commands of the user read it; the installed service was blind, or did not start."""
    config = tmp_path / "home.toml"
    config.write_text(text)
    assert main(["install", "--root", str(image), "-c", str(config)]) == 1
    assert cause in capsys.readouterr().err
    assert main(["install", "--root", str(image), "-c", str(config), "--dry-run"]) == 1
    assert cause in "".join(lines_of(capsys, "missing"))


def test_a_file_that_is_beside_the_configuration_is_refused(tmp_path: Path) -> None:
    """The service looks for it in its own directory."""
    config = tmp_path / "beside.toml"
    config.write_text(ZED.format(calibration="SN1.conf"))
    with pytest.raises(InstallError, match=r"/var/lib/osape-companion/SN1.conf does not exist"):
        install.config_step(InstallPaths(), config, replace=True)


def test_a_link_to_a_file_that_the_service_cannot_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(install, "HIDDEN", (tmp_path / "home",))
    config, key, link = tmp_path / "link.toml", tmp_path / "home" / "signing.key", tmp_path / "signing.key"
    key.parent.mkdir()
    key.write_text("")
    link.symlink_to(key)
    config.write_text(f'[autopilot]\nsigning_key = "{link}"\n')
    with pytest.raises(InstallError, match=f"cannot read files below {key.parent}"):
        install.config_step(InstallPaths(), config, replace=True)


def test_a_command_of_the_system_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InstallError, match=r"ls /nowhere-at-all failed with status 2: .*No such file"):
        run_command(["ls", "/nowhere-at-all"])
    with pytest.raises(InstallError, match="no-such-command is not installed"):
        run_command(["no-such-command"])
    monkeypatch.setattr(steps, "COMMAND_TIMEOUT_S", 0.05)
    with pytest.raises(
        InstallError, match=r"sleep 5 did not end within 0\.05 s: .*journalctl -b.* run this command again"
    ):
        run_command(["sleep", "5"])


def test_kernels_may_take_any_time_to_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The installation ended with a traceback after an hour, and the next one began the step anew."""

    def slow(command: list[str], timeout: float | None = None, **_: object) -> subprocess.CompletedProcess[bytes]:
        if timeout is not None:
            raise subprocess.TimeoutExpired(command, timeout)
        return subprocess.CompletedProcess(command, 0)

    (tmp_path / "my.toml").write_text("")
    monkeypatch.setattr(subprocess, "run", slow)
    plan = install.install_steps(InstallPaths(), tmp_path / "my.toml", True, start=False, dry_run=True)
    next(step for step in plan if step.text.startswith("compile the kernels")).act()


def test_sizes_are_those_of_all_files_below(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "x").write_bytes(bytes(1_000_000))
    (tmp_path / "a" / "b" / "y").write_bytes(bytes(500_000))
    assert folder_size_mb(tmp_path) == 1.5


def test_a_dry_run_shows_the_whole_plan_and_what_is_missing(
    image: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(paths: object, config: object) -> None:
        raise install.InstallError("/home/me/venv is below /home")

    monkeypatch.setattr(install, "check_reachable", refuse)
    assert main(["install", "--root", str(image), "--dry-run"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("missing:")] == [
        "missing: /home/me/venv is below /home",
        f"missing: {image}/etc/osape-companion/config.toml does not exist: give a configuration with -c: `companion setup` "
        "writes one for your devices",
    ]
    assert any(line.startswith("would: write") and "osape-companion.service" in line for line in lines)
    assert main(["install", "--root", str(image)]) == 1
    assert "below /home" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["install", "uninstall"])
def test_the_package_is_left_to_apt(command: str, image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A unit in /etc would override that of the package: its next version would start the old command."""
    unit = image / "usr/lib/systemd/system/osape-companion.service"
    unit.parent.mkdir(parents=True)
    unit.write_text("")
    assert main([command, "--root", str(image)]) == 1
    error = capsys.readouterr().err
    assert f"{unit} belongs to the package osape-companion" in error
    assert "sudo apt remove osape-companion" in error
    assert not (image / "etc/systemd").exists()


def test_the_command_that_starts_the_service_fits_to_the_package(tmp_path: Path) -> None:
    paths = InstallPaths(tmp_path)
    command = shlex.split(start_command(paths, Path("my file.toml")))
    assert (command[0], command[2:]) == ("sudo", ["install", "-c", "my file.toml"])
    assert command[1] == str(Path(sys.executable).with_name("companion")), "the path of root lacks this environment"
    paths.package_unit.parent.mkdir(parents=True)
    paths.package_unit.write_text("")
    assert start_command(paths, paths.config) == "sudo systemctl enable --now osape-companion"
    assert start_command(paths, Path("my.toml")) == (
        f"sudo cp my.toml {paths.config} && sudo systemctl enable --now osape-companion"
    )
