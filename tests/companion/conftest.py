"""What tests of the whole service share."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.warmup import warm_up


@pytest.fixture(scope="session")
def renders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where simulated cameras keep what they rendered; kernels are compiled before, so that starts are quick."""
    warm_up()
    return tmp_path_factory.mktemp("renders")
