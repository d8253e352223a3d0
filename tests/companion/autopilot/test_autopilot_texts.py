"""Texts of the companion for the pilot: one for a change, never a stream, none cut inside a word."""

from __future__ import annotations

import itertools

import pytest

from companion.autopilot.status_text import MOST_CHARACTERS, OPENING_NS, SHORT, StatusTexts, mount_note, shortened
from companion.pipeline.sync import DropCause
from core.types.model import InvalidCause

from ..parameter_replies import NS


def test_one_text_for_a_change_and_never_a_stream() -> None:
    texts = StatusTexts()
    lines = []
    for tenth in range(600):  # blind every other tenth of a second for half a minute, then for good
        blind = (tenth < 300 and tenth % 2 == 0) or tenth >= 300
        message = texts.due({"front": "camera process silent for 0.6 s" if blind else ""}, NS + tenth * NS // 10)
        if message is not None:
            lines.append((tenth, message.severity, message.text))
    assert 1 <= len(lines) <= 16
    assert lines[-1][2].startswith("OA: front blind: camera process silent for 0.6 s")
    assert all(b[0] - a[0] >= 20 for a, b in itertools.pairwise(lines))


def test_a_camera_that_changes_all_the_time_leaves_room_for_others() -> None:
    """Each text was of the first camera that had changed: a second blind camera, and that nothing is braked for, were never sent."""
    texts, lines = StatusTexts(), []
    for tenth in range(600):
        front = "silent" if tenth // 19 % 2 else ""
        left, echo = ("lost", "autopilot does not use the obstacles: CP_DIST") if tenth >= 300 else ("", "")
        message = texts.due({"front": front, "left": left}, NS + tenth * NS // 10, {"clock": "", "echo": echo})
        if message is not None:
            lines.append((tenth, message.text))
    others = [(tenth, text) for tenth, text in lines if "front" not in text]
    assert {text for _, text in others} == {"OA: left blind: lost", "OA: autopilot does not use the obstacles"}
    assert len(others) == 2
    assert others[-1][0] <= 300 + 60
    assert len(lines) >= 20


@pytest.mark.parametrize("camera", ["front", "downward_left"])
def test_a_degraded_mount_is_sent_once_and_fits(camera: str) -> None:
    texts = StatusTexts()
    assert texts.due({}, NS, {f"mount {camera}": mount_note(camera, False)}) is None
    sent = texts.due({}, 4 * NS, {f"mount {camera}": mount_note(camera, True)})
    assert sent.text.startswith(f"OA: {camera} mount differs from")
    assert len(sent.text) <= MOST_CHARACTERS
    assert texts.due({}, 8 * NS, {f"mount {camera}": mount_note(camera, True)}) is None
    assert texts.due({}, 12 * NS, {f"mount {camera}": mount_note(camera, False)}).text.startswith("OA: cleared")


def test_opening_cameras_are_no_news() -> None:
    texts = StatusTexts()
    assert texts.due({"front": "starting"}, NS) is None
    assert texts.due({"front": ""}, 9 * NS) is None
    assert texts.due({"front": "silent"}, 10 * NS).severity == 2
    assert "recovered" in texts.due({"front": ""}, 30 * NS).text


def test_a_camera_that_never_opens_is_reported() -> None:
    texts = StatusTexts()
    assert [texts.due({"front": "no such device"}, t * NS) is None for t in (1, 5, 10, 11, 12)] == [True] * 3 + [
        False,
        True,
    ]


@pytest.mark.parametrize(
    "cause",
    [
        "x" * 200,
        "the newest attitude is too old to be carried forward",
        "zu heiss " * 9,
        "a " + "b" * 60,
        "aaaa " * 20,
        "the distances cannot be computed (ValueError: operands could not be broadcast)",
    ],
)
def test_texts_fit_their_field_and_are_never_cut_inside_a_word(cause: str) -> None:
    full = f"OA: front blind: {cause}"
    text = shortened(full)
    assert len(text.encode()) <= MOST_CHARACTERS
    assert text.startswith("OA: front blind:")
    assert full.startswith(text)
    assert full[len(text) :].lstrip(",;(") == "" or full[len(text) :].lstrip(",;(")[0] == " "
    assert len(full) <= MOST_CHARACTERS or set(text.split()) <= set(full.replace(",", "").replace("(", "").split())


@pytest.mark.parametrize("cause", [c for c in (*DropCause, *InvalidCause) if c.text], ids=lambda c: c.name)
def test_no_cause_of_a_blind_camera_ends_in_mid_sentence(cause: DropCause | InvalidCause) -> None:
    """The pilot got OA: front blind: the newest attitude is too old to."""
    texts = StatusTexts()
    assert texts.due({"front": ""}, 0) is None
    sent = texts.due({"front": cause.text}, OPENING_NS).text
    expected = f"OA: front blind: {SHORT.get(cause.text, cause.text)}"
    assert sent == expected
    assert len(expected) <= MOST_CHARACTERS


def test_a_text_that_fits_is_not_changed() -> None:
    for length in (49, 50):
        assert shortened("y" * length) == "y" * length
    assert shortened("ä" * 10) == "?" * 10
    assert len(shortened("y" * 51)) == MOST_CHARACTERS
