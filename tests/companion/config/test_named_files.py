"""Whether a file that a configuration names is missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.config.named_files import is_missing


@pytest.mark.parametrize("name", ["absent", "n" * 5000, "a\0b", "file/below"])
def test_nothing_is_at_a_path_that_does_not_exist_or_that_no_file_can_have(name: str, tmp_path: Path) -> None:
    """A name that is too long ended check-config with an exception."""
    (tmp_path / "file").touch()
    assert is_missing(tmp_path / name)
    assert not is_missing(tmp_path / "file")


def test_what_only_root_can_look_at_may_be_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(path: Path, **options: bool) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "stat", refused)
    assert not is_missing(tmp_path / "key")
