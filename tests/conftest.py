"""What several tests share."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import HealthCheck, settings

from companion.kernels.jit_cache import use_own_cache

use_own_cache()  # before any test imports numba: kernels of these very sources, the same that the commands have

# `fixed`: the same examples on every run. `nightly`: new examples on every run, from a seed that `make nightly` prints.
# `nojit`: kernels as Python take a hundred times as long. The pass with bounds checks has all examples of `fixed`.
# No example fails because the machine is busy.
FIXED = settings(deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("fixed", FIXED, max_examples=25)
settings.register_profile("nightly", deadline=None, derandomize=False, print_blob=True, max_examples=500)
settings.register_profile("nojit", FIXED, max_examples=10)
settings.load_profile("nojit" if os.environ.get("NUMBA_DISABLE_JIT") == "1" else "fixed")

CHECKOUT = Path(__file__).resolve().parent.parent


def pytest_configure(config: pytest.Config) -> None:
    # not in pyproject.toml: pytest would import numba, which then has chosen its cache, before this file
    config.addinivalue_line("filterwarnings", "error::numba.core.errors.NumbaPerformanceWarning")


TIERS = ("process", "slow", "soak", "vm")
"""Markers of tests that are no unit tests. A test has one of them at most, so that no tier contains a test of another."""


SEARCHED = ("process", "realtime", "nojit")
"""Markers whose passes in the Makefile collect only the files that contain `mark.` and the marker."""


LONG_FILES = (
    "guard/test_guard_process.py",
    "live/test_service_avoids.py",
    "live/test_signed_line.py",
    "viewer/test_view_live.py",
    "autopilot/test_apply_parameters.py",
    "kernels/test_jit_cache.py",
    "autopilot/test_fault_table.py",
    "viewer/test_view_screens.py",
    "doctor/test_doctor.py",
    "kernels/test_processor_levels.py",
    "drivers/test_mavlink_link.py",
    "live/test_service_alone.py",
    "kernels/test_warmup.py",
    "autopilot/test_braking_lines.py",
    "log/test_recorder.py",
    "live/test_service.py",
)
"""The longest files of the passes with processes, in the order in which these begin them: first, so that none is left for the
end; those that wait and those that compute in turns, so that the processors are in use. While a worker has two tests or fewer,
pytest-xdist gives it one more file: the guard's, which has two, is followed by the short third one."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks every test without another tier as a unit test, and begins with the long files. Raises UsageError where a test has
    two tiers, or a marker by which the Makefile would not find its file."""
    texts: dict[Path, str] = {}
    for item in items:
        for marker in SEARCHED:
            if not item.get_closest_marker(marker):
                continue
            if item.path not in texts:
                texts[item.path] = item.path.read_text(encoding="utf-8")
            if f"mark.{marker}" not in texts[item.path]:
                raise pytest.UsageError(
                    f"{item.nodeid} has the marker {marker}, but {item.path.name} does not contain mark.{marker}: make test "
                    "would not collect the file; write the marker in it"
                )
        tiers = [tier for tier in TIERS if item.get_closest_marker(tier)]
        if len(tiers) > 1:
            raise pytest.UsageError(f"{item.nodeid} has the tiers {' and '.join(tiers)}: keep one of these markers")
        if not tiers:
            item.add_marker(pytest.mark.unit)
    items.sort(key=lambda item: _place("/".join(item.path.parts[-2:])))


def _place(file: str) -> int:
    """The place of a file among the long ones; all others, in their order, are behind these."""
    return LONG_FILES.index(file) if file in LONG_FILES else len(LONG_FILES)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-golden", action="store_true", help="rewrite the golden results and show what changed")


@pytest.fixture
def update_golden(request: pytest.FixtureRequest) -> bool:
    """Whether golden results are to be rewritten instead of compared with."""
    return bool(request.config.getoption("--update-golden"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Recordings beside the checkout, which are not part of it; tests that need them state when they are missing."""
    folder = CHECKOUT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("recorded data not present beside the checkout (../shared/data)")
    return folder


@pytest.fixture(scope="session")
def pp() -> ModuleType:
    """examples/path_planner.py as a module."""
    pytest.importorskip("ompl", reason="the extra `planner` is not installed")
    spec = importlib.util.spec_from_file_location("path_planner", CHECKOUT / "examples" / "path_planner.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["path_planner"] = module
    spec.loader.exec_module(module)
    return module
