"""What tests of the whole service share."""

from __future__ import annotations

import fcntl
from pathlib import Path

import pytest

from companion.kernels.warmup import warm_up


@pytest.fixture(scope="session")
def renders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where simulated cameras keep what they rendered; kernels are compiled before, so that starts are quick."""
    with (tmp_path_factory.getbasetemp().parent / "kernels.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # of several workers one compiles, the others then load
        warm_up()
    return tmp_path_factory.mktemp("renders")
