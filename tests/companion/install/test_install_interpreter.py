"""The interpreter that `companion install` names, and what its remedies say of the present installation."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

import companion.install.interpreter as interpreters


def interpreter(folder: Path, name: str, status: int = 0) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f"#!/bin/sh\nexit {status}\n")
    (folder / name).chmod(0o755)
    return folder / name


def test_the_named_interpreter_is_none_of_a_home_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment made with one of those links to it, and the next installation would be refused again."""
    own, good = tmp_path / "home" / "pyenv", tmp_path / "usr"
    monkeypatch.setattr(interpreters, "HIDDEN", (tmp_path / "home",))
    interpreter(own, "python3.13")
    interpreter(good, "python3.12", status=1)  # has no venv
    interpreter(good, "python3")
    links = tmp_path / "links"
    links.mkdir()
    (links / "python3.11").symlink_to(own / "python3.13")
    assert interpreters.system_python(f"{own}:{links}:{good}") == str(good / "python3")
    assert interpreters.system_python(f"{own}:{links}") is None
    monkeypatch.setattr(interpreters, "PLACES", str(tmp_path / "none"))
    monkeypatch.setattr(interpreters, "system_python", lambda: None)
    assert "apt install python3 python3-venv" in interpreters.remedy()


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of packages, as of an installation that is not editable, and an interpreter of the system."""
    monkeypatch.setattr(interpreters, "system_python", lambda: "/usr/bin/python3")
    monkeypatch.setattr(interpreters, "ROOT", tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def record_origins(folder: Path, **urls: str) -> None:
    """Records from where pip has installed distributions, as in PEP 610."""
    for name, url in urls.items():
        info = folder / f"{name}-0.1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0\n")
        if url:
            (info / "direct_url.json").write_text(json.dumps({"url": url}))


@pytest.mark.parametrize("editable", [True, False])
def test_the_remedy_names_the_checkout_of_an_installation(installed: Path, editable: bool) -> None:
    """It named wheels, which there were none of, where pip had copied the packages of a checkout."""
    place = installed if editable else installed / "my checkout"
    place.mkdir(exist_ok=True)
    (place / "requirements.lock").write_text("")
    record_origins(installed, osape_client=f"{place.as_uri()}/clients/python", osape_companion=place.as_uri())
    text = interpreters.remedy()
    assert "sudo /usr/bin/python3 -m venv /opt/osape-companion" in text
    assert f"-r {shlex.quote(str(place / 'requirements.lock'))} " in text
    assert f" {shlex.quote(str(place / 'clients/python'))} {shlex.quote(str(place))} " in text
    assert ".whl" not in text


def test_the_remedy_names_the_wheels_of_an_installation(installed: Path) -> None:
    wheels = [installed / f"{name}-0.1.0-py3-none-any.whl" for name in ("osape_client", "osape_companion")]
    record_origins(installed, osape_client=wheels[0].as_uri(), osape_companion=wheels[1].as_uri())
    assert "osape_companion-*.whl" in interpreters.remedy(), "the files are gone"
    for wheel in wheels:
        wheel.write_text("")
    assert f"pip install {wheels[0]} {wheels[1]} " in interpreters.remedy()


def test_the_remedy_names_no_place_where_none_is_recorded(installed: Path) -> None:
    record_origins(installed, osape_client="", osape_companion="")
    assert "osape_client-*.whl osape_companion-*.whl (the wheels of the version" in interpreters.remedy()
