"""Functions compiled by numba: the inner loops of estimator, detector, calibration and simulation."""

from __future__ import annotations

import inspect
import os
import sys
import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast, dataclass_transform

import numba
import numpy as np
from llvmlite.binding import Linkage, parse_assembly
from numba.core import types
from numba.core.caching import IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.experimental import structref

from .console import say

_F = TypeVar("_F", bound=Callable[..., Any])
_T = TypeVar("_T")

_FAST = {"contract", "reassoc", "nsz", "arcp"}
"""Freedoms in the order of sums and products. NaN and infinity keep their meaning: they mark what is not known."""

_OWN = zlib.crc32(Path(__file__).read_bytes())
"""Of this file, which decides how kernels are compiled: what was kept by another version of it is not used."""

_PIECE = 16
"""Items that a thread takes at once."""


class _Whole(JITCodeLibrary):
    """Machine code of a kernel and of all that it calls: optimised and translated once.

    By itself numba does both for each function with all that it calls, level by level: three quarters of the time. And
    it leaves those functions to be shared between kernels: a kernel would run the code of whichever was loaded first,
    optimised for that one, and differ in the last digits. Here each kernel has its own.
    """

    def _optimize_final_module(self) -> None:
        _say_compiling()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage != Linkage.external:
                function.linkage = Linkage.internal
        super()._optimize_final_module()

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, bytes]]:
        """Without the code for other kernels to build on, which would take most of the time of loading it."""
        name, kind, (machine_code, _) = super().serialize_using_object_code()
        entries = (each.name for each in self.get_defined_functions() if each.linkage == Linkage.external)
        names = "\n".join(f'define void @"{each}"() {{ unreachable }}' for each in entries)
        return name, kind, (machine_code, parse_assembly(names).as_bitcode())

    def add_linking_library(self, library: Any) -> None:
        if library not in self._linking_libraries:
            super().add_linking_library(library)
            for inner in library._linking_libraries if isinstance(library, _Part) else ():
                self.add_linking_library(inner)


class _Part(_Whole):
    """Code of a function that is no kernel: waits for the kernels that call it."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    @property
    def codegen(self) -> Any:
        return _NoEnvironment


class _NoEnvironment:
    """Of Python objects: code that is not called from Python has none."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        pass


class _WholeCompiler(Compiler):
    library: type[_Whole] = _Whole

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = self.library(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


class _PartCompiler(_WholeCompiler):
    library = _Part


class _Kept(IndexDataCacheFile):
    """Which machine code of a kernel is kept for which arguments."""

    def _load_index(self) -> dict[Any, str]:
        """None where another version kept it, whose types may be no more: numba would end with an error."""
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}


def kernel(function: _F) -> _F:
    """A function that Python calls: compiled at the first call, its machine code kept beside the module.

    Arguments are float64 arrays, contiguous in C's order, numbers, and named tuples of them. Threads may run it: the
    interpreter's lock is released. The plain function stays as `py_func`.
    """
    made = _compiled(function, pipeline_class=_WholeCompiler)
    if made is function:
        return function
    # what calls it is compiled with its own copy of it
    within = cache(lambda: compiled(function))
    made.get_call_template = lambda args, kws: cast(Any, within()).get_call_template(args, kws)
    made.get_overload = lambda signature: cast(Any, within()).get_overload(signature)
    # what is made for one kernel is kept with that kernel's code
    if "<locals>" not in function.__qualname__ and _kept(made):
        # numba compares the function's own file alone: after a change in a function that it calls, old code would run
        files = made._cache
        files._cache_file = _Kept(files.cache_path, files._impl.filename_base, made.stamp)
    return cast(_F, made)


def compiled(function: _F) -> _F:
    """A function that kernels call: compiled with them. Its arguments may be records, too."""
    return cast(_F, _compiled(function, pipeline_class=_PartCompiler, no_cpython_wrapper=True))


def _compiled(function: Callable[..., Any], **options: Any) -> Any:
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    njit: Any = numba.njit
    made = njit(nogil=True, error_model="numpy", fastmath=_FAST, no_cfunc_wrapper=True, **options)(function)
    made.stamp = _stamp(function)
    resolved = made.get_call_template
    # constants that one function hands to another are numbers like all others, not a reason to compile it once more
    made.get_call_template = lambda args, kws: resolved(
        tuple(map(types.unliteral, args)), {name: types.unliteral(kind) for name, kind in kws.items()}
    )
    return made


@dataclass_transform()
def record(declared: type[_T]) -> type[_T]:
    """A class of arrays and numbers that compiled functions make by calling it and pass on by reference.

    A named tuple would be passed field by field, and its functions take minutes to compile. `declared` is a class with
    annotations, or a named tuple: then the record is made of one by `Record(*values)`.
    """
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return declared if issubclass(declared, tuple) else dataclass(eq=False)(declared)
    module = sys.modules[declared.__module__]
    kind = type(f"{declared.__name__}Type", (types.StructRef,), {"__module__": module.__name__})
    setattr(module, kind.__name__, kind)  # the cache finds it there
    structref.register(kind)
    names = {"__module__": module.__name__, "__doc__": declared.__doc__}
    made = type(declared.__name__, (structref.StructRefProxy,), names)
    structref.define_proxy(made, kind, list(declared.__annotations__))
    return cast(type[_T], made)


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(work: Callable[[int, int], None], count: int, jobs: int) -> None:
    """Call `work(begin, end)` on pieces of a range in so many threads."""
    if jobs <= 1 or count <= _PIECE:
        work(0, count)
        return
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(lambda begin: work(begin, min(begin + _PIECE, count)), range(0, count, _PIECE)))


def _kept(compiled: Any) -> bool:
    """Keep its machine code beside the module or in the user's cache. False where neither can be written."""
    try:
        compiled.enable_caching()
    except RuntimeError:
        _say_once()
        return False
    return True


@cache
def _say_compiling() -> None:
    """Once in a process, to whoever waits at a terminal."""
    if sys.stderr is not None and sys.stderr.isatty():
        say("compiling the inner loops, once after an installation or an update: up to some minutes")


@cache
def _say_once() -> None:
    say(
        "nothing can be kept beside the program or in the user's cache: its inner loops are compiled again at every "
        "start, half a minute in all; set NUMBA_CACHE_DIR to a folder that you may write to"
    )


def _stamp(function: Callable[..., Any]) -> tuple[Any, ...]:
    """What the compiled code depends on: its file, the compiled functions, numbers and arrays that its module knows."""
    file = os.stat(inspect.getfile(function))
    own = function.__module__
    used: list[Any] = []
    for name, value in sorted(function.__globals__.items()):
        if isinstance(value, int | float):
            used.append((name, value))
        elif isinstance(value, np.ndarray):
            used.append((name, zlib.crc32(value.tobytes())))
        elif getattr(value, "stamp", None) and value.__module__ != own:
            used.append((name, zlib.crc32(repr(value.stamp).encode())))
    return _OWN, file.st_mtime, file.st_size, *used
