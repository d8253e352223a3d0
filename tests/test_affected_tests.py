"""Which changes `make check` takes for changes of the code (`.ci/affected_tests.py`)."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

FILE = Path(__file__).resolve().parents[1] / ".ci" / "affected_tests.py"
CODE = '"""Module."""\n\nA = 1\n"""A constant."""\n\n\ndef f() -> int:\n    """Gives A."""\n    return A  # always\n'


@pytest.fixture(scope="module")
def affected() -> ModuleType:
    spec = importlib.util.spec_from_file_location("affected_tests", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("old", "new"), [("Module.", "Other."), ("A constant.", "x"), ("Gives", "Returns"), ("always", "so")]
)
def test_comments_and_docstrings_affect_no_test(affected: ModuleType, old: str, new: str) -> None:
    assert old in CODE
    assert not affected.code_differs(CODE, CODE.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new"), [("A = 1", "A = 2"), ("return A", "return -A"), ("def f", "def g"), ("A = 1", "A = (")]
)
def test_other_changes_affect_tests(affected: ModuleType, old: str, new: str) -> None:
    assert old in CODE
    assert affected.code_differs(CODE, CODE.replace(old, new))
    assert affected.code_differs(None, CODE)
