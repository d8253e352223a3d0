"""Compiled kernels read from numba's cache in a fifth of numba's own time.

numba keeps of each kernel the machine code, the intermediate code that other kernels are linked with when they are compiled,
and the names of the Python modules its parts came from. To run a kernel, only the machine code is needed; numba makes
everything ready for compiling all the same: it parses the intermediate code and goes through its symbols one by one,
imports what it knows of numpy, and puts every function of it in its tables. Here that is left until something is in
fact compiled, and then happens as ever.

What is changed is private to numba, so it holds for the versions that pyproject.toml allows. Where one of the places
has gone, all stays as numba has it, and is slower."""

from __future__ import annotations

import sys
from typing import Any

import numba  # the whole, not a part: another thread may be importing it, and each would wait for what the other has begun

caching, codegen, environment = numba.core.caching, numba.core.codegen, numba.core.environment
llvm = codegen.ll


class LoadedLibrary:
    """What numba asks of a loaded kernel's code, in place of its own CodeLibrary."""

    def __init__(self, codegen: Any, name: str, code: bytes, bitcode: bytes) -> None:
        self.codegen, self.name = codegen, name
        self._bitcode, self._module = bitcode, None
        self._reload_init: set[Any] = set()
        codegen._engine._ee.add_object_file(llvm.ObjectFileRef.from_data(code))

    def get_pointer_to_function(self, name: str) -> int:
        """The address of a function; what it refers to is bound at the first question."""
        return int(self.codegen._engine.get_function_address(name))

    def _ensure_finalized(self) -> None:
        """It is, as it was stored."""

    def _get_module_for_linking(self) -> Any:
        """The intermediate code, for a kernel that calls this one and is compiled after all."""
        if self._module is None:
            self._module = llvm.parse_bitcode(self._bitcode)
        return self._module


def load_quickly() -> None:
    """From now on and in this whole process kernels are loaded so, also one that is first needed in flight. Those that
    are not in the cache are compiled, as ever."""
    places: tuple[tuple[Any, str, Any], ...] = (
        (caching.Cache, "load_overload", _load_overload),
        (codegen.Codegen, "unserialize_library", _unserialize_library),
        (environment, "_rebuild_env", _rebuild_env),
    )
    if all(name in vars(owner) for owner, name, _ in places):
        for owner, name, ours in places:
            setattr(owner, name, ours)


def _load_overload(self: Any, signature: Any, context: Any) -> Any:
    """For Cache.load_overload, which first makes the context ready to compile. Running needs the counting of references."""
    numba.core.runtime.nrt.rtsys.initialize(context)
    with self._guard_against_spurious_io_errors():
        return self._load_overload(signature, context)


def _unserialize_library(self: Any, stored: tuple[str, str, Any]) -> Any:
    """For Codegen.unserialize_library, which parses the intermediate code and lists what it defines."""
    name, kind, data = stored
    return LoadedLibrary(self, name, *data) if kind == "object" else self._library_class._unserialize(self, stored)


def _rebuild_env(module: str, constants: list[Any], name: str) -> Any:
    """For environment._rebuild_env, which imports the module that a part of the kernel was written in. Compiled code
    takes nothing from there but the constants, which say what an error is about."""
    known = environment.lookup_environment(name)
    if known is not None:
        return known
    loaded = sys.modules.get(module)
    made = environment.Environment({"__name__": module} if loaded is None else vars(loaded))
    made.consts[:] = constants
    made.env_name = name
    environment.Environment._memo[name] = made
    return made


# kernels that are compiled and kept meanwhile name the function that numba has in this place, not ours
_rebuild_env.__module__ = environment.__name__
