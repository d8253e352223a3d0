"""Steps of an installation: each has a description, a check whether it is done, and an action."""

from __future__ import annotations

import pwd
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from drivers.shell_word import shell_word

from ..paths import NAME
from ..whole_file import write_whole

UNIT = f"{NAME}.service"
COMMAND_TIMEOUT_S = 120.0
READABLE = 0o644
"""Mode of files that the user of the service reads."""


class InstallError(ValueError):
    """A step that cannot be done: what, why and the remedy."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the installation."""

    text: str  # description
    done: bool  # nothing to do
    act: Callable[[], None]  # runs the step, raises InstallError or OSError
    missing: bool = False  # only in a dry run, what the user has to do first


@dataclass(frozen=True, slots=True)
class InstallPaths:
    """Paths of an installation below `root`: "/" for this computer, otherwise an image."""

    root: Path = Path("/")

    @property
    def live(self) -> bool:
        """Whether the root is this computer, with its running systemd."""
        return self.root == Path("/")

    @property
    def unit(self) -> Path:
        return self.root / "etc/systemd/system" / UNIT

    @property
    def package_unit(self) -> Path:
        """The unit of the Debian package, which one in `unit` would override."""
        return self.root / "usr/lib/systemd/system" / UNIT

    @property
    def enabled(self) -> Path:
        return self.root / "etc/systemd/system/multi-user.target.wants" / UNIT

    @property
    def drop_ins(self) -> Path:
        return self.root / "etc/systemd/system" / f"{UNIT}.d"

    @property
    def rules(self) -> Path:
        return self.root / "etc/udev/rules.d" / f"60-{NAME}.rules"

    @property
    def sysusers(self) -> Path:
        return self.root / "etc/sysusers.d" / f"{NAME}.conf"

    @property
    def settings(self) -> Path:
        return self.root / "etc" / NAME

    @property
    def config(self) -> Path:
        return self.settings / "config.toml"

    @property
    def cache(self) -> Path:
        return self.root / "var/cache" / NAME

    @property
    def state(self) -> Path:
        return self.root / "var/lib" / NAME

    def has_user(self) -> bool:
        """Whether the service's user exists."""
        if self.live:
            try:
                pwd.getpwnam(NAME)
            except KeyError:
                return False
            return True
        passwd = self.root / "etc/passwd"
        return passwd.exists() and any(
            line.startswith(f"{NAME}:") for line in passwd.read_text(errors="replace").splitlines()
        )


def install_paths(root: Path) -> InstallPaths:
    """The paths below a root directory. Raises InstallError for another directory."""
    if not (root / "etc").is_dir():
        raise InstallError(f"{root} is not the root directory of a system: it has no etc")
    return InstallPaths(root.resolve())


def start_command(paths: InstallPaths, config: Path) -> str:
    """The commands that start the service with a configuration, now and at each boot. The command of this environment is
    named by its place: sudo searches only directories of the system."""
    name = shell_word(config)
    if not paths.package_unit.exists():
        return f"sudo {shlex.quote(str(Path(sys.executable).with_name('companion')))} install -c {name}"
    copy = "" if config.absolute() == paths.config else f"sudo cp {name} {paths.config} && "
    return f"{copy}sudo systemctl enable --now {NAME}"


def file_step(target: Path, content: str, what: str) -> Step:
    """Writes a file where its content differs."""

    def act() -> None:
        for folder in reversed([f for f in target.parents if not f.exists()]):
            folder.mkdir()
            folder.chmod(0o755)  # whatever the umask: the user of the service reads below it
        write_whole(target, content, READABLE)

    same = target.is_file() and target.read_bytes() == content.encode()  # it may hold any bytes
    return Step(f"write {target}: {what}", same, act)


def remove_step(target: Path, what: str) -> Step:
    """Deletes a file, or a directory with its content, if it exists."""

    def act() -> None:
        if target.is_dir() and not target.is_symlink():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)

    return Step(f"delete {target}: {what}", not (target.exists() or target.is_symlink()), act)


def command_step(command: Sequence[str], what: str, done: bool = False) -> Step:
    """Runs a system command."""
    return Step(f"run {' '.join(command)}: {what}", done, lambda: run_command(command))


def run_command(command: Sequence[str]) -> None:
    """Runs a command. Raises InstallError with the last line of its output."""
    if shutil.which(command[0]) is None:
        raise InstallError(f"{command[0]} is not installed; a Linux with systemd is needed")
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=COMMAND_TIMEOUT_S)
    except subprocess.TimeoutExpired as error:
        raise InstallError(
            f"{' '.join(command)} did not end within {COMMAND_TIMEOUT_S:g} s: the computer is busy, or the command waits; look "
            "at `journalctl -b` for its cause and run this command again, which continues where it ended"
        ) from error
    if done.returncode != 0:
        text = (done.stderr.strip() or done.stdout.strip() or "no output").splitlines()[0]
        raise InstallError(f"{' '.join(command)} failed with status {done.returncode}: {text}")


def folder_size_mb(folder: Path) -> float:
    """Total size of all files below, MB."""
    return sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 1e6


def interpreter_paths() -> list[Path]:
    """Paths that the service must be able to read: the command, its interpreter, its packages."""
    command = Path(sysconfig.get_path("scripts")) / "companion"
    packages = [f for f in sorted(Path(sysconfig.get_path("purelib")).iterdir()) if f.name != "__pycache__"]
    own = Path(__file__).resolve().parents[1]
    return [command, Path(sys.executable).resolve(), Path(sys.prefix), own, *packages]


def configuration_mode(target: Path) -> int | None:
    """The mode of a configuration at this place: where the service reads it, its user must be able to; None: the usual one."""
    return READABLE if target.absolute() == install_paths(Path("/")).config else None
