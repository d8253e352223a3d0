"""Where the service's user can read this software, and how to install it there."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit
from urllib.request import url2pathname

from drivers.shell_word import shell_word

from ..paths import NAME
from .steps import InstallError

HIDDEN: Final = (Path("/home"), Path("/root"), Path("/run/user"))
"""Hidden from the service by the unit's ProtectHome."""
NAMES: Final = ("python3.14", "python3.13", "python3.12", "python3.11", "python3")
PLACES: Final = "/usr/local/bin:/usr/bin:/bin"
USABLE: Final = "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))"
ROOT: Final = Path(__file__).resolve().parents[2]
HOME: Final = "/opt/osape-companion"


def check_reachable(paths: Sequence[Path], config: Path | None = None) -> None:
    """Raises InstallError where the service's user could not read this software. config: the configuration to install, for the
    remedy."""
    for place in paths:
        hidden = next((h for h in HIDDEN if place.is_relative_to(h)), None)
        if hidden is not None:
            raise InstallError(f"{place} is below {hidden}, which the service cannot read; {remedy(config)}")
        if not place.exists():
            raise InstallError(f"{place} does not exist; {remedy(config)}")
        closed = _closed(place)
        if closed is not None:
            raise InstallError(f"{closed} cannot be read by the service's user; {_opening(closed) or remedy(config)}")


def _closed(place: Path) -> Path | None:
    """A file or directory, or the first one on the way to it, that other users than its owner cannot use."""
    if place.is_file():
        needed = stat.S_IROTH
    else:
        needed = stat.S_IROTH | stat.S_IXOTH
    if place.stat().st_mode & needed != needed:
        return place
    return next((f for f in place.parents if not f.stat().st_mode & stat.S_IXOTH), None)


def _opening(closed: Path) -> str:
    """The command that opens this environment to other users; "" where the closed directory is no part of it."""
    if not closed.is_relative_to(sys.prefix):
        return ""
    return f"as after an installation with a umask of 077; open it: sudo chmod -R go+rX {shell_word(sys.prefix)}"


def system_python(places: str = PLACES) -> str | None:
    """A Python >= 3.11 that can make environments and is not below a home directory, neither itself nor what it is a link
    to: an environment made with one of those leads back there. None where there is no such."""
    for name in NAMES:
        found = shutil.which(name, path=places)
        if found is None or any(Path(found).resolve().is_relative_to(hidden) for hidden in HIDDEN):
            continue
        if subprocess.run([found, "-c", USABLE], capture_output=True, check=False).returncode == 0:
            return found
    return None


def remedy(config: Path | None = None) -> str:
    """The commands that install this software where the service can read it, and the service with this configuration."""
    python = system_python()
    first = (
        ""
        if python is not None
        else "no Python 3.11 or newer with venv was found outside of home directories: install one first (Debian, Ubuntu: sudo "
        "apt install python3 python3-venv); then "
    )
    return f"{first}create the environment elsewhere: {' && '.join(_commands(python or '/usr/bin/python3', config))}"


def _commands(python: str, config: Path | None) -> list[str]:
    given = "" if config is None else f" -c {shell_word(config)}"
    return [f"sudo {python} -m venv {HOME}", *_pip_commands(), f"sudo {HOME}/bin/companion install{given}"]


def _pip_commands() -> list[str]:
    """The commands that install what this installation was made from: a checkout, or two wheels."""
    pip = f"sudo {HOME}/bin/pip install"
    client, companion = origin("osape-client"), origin(NAME)
    checkout = next((f for f in (ROOT, companion) if f is not None and (f / "requirements.lock").is_file()), None)
    if checkout is not None:
        lock, packages = checkout / "requirements.lock", (checkout / "clients/python", checkout)
        return [
            f"{pip} --require-hashes --only-binary :all: -r {shell_word(lock)}",
            f"{pip} --no-deps --no-build-isolation {' '.join(map(shell_word, packages))}",
        ]
    if client is not None and companion is not None and client.is_file() and companion.is_file():
        return [f"{pip} {shell_word(client)} {shell_word(companion)}"]
    return [f"{pip} osape_client-*.whl osape_companion-*.whl (the wheels of the version of `companion --version`)"]


def origin(name: str) -> Path | None:
    """The directory or file that pip has installed a distribution from; None if it is not recorded, as for a package
    index, or not on this computer."""
    try:
        record = metadata.distribution(name).read_text("direct_url.json")
    except metadata.PackageNotFoundError:
        return None
    url = urlsplit(json.loads(record)["url"] if record else "")
    return Path(url2pathname(url.path)) if url.scheme == "file" else None
