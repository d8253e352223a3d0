"""What tests of the whole service share."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.kernels.run_kernels import GROUPS
from companion.kernels.warmup import ensure_compiled
from companion.viewer.live_page import LivePage
from companion.viewer.subscriber import LiveSubscriber

from .scripted_service import ScriptedService


@pytest.fixture(scope="session")
def renders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where simulated cameras of all workers keep what they rendered; kernels are compiled before, so that starts are quick."""
    ensure_compiled(*GROUPS)
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "renders"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture
def scripted(tmp_path: Path) -> Iterator[ScriptedService]:
    scripted = ScriptedService(tmp_path)
    yield scripted
    scripted.close()


@pytest.fixture
def page(scripted: ScriptedService) -> Iterator[LivePage]:
    """The live page of that service."""
    subscriber = LiveSubscriber(scripted.streams)
    subscriber.open()
    yield LivePage(subscriber, "test")
    subscriber.close()
