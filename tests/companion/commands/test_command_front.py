"""The help, wrong use and version of the command."""

from __future__ import annotations

import pytest

from companion.cli import main


def test_help_names_all_commands(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(
        name in text for name in ("demo", "import", "replay", "view", "info", "recover", "check-config", "warmup")
    )


@pytest.mark.parametrize("arguments", [[], ["fly"], ["replay"], ["info"], ["replay", "a", "--tolerance", "7"]])
def test_wrong_use_is_status_2(arguments, capsys):
    assert main(arguments) == 2
    assert "error" in capsys.readouterr().err


def test_the_version_is_reported(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("osape-companion ")
