"""Prints the test files that a change affects, for `make check`: `python .ci/affected_tests.py [REVISION]`.

Changed files differ from REVISION (HEAD) in the working tree, or are new. Where only comments, docstrings or the formatting
differ, no test is affected. For each changed module the tests of its package (`tests/core` for `core`, `tests/client` for
`osape_client`) that import it, directly or not, are printed, and each changed test file itself. A change in `core` adds the
golden results."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("osape_client", "core", "drivers", "companion", "benchmarks")
TESTS = {"osape_client": "client"}
"""Folder of a package's tests where it is not called like the package."""
CLIENT = "clients/python/"
GOLDEN = "tests/test_golden.py"


def changed_files(revision: str) -> list[str]:
    """Python files that differ from a revision or are not tracked, relative to the checkout."""
    commands = (
        ["git", "diff", "--name-only", "--diff-filter=d", revision],
        ["git", "ls-files", "--others", "--exclude-standard"],
    )
    outputs = [subprocess.run(c, cwd=ROOT, capture_output=True, text=True, check=True).stdout for c in commands]
    files = {line for output in outputs for line in output.splitlines() if line.endswith(".py")}
    return sorted(file for file in files if code_differs(before(file, revision), (ROOT / file).read_text("utf-8")))


def before(file: str, revision: str) -> str | None:
    """The file at a revision; None: it was not there."""
    done = subprocess.run(["git", "show", f"{revision}:{file}"], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else None


def code_differs(old: str | None, new: str) -> bool:
    """Whether two versions of a module differ in more than comments, docstrings and formatting. old None: a new file."""
    return old is None or code_of(old) != code_of(new)


def code_of(text: str) -> str:
    """The syntax tree without docstrings; the text itself where it has no valid syntax."""
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return text
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            node.body = [s for s in node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
    return ast.dump(tree)


def affected_tests(changed: list[str], graph: grimp.ImportGraph) -> set[str]:
    """Test files to run for changed files."""
    tests: set[str] = set()
    for file in changed:
        module = ".".join(Path(file.removeprefix(CLIENT)).with_suffix("").parts).removesuffix(".__init__")
        package = module.partition(".")[0]
        if package == "core":
            tests.add(GOLDEN)
        if module not in graph.modules:
            continue
        found = {module} | graph.find_downstream_modules(module)
        for name in found:
            parts = name.split(".")
            if (
                parts[0] == "tests"
                and parts[-1].startswith("test_")
                and (package == "tests" or parts[1] == TESTS.get(package, package))
            ):
                tests.add("/".join(parts) + ".py")
    return {test for test in tests if (ROOT / test).is_file()}


def main() -> None:
    """Prints one file a line, nothing where no test is affected."""
    sys.path[:0] = [str(ROOT), str(ROOT / CLIENT)]
    graph = grimp.build_graph(*PACKAGES, "tests", cache_dir=None)
    revision = sys.argv[1] if len(sys.argv) > 1 else "HEAD"
    print("\n".join(sorted(affected_tests(changed_files(revision), graph))))


if __name__ == "__main__":
    main()
