"""docs/reference/batch.md: the columns are those of the code, and the queries run."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from companion.batch.conditions import NAMED
from companion.batch.flights import find_flights
from companion.batch.jobs import BatchOptions, FlightTask, Outcome
from companion.batch.schema import TABLES
from companion.batch.task import run_task
from companion.log.provenance import software

from .fleet import write_fleet

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "reference" / "batch.md").read_text(encoding="utf-8")
QUERIES = re.findall(r"```sql\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pyarrow", reason="the extra `batch` is not installed")
    fleet, output = write_fleet(tmp_path_factory.mktemp("fleet")), tmp_path_factory.mktemp("dataset")
    for flight in find_flights([str(fleet)]):
        assert isinstance(run_task(FlightTask(flight, str(output), BatchOptions(), software())), Outcome)
    return output


@pytest.mark.parametrize("table", TABLES)
def test_the_page_lists_the_columns(table: str) -> None:
    section = PAGE.partition(f"\n## {table}\n")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `(\w+)` \| (\w+) \| (.*) \|$", section, re.MULTILINE)
    assert listed == [(c.name, c.kind, c.doc) for c in TABLES[table]]


def test_the_page_lists_the_conditions() -> None:
    listed = re.findall(r"^\| `(\w+)` \| (frames|events) \| `(.*)` \| (.*) \|$", PAGE, re.MULTILINE)
    assert listed == [(n, c.table, json.dumps([list(f) for f in c.filters]), c.doc) for n, c in NAMED.items()]


@pytest.mark.parametrize("number", range(len(QUERIES)))
def test_the_queries_run(dataset: Path, number: int) -> None:
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    rows = duckdb.sql(QUERIES[number].replace("'OUT/", f"'{dataset}/"))
    expected = (
        lambda: [r[:4] for r in rows.fetchall()] == [("beta", "20261103-120000", 0, None)],
        lambda: [r[:2] for r in rows.fetchall()] == [("beta", "no_measurement")],
        lambda: (dataset / "rows.parquet").exists(),
    )
    assert expected[number]()
