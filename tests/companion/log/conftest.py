"""What tests of logs share."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.log.log_writer import LogWriter
from companion.log.provenance import run_info
from companion.pipeline.pipeline import Pipeline
from drivers.logs.topics import TOPICS

from ..small_recordings import INFO, START_NS, EasyExtractor, flight


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight with prisms, long enough for several chunks."""
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    pipeline = Pipeline((INFO,), EasyExtractor)
    with LogWriter(path) as log:
        log.begin(run_info("simulated"), (INFO,), pipeline.state(), START_NS)
        for key in ("mavlink", "clock", "health"):  # of a live run only
            log.write(key, TOPICS[key].message(), START_NS)
        for event in flight(400):
            log.event(event)
            for output in pipeline.handle(event):
                log.output(output)
    return path
