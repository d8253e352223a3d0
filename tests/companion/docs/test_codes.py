"""The codes for programs: each has its value in the schema, its form, its text and its line in the documentation."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.internal.enum_type_wrapper import EnumTypeWrapper

from companion.autopilot.conflict_codes import CONFLICT_CODES
from companion.cameras.status import CameraCondition
from companion.diagnostic import Diagnostic, DiagnosticCode
from companion.live.health import latency_message
from companion.live.message_json import message_json
from companion.live.prometheus import families
from companion.pipeline.encode import prisms_message
from companion.pipeline.latency import LatencyStage
from companion.pipeline.results import PrismsResult
from companion.pipeline.sync import DropCause
from companion.replay.compare import first_difference
from companion.self_check.exposure_offset import OffsetState
from core.codes import Code, text_of
from core.self_check.mount_check import MountVerdict
from core.types import InvalidCause
from drivers.mavlink.anomalies import LinkAnomaly
from drivers.mavlink.conflicts import RECENT_NS, ConflictDetector
from osape_client.decode import cause_code
from osape_client.proto import osape_v1_pb2 as pb

from ..diagnostic_tables import DOCTOR_ONLY, REMEDIES
from ..live.test_status import report
from ..reference_tables import metrics

DOCS = Path(__file__).resolve().parents[3] / "docs" / "reference"
NOTHING = {"UNKNOWN", "NONE"}
"""Values without a code: what an older sender left out."""
ENUMS: list[tuple[Any, tuple[Any, ...], set[str]]] = [
    (pb.Cause, (InvalidCause, DropCause), {"CAMERA"}),  # CAUSE_CAMERA comes from the service, not from the pipeline
    (pb.Diagnostic.Code, (DiagnosticCode,), set()),
    (pb.Latency.Stage, (LatencyStage,), set()),
    (pb.CameraHealth.Condition, (CameraCondition,), set()),
    (pb.ExposureOffset.State, (OffsetState,), set()),
    (pb.MountState.Verdict, (MountVerdict,), set()),
]
CODES: list[type[Code]] = [InvalidCause, DropCause, DiagnosticCode, LatencyStage, LinkAnomaly]


def names_of(enum: EnumTypeWrapper) -> set[str]:
    """Without the prefix; of several names of one number the first, which is the one in use."""
    prefix = f"{enum.DESCRIPTOR.name.upper()}_"
    names = {enum.Name(number) for number in enum.values()}
    assert all(name.startswith(prefix) for name in names)
    return {name.removeprefix(prefix) for name in names}


@pytest.mark.parametrize(("enum", "kinds", "schema_only"), ENUMS, ids=lambda v: getattr(v, "__name__", ""))
def test_every_value_stands_in_python_and_in_the_schema(
    enum: Any, kinds: tuple[Any, ...], schema_only: set[str]
) -> None:
    members = {member.name for kind in kinds for member in kind}
    assert members - NOTHING == names_of(enum) - NOTHING - schema_only
    assert schema_only <= names_of(enum)


@pytest.mark.parametrize("kind", [*CODES, CameraCondition, OffsetState])
def test_every_code_is_its_name_in_snake_case(kind: Any) -> None:
    for member in kind:
        if member.name != "NONE":
            assert member.value == member.name.lower()
            assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", member.value)


@pytest.mark.parametrize("kind", CODES)
def test_every_code_has_a_text_that_is_no_code(kind: type[Code]) -> None:
    texts = [member.text for member in kind if member.value]
    assert all(texts)
    assert len(set(texts)) == len(texts)
    assert not {*texts} & {member.value for member in kind if "_" in member.value}


@pytest.mark.parametrize(
    "kind", [InvalidCause, DropCause, LatencyStage, CameraCondition, OffsetState, LinkAnomaly, DiagnosticCode]
)
def test_every_code_is_documented_in_a_table(kind: Any) -> None:
    rows = set(re.findall(r"^\| `(\w+)` \|", (DOCS / "diagnostics.md").read_text(encoding="utf-8"), re.MULTILINE))
    assert {str(code) for code in kind if code} - rows == set()


def test_every_diagnostic_has_one_remedy() -> None:
    documented = [code for remedies in REMEDIES.values() for code in remedies]
    assert sorted(documented) == sorted(DiagnosticCode)
    assert all(remedy for remedies in REMEDIES.values() for remedy in remedies.values())


def test_the_codes_that_only_doctor_reports_are_marked() -> None:
    package = DOCS.parents[1] / "companion"
    users: dict[str, set[str]] = {}
    for file in package.rglob("*.py"):
        for name in re.findall(r"\bDiagnosticCode\.([A-Z_]+)\b", file.read_text(encoding="utf-8")):
            users.setdefault(name, set()).add(file.relative_to(package).parts[0])
    assert {name for name, parts in users.items() if parts == {"doctor"}} == {code.name for code in DOCTOR_ONLY}


def test_the_table_of_metrics_names_each_label() -> None:
    table = metrics("")
    named = set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE))
    assert named == {name for name, _, _, _ in families(report())}
    assert "| `latency_seconds` | `stage`, `quantile` |" in table
    assert "| `camera_condition` | `camera`, `condition` |" in table


def test_a_code_of_another_version_stands_for_itself() -> None:
    assert text_of("no_attitude", DropCause) == "no attitude had arrived"
    assert text_of("of_a_later_version", DropCause) == "of_a_later_version"
    assert [cause_code(n) for n in (0, 17, 48, 9999)] == ["", "attitude_stale", "camera", "unknown_9999"]


def test_former_names_of_causes_have_the_same_numbers() -> None:
    """Source code of clients that uses them goes on to work; the code comes from the present name."""
    assert (pb.CAUSE_NO_NUMBERS, pb.CAUSE_ATTITUDE_TOO_OLD) == (pb.CAUSE_NON_FINITE, pb.CAUSE_ATTITUDE_STALE)


def test_messages_carry_the_code_as_string_and_as_number() -> None:
    found = Diagnostic(DiagnosticCode.LINK_CLOSED, "", "no line").message()
    assert (found.code, found.code_enum) == ("link_closed", pb.Diagnostic.CODE_LINK_CLOSED)
    latency = latency_message(LatencyStage.EXTRACT, 1.0, 2.0, 3.0)
    assert (latency.stage, latency.stage_enum) == ("extract", pb.Latency.STAGE_EXTRACT)
    assert latency.text == "extracting"


def test_json_holds_codes_in_place_of_the_names_of_values() -> None:
    h = pb.Health(state=pb.Health.STATE_BLIND, frames_dropped={"no_attitude": 2})
    h.cameras.add(condition="lost", condition_enum=pb.CameraHealth.CONDITION_LOST)
    h.cameras[0].mount.verdict = pb.MountState.VERDICT_UNVERIFIED_SLOPE
    h.diagnostics.append(Diagnostic(DiagnosticCode.LINK_CLOSED, "", "no line").message())
    found = message_json(h)
    assert found["state"] == "blind"
    assert found["cameras"][0]["condition"] == "lost"
    assert found["cameras"][0]["mount"]["verdict"] == "unverified_slope"
    assert found["diagnostics"] == [{"code": "link_closed", "camera": "", "text": "no line"}]
    assert found["frames_dropped"] == {"no_attitude": "2"}
    assert not re.search(r"[A-Z]{3}", json.dumps(found))


def test_a_value_of_a_later_version_stays_a_number() -> None:
    h = pb.Health.FromString(bytes([5 << 3, 77]))  # field 5: state
    assert message_json(h)["state"] == 77


def test_the_check_of_a_replay_compares_causes_and_not_their_texts() -> None:
    def dropped(cause: DropCause) -> pb.PrismsFrame:
        return prisms_message(
            PrismsResult(
                camera="front", sequence=1, t_exposure_ns=2, t_arrival_ns=3, frame="level", drop=cause, model=None
            )
        )

    logged = dropped(DropCause.NO_ATTITUDE)
    logged.cause_text = "the text of an older version"
    assert first_difference(logged, dropped(DropCause.NO_ATTITUDE)) is None
    found = first_difference(logged, dropped(DropCause.ATTITUDE_STALE))
    assert found is not None
    assert found[0] == "cause"


def test_every_conflict_on_the_link_has_a_code() -> None:
    others = ConflictDetector(component_id=195)
    now_ns = RECENT_NS
    others.left_out(7, now_ns)
    others.kind("PX4", now_ns)
    others.kind("ArduPilot", now_ns)
    texts = others.texts(now_ns, configured=1, connected=False)
    assert set(texts) == {"two autopilots", "system id"}
    others.vehicle(1, "PX4", now_ns)
    others.vehicle(2, "PX4", now_ns)
    texts |= others.texts(now_ns, configured=0, connected=True)
    assert "several vehicles" in texts
    assert set(texts) <= set(CONFLICT_CODES)
