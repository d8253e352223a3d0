"""docs/reference/batch.md: tables, kinds of events and limits are those of the code, and the queries run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from companion.batch.comparison import FARTHER_M, FARTHER_SHARE, SAME_PLACE_M
from companion.batch.events import EventKind
from companion.batch.flights import find_flights
from companion.batch.jobs import BatchOptions, FlightTask, Outcome
from companion.batch.schema import SCHEMA_VERSION, TABLES
from companion.batch.task import run_task
from companion.log.provenance import software

from ..fleet import write_fleet

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "reference" / "batch.md").read_text(encoding="utf-8")
QUERIES = re.findall(r"```sql\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")
    fleet, output = write_fleet(tmp_path_factory.mktemp("fleet")), tmp_path_factory.mktemp("dataset")
    for flight in find_flights([str(fleet)]):
        assert isinstance(run_task(FlightTask(flight, str(output), BatchOptions(), software())), Outcome)
    return output


def test_the_page_lists_the_tables() -> None:
    assert re.findall(r"^<!-- columns (\w+):", PAGE, re.MULTILINE) == ["frames", "flights", "events", "planes"]
    assert set(TABLES) == {"frames", "flights", "events", "planes"}


def test_the_page_lists_the_kinds_of_events() -> None:
    section = PAGE.partition("| kind | event |")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == list(EventKind)


def test_the_page_states_the_limits_of_comparisons_and_the_version() -> None:
    assert f"farther by more than {FARTHER_M:g} m and {100 * FARTHER_SHARE:g} %" in PAGE
    assert f"more than {SAME_PLACE_M:g} m (horizontally)" in PAGE
    assert f"`osape_batch_schema`, today {SCHEMA_VERSION}." in PAGE


@pytest.mark.parametrize("number", range(len(QUERIES)))
def test_the_queries_run(dataset: Path, number: int) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    rows = duckdb.sql(QUERIES[number].replace("'OUT/", f"'{dataset}/"))
    expected = (
        lambda: [r[:2] for r in rows.fetchall()] == [("beta", "no_measurement")],
        lambda: (dataset / "rows.parquet").exists(),
    )
    assert expected[number]()
