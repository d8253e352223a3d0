"""What the live service is held to: figures that are within their bounds, and each that is not."""

from __future__ import annotations

import time
import tomllib
from argparse import Namespace
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.speed.live import config_text, shipped, stolen_s
from benchmarks.speed.service import live_lines, start_lines
from companion.config.loader import config_of
from companion.demo.demo import EMBEDDED

FOUND: dict[str, Any] = {
    "flight": "street",
    "hz": 30.0,
    "minutes": 10.0,
    "frames": 18000,
    "dropped_by_the_service": {},
    "log_dropped": 0,
    "samples_lost": 0,
    "exposure_to_subscriber_ms": {"p50": 5.0, "p99": 7.5},
    "cpu_percent": {"service": 9.5, "camera": 3.0},
    "waited_for_a_processor_percent": {"service": 0.4, "camera": 0.1},
    "service_mb": [180.0, 181.0],
    "log_mb_per_minute": 633.0,
    "stolen_by_the_host_percent": 0.31,
}


def judged(**changes: Any) -> dict[str, bool | None]:
    found = deepcopy(FOUND) | changes
    return {line.what.split(": ")[1]: line.good for line in live_lines(found, held=found["flight"] == "street")}


def test_within_all_bounds() -> None:
    assert False not in judged().values()
    assert False not in judged(hz=12.0).values()
    assert str(live_lines(FOUND, held=True)[1]).endswith("<= 8 ms    ok")


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"dropped_by_the_service": {"a newer frame was there": 1}}, "frames"),
        ({"log_dropped": 1}, "frames"),
        ({"samples_lost": 1}, "frames"),
        ({"exposure_to_subscriber_ms": {"p50": 5.0, "p99": 8.1}}, "exposure to subscriber"),
        ({"hz": 12.0, "cpu_percent": {"service": 10.1, "camera": 3.0}}, "the service's processor"),
        ({"service_mb": [180.0, 190.0]}, "memory, first and last quarter"),
    ],
)
def test_beyond_a_bound(changes: dict[str, Any], what: str) -> None:
    assert [name for name, good in judged(**changes).items() if good is False] == [what]


def test_a_machine_that_is_not_at_rest_is_reported() -> None:
    busy = live_lines(FOUND | {"waited_for_a_processor_percent": {"service": 50.0}}, held=True)
    assert "50.0 % (others had it: not at rest)" in "\n".join(map(str, busy))
    assert "at rest" not in "\n".join(map(str, live_lines(FOUND, held=True)))


def test_what_the_host_gave_to_others_is_reported() -> None:
    values = {line.what: line.value for line in live_lines(FOUND, held=True)}
    assert values["street 30 Hz: processors taken by the host"] == "0.31 %"
    before_s = stolen_s()
    assert 0.0 <= before_s <= stolen_s() <= time.monotonic()


def test_foliage_is_reported_and_held_to_no_times() -> None:
    slow = judged(flight="trees", exposure_to_subscriber_ms={"p50": 9.0, "p99": 15.0})
    assert slow["exposure to subscriber"] is None
    assert judged(flight="trees", log_dropped=1)["frames"] is False


def test_starts_by_their_median() -> None:
    good = {line.what: line.good for line in start_lines({"start to ready": [0.9, 2.0, 0.8], "start to prisms": [1.2]})}
    assert good == {"start to ready": True, "start to prisms": None}
    assert start_lines({"kill -9 to ready": [1.6, 1.7, 1.0]})[0].good is False


def test_what_is_measured_is_the_shipped_configuration_but_for_what_is_asked() -> None:
    measured = config_of(tomllib.loads(shipped({"flight": "street", "fps": 12.0})), "measured")
    street = replace(EMBEDDED.cameras[0], flight="street", fps=12.0)
    assert measured == replace(EMBEDDED, cameras=(street,))


@pytest.mark.parametrize("key", ["speed", "#", "[^=]+"])
def test_a_key_that_the_shipped_configuration_has_not_once_is_no_measurement(key: str) -> None:
    with pytest.raises(ValueError, match=r"simulated\.toml: \d+ lines"):
        shipped({key: 1})


def test_the_configuration_of_a_run_records_and_publishes_in_its_folder(tmp_path: Path) -> None:
    asked = Namespace(flight="street", hz=12.0, width=640, seed=1, no_log=False)
    config = config_of(tomllib.loads(config_text(asked, tmp_path)), "measured")
    assert (config.record.record, config.record.folder) == ("always", f"{tmp_path}/logs")
    assert config.publish.prisms == f"ipc://{tmp_path}/prisms"
