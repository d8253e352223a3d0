"""The report of a replay, as text and as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from core.codes import text_of
from core.types import InvalidCause
from drivers.shell_word import shell_word

from ..config.service import RecordParams
from ..console import counted, print_line
from ..log.recovered_text import recovered_texts
from ..pipeline.pipeline import UNPUBLISHED_DROPS
from ..pipeline.results import FrameDecision
from ..pipeline.sync import DropCause
from ..self_check.exposure_offset import ExposureOffset, warning_text
from .compare import Comparison, Key
from .summary import ReplayCounts

_LISTED = 5


@dataclass(slots=True)
class Replay:
    """The result of a replay."""

    counts: ReplayCounts
    sample_anomalies: dict[str, int]
    cameras: tuple[str, ...]
    comparison: Comparison | None = None
    tracks: Comparison | None = None  # the comparison of the tracked obstacles
    damage: str | None = None  # of the input, None: none
    unwritten: Path | None = None  # the requested output, where it was not written for lack of a frame
    exposure_offsets: tuple[ExposureOffset, ...] = ()
    configured_offsets_ms: dict[str, float] = field(default_factory=dict)
    # by camera, the detection range at the noise of its last frame
    obstacle_range_m: dict[str, float] = field(default_factory=dict)
    mask_faults: list[str] = field(default_factory=list)  # cameras with a mask outside of the image, as text
    lost: list[str] = field(default_factory=list)  # what a recovered log lacks, as text
    # of a recovered log: topic -> the log from which its description was taken
    borrowed: dict[str, str] = field(default_factory=dict)
    depth_note: str = ""  # what the check cannot compare, of a log that was recorded without all depth images


def depth_note(record: RecordParams) -> str:
    """What a log recorded so lacks for a replay; empty: nothing."""
    if not record.depth:
        return "the log was recorded with [record] depth = false: no frame can be computed again"
    if record.depth_hz > 0.0:
        return (
            f"the log was recorded with [record] depth_hz = {record.depth_hz:g}: frames between the recorded images cannot "
            "be computed again; the others begin with their recorded state and are compared completely"
        )
    return ""


def replay_problems(result: Replay) -> list[str]:
    """The problems that make the command fail, each with its remedy."""
    problems = [result.damage] if result.damage else []
    if result.counts.first_dropped is not None and not _same_as_recorded(result.comparison):
        problems.append(_drop_problem(result.counts, result.counts.first_dropped))
    elif result.counts.frames == 0 and not result.damage:
        problems.append("no depth image in the input: nothing was computed; record or import a log with depth images")
    if result.unwritten is not None:
        problems.append(f"no frame could be computed, so that {result.unwritten} was not written")
    if result.comparison is not None and not result.comparison.passed:
        problems.append(_check_problem(result.comparison))
    if result.tracks is not None and result.tracks.different:
        t = result.tracks
        problems.append(f"check: the tracks of {t.different} of {t.compared} frames differ; first: {t.first}")
    return problems


def _same_as_recorded(comparison: Comparison | None) -> bool:
    """Whether the log has the same results without a gap: frames dropped in flight are dropped again, which is not a
    problem."""
    return comparison is not None and comparison.passed and not comparison.gaps


def _drop_problem(counts: ReplayCounts, first: FrameDecision) -> str:
    causes = ", ".join(f"{n} x {text_of(code, DropCause)}" for code, n in sorted(counts.dropped.items()))
    not_published = sum(counts.dropped[cause.value] for cause in UNPUBLISHED_DROPS)
    wrong_size = counts.dropped[DropCause.WRONG_SIZE.value]
    blind = counts.dropped.total() - not_published
    uncertain = counts.dropped[DropCause.CLOCK_UNCERTAIN.value]
    remedies = []
    if blind > wrong_size + uncertain:
        remedies.append(
            "Record the autopilot's attitude at 50 Hz, from before the first frame until after the last, on a computer that "
            "has time for it"
        )
    if uncertain:
        remedies.append("Synchronise the clocks better (TIMESYNC on a fast line), or turn more slowly")
    if wrong_size:
        remedies.append("Set the image size in the camera's description")
    if not_published:
        remedies.append(
            f"{not_published} are duplicates or out of order and were skipped: check the camera's timestamps"
        )
    return (
        f"{counts.dropped.total()} of {counts.frames} frames were dropped and {blind} of them are published as blind "
        f"({causes}); the first is frame {first.sequence} of camera {first.camera} at {first.t_exposure_ns} ns. "
        + ". ".join(remedies)
    )


def _check_problem(comparison: Comparison) -> str:
    if comparison.compared == 0:
        return (
            "check: nothing to compare: no frame has both a depth image and prisms in the input; check a log written "
            "by `companion replay -o` with its depth images"
        )
    return f"check: {comparison.different} of {comparison.compared} frames differ; first: {comparison.first}"


def report(result: Replay, path: Path, output: Path | None, problems: list[str]) -> dict[str, Any]:
    """The object of `--json`."""
    comparison = result.comparison
    check = None
    if comparison is not None:
        check = {
            "passed": comparison.passed,
            "compared": comparison.compared,
            "different": comparison.different,
            "first_difference": str(comparison.first) if comparison.first else None,
            "missing_from_log": [_named(key) for key in comparison.only_computed],
            "without_depth": [_named(key) for key in comparison.only_logged],
            "note": result.depth_note,
            "tracks_compared": result.tracks.compared if result.tracks is not None else 0,
            "tracks_different": result.tracks.different if result.tracks is not None else 0,
        }
    return {
        "input": str(path),
        "output": str(output) if output else None,
        "cameras": list(result.cameras),
        **result.counts.as_json(),
        "obstacle_range_m": result.obstacle_range_m,
        "sample_anomalies": result.sample_anomalies,
        "exposure_offsets": [_offset_json(offset, result) for offset in result.exposure_offsets],
        "check": check,
        "lost": result.lost,
        "descriptions_from": result.borrowed,
        "problems": problems,
    }


def _offset_json(offset: ExposureOffset, result: Replay) -> dict[str, Any]:
    """offset_ms and sigma_ms are null unless measured."""
    return {
        "camera": offset.camera,
        "state": str(offset.state),
        "offset_ms": None if offset.offset_s is None else 1000.0 * offset.offset_s,
        "sigma_ms": None if offset.sigma_s is None else 1000.0 * offset.sigma_s,
        "pairs": offset.pairs,
        "warning": _offset_warning(offset, result),
    }


def _offset_warning(offset: ExposureOffset, result: Replay) -> str:
    return warning_text(offset, result.configured_offsets_ms.get(offset.camera))


def _named(key: Key) -> dict[str, Any]:
    return {"camera": key[0], "sequence": key[1], "t_exposure_ns": key[2]}


def print_report(result: Replay, output: Path | None) -> None:
    """Prints the summary."""
    _print_frames(result)
    for offset in result.exposure_offsets:
        warning = _offset_warning(offset, result)
        print_line(f"warning: {warning}" if warning else f"camera {offset.camera}: exposure time offset: {offset.text}")
    if result.sample_anomalies:
        listed = ", ".join(f"{anomaly.replace('_', ' ')}: {n}" for anomaly, n in result.sample_anomalies.items())
        print_line(f"samples: {listed}")
    for advice in result.counts.advice():
        print_line(f"warning: {advice.text}")
    for text in recovered_texts(result.lost, result.borrowed):
        print_line(f"warning: {text}")
    _print_check(result)
    if output is not None:
        print_line(f"written: {output}")
        print_line(f"next: companion view {shell_word(output)} -o pictures")


def _print_frames(result: Replay) -> None:
    t = result.counts
    print_line(
        f"{counted(t.frames, 'frame')} of {', '.join(result.cameras)}; {t.samples} attitude and position samples"
    )
    attitude = ", ".join(f"{n} {how}" for how, n in sorted(t.attitude.items())) or "none"
    print_line(f"attitude at exposure: {attitude}")
    if t.valid:
        mean = f"{t.planes / t.valid:.1f} planes and {t.prisms / t.valid:.1f} prisms per frame on average"
        print_line(f"{t.valid} valid frames: {mean}; ground found in {t.view.ground_seen}")
        print_line(
            f"{t.view.mean_measured_share:.0%} of the pixels measured; at the camera's height {t.view.mean_free_share:.0%} of the "
            f"directions free for a metre or more, none in {counted(t.view.nothing_free, 'frame')}"
        )
    for camera, ke in sorted(t.ke_per_m.items()):
        print_line(
            f"{camera}: obstacles are detected up to {result.obstacle_range_m[camera]:.1f} m at the estimated depth "
            f"noise of {ke:.4f}/m"
        )
    for code, n in sorted(t.blind.items()):
        print_line(f"{n} invalid frames: {text_of(code, InvalidCause)}")
    for code, n in sorted(t.dropped.items()):
        print_line(f"{counted(n, 'frame')} dropped: {text_of(code, DropCause)}")


def _print_check(result: Replay) -> None:
    if result.comparison is not None:
        _print_comparison(result.comparison)
        if result.depth_note:
            print_line(f"check: {result.depth_note}")
    if result.tracks is not None and result.tracks.compared:
        verdict = "NOT equal" if result.tracks.different else "equal"
        print_line(f"check: tracks of {counted(result.tracks.compared, 'frame')} compared: {verdict}")


def _print_comparison(comparison: Comparison) -> None:
    verdict = "equal" if comparison.passed else "NOT equal"
    how = "bit by bit" if comparison.tolerance == 0.0 else f"within {comparison.tolerance:g}"
    print_line(f"check: {counted(comparison.compared, 'frame')} compared {how}: {verdict}")
    for keys, what in ((comparison.only_computed, "missing from the log"), (comparison.only_logged, "without depth")):
        if keys:
            some = ", ".join(f"{camera} {sequence}" for camera, sequence, _ in keys[:_LISTED])
            more = ", ..." if len(keys) > _LISTED else ""
            print_line(f"check: {counted(len(keys), 'frame')} not comparable, {what}: {some}{more}")
