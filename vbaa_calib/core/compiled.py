"""Functions compiled by numba: the inner loops of estimator, detector, calibration and simulation."""

from __future__ import annotations

import inspect
import os
import zlib
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar, cast

import numba
import numpy as np

from .console import say

_F = TypeVar("_F", bound=Callable[..., Any])

_FAST = {"contract", "reassoc", "nsz", "arcp"}
"""Freedoms in the order of sums and products. NaN and infinity keep their meaning: they mark what is not known."""


def kernel(function: _F) -> _F:
    """Compile at the first call and keep the machine code beside the module. The plain function stays as `py_func`.

    Arguments are float64 arrays, contiguous in C's order, numbers, and named tuples of them. Threads may run it: the
    interpreter's lock is released.
    """
    # what is made for one kernel is kept with that kernel's code
    keep = "<locals>" not in function.__qualname__
    compiled: Any = numba.njit(nogil=True, error_model="numpy", fastmath=_FAST)(function)
    compiled.stamp = _stamp(function)
    if keep and _kept(compiled):
        # numba compares the function's own file alone: after a change in a function that it calls, old code would run
        compiled._cache._cache_file._source_stamp = compiled.stamp
    resolved = compiled.get_call_template
    # constants that one kernel hands to another are numbers like all others, not a reason to compile it once more
    compiled.get_call_template = lambda args, kws: resolved(
        tuple(map(numba.types.unliteral, args)), {name: numba.types.unliteral(kind) for name, kind in kws.items()}
    )
    return cast(_F, compiled)


def _kept(compiled: Any) -> bool:
    """Keep its machine code beside the module or in the user's cache. False where neither can be written."""
    try:
        compiled.enable_caching()
    except RuntimeError:
        _say_once()
        return False
    return True


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
    return file.st_mtime, file.st_size, *used
