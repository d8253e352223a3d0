"""Hashes of the sources of the compiled kernels, by which `jit_cache` names its directories.

`source_key` contains all sources as they are. `import_closures` has a hash for each module: of its syntax tree and of
those of the modules that it imports. Docstrings and comments are no part of it."""

from __future__ import annotations

import ast
import hashlib
import os
import sys
from collections.abc import Collection
from importlib import metadata
from pathlib import Path
from typing import Final

from .processor import CPU_FEATURES, CPU_NAME, instructions

CODE_OPTIONS: Final = (
    "NUMBA_BOUNDSCHECK",
    "NUMBA_OPT",
    "NUMBA_LOOP_VECTORIZE",
    "NUMBA_SLP_VECTORIZE",
    "NUMBA_DEBUGINFO",
    CPU_NAME,
    CPU_FEATURES,
)
"""Environment variables of numba that change the machine code. Those of the processor give each level of processors a
directory of its own."""
KERNELS_OUTSIDE_CORE: Final = ("drivers/simulation/ray_caster.py",)
"""Files with kernels outside of core, relative to the root."""
_LAYOUT: Final = "2"
"""Changes with the layout of the directories of kernels."""
_NOT_IN_KERNELS: Final = frozenset({"core.params", "core.world.params"})
"""Modules of parameter classes. Kernels cannot read them, so they do not affect machine code."""

Closure = tuple[str, str]
"""Hashes of a module: of its import closure, see `import_closures`, and of its file's content."""


def source_key(root: Path) -> str:
    """Returns 16 hex digits: hash of the sources of all kernels, the versions of numba and Python, and compiler
    options."""
    digest = hashlib.sha256(_compiler().encode())
    for path in kernel_files(root):
        content = path.read_bytes()
        digest.update(f"\n{path.relative_to(root)} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


def kernel_files(root: Path) -> list[Path]:
    """Returns the sources whose content affects the machine code of the kernels."""
    return [*sorted((root / "core").rglob("*.py")), *(root / name for name in KERNELS_OUTSIDE_CORE)]


def import_closures(root: Path) -> dict[str, Closure]:
    """Returns the closure of each module, such as `core.stages.level`.

    Its first hash contains the syntax trees without docstrings of the module and of all kernel files that it imports,
    and the names of all named tuples. numba's index of a kernel refers to the classes of its arguments, which other
    modules may define: it cannot be read if one of them was moved or removed."""
    files = {module_name(path.relative_to(root)): path for path in kernel_files(root)}
    trees = {name: _without_docstrings(ast.parse(path.read_text())) for name, path in files.items()}
    packages = {name for name, path in files.items() if path.stem == "__init__"}
    imports = {
        name: _imported(tree, name if name in packages else name.rpartition(".")[0], files.keys()) - _NOT_IN_KERNELS
        for name, tree in trees.items()
    }
    tuples = sorted(f"{name}.{c}" for name, tree in trees.items() for c in _named_tuples(tree))
    dumped = {name: ast.dump(tree) for name, tree in trees.items()}
    version = _compiler()
    closures = {}
    for name in files:
        reached, todo = {name}, [name]
        while todo:
            new = imports[todo.pop()] - reached
            reached |= new
            todo += new
        text = "\n".join([version, *tuples, name, *(dumped[other] for other in sorted(reached))])
        closures[name] = text_hash(text), content_hash(files[name])
    return closures


def content_hash(path: Path) -> str:
    """Returns 16 hex digits for the content of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def text_hash(text: str) -> str:
    """Returns 16 hex digits for a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _compiler() -> str:
    """Returns what affects the machine code besides the sources.

    numba compiles for the processor of this computer unless both variables name another one."""
    options = [f"{name}={os.environ[name]}" for name in CODE_OPTIONS if name in os.environ]
    host = () if {CPU_NAME, CPU_FEATURES} <= os.environ.keys() else sorted(instructions())
    return " ".join([_LAYOUT, metadata.version("numba"), str(sys.implementation.cache_tag), *options, *host])


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            body = [s for s in node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
            node.body = body or [ast.Pass()]
    return tree


def _named_tuples(tree: ast.Module) -> list[str]:
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    return [c.name for c in classes if any(isinstance(b, ast.Name) and b.id == "NamedTuple" for b in c.bases)]


def module_name(path: Path) -> str:
    """Returns the name of a module, such as `core.stages.level`; of `core/types/__init__.py` it is `core.types`."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(tree: ast.Module, package: str, known: Collection[str]) -> set[str]:
    """Returns the known modules that a module of a package imports, by any form of import."""
    parents, found = package.split("."), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = parents[: len(parents) + 1 - node.level] if node.level else []
            source = ".".join([*base, node.module] if node.module else base)
            found |= {source, *(f"{source}.{alias.name}" for alias in node.names)}
    return found & set(known)
