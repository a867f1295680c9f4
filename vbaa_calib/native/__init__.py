"""The compiled core: inner loops of lens, shapes, fit, detector, calibration and simulator in C++ (README.md here).

`core` is the build for this processor: `base` (x86-64-v2, or any ARM), `v3` (AVX2) or `v4` (AVX-512). The variable
VBAA_PROCESSOR names a lower one, or `sanitized` (`make sanitize`). Its functions take contiguous float64 arrays, check
kinds and axes, and run without the interpreter's lock.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any


def _levels() -> tuple[str, ...]:
    """The builds that exist and that this processor can run, the best one last."""
    every = ("base", "v3", "v4")
    runs = every[: 1 + every.index(import_module(f"{__name__}.processor").LEVEL)]
    return tuple(level for level in runs if os.path.isdir(os.path.join(__path__[0], level)))


def _core() -> Any:
    level = os.environ.get("VBAA_PROCESSOR", (levels or ("base",))[-1])
    if level not in (*levels, "sanitized", "base"):
        sys.exit(f"VBAA_PROCESSOR={level}: there is {', '.join(levels)} for this processor; unset it")
    return import_module(f"{__name__}.{level}.core")


try:
    levels = _levels()
    core: Any = _core()
except ModuleNotFoundError as error:
    raise ImportError(
        "the compiled core of vbaa-calib is not built for this Python and processor: run `make install` in a checkout, "
        "or `pip install .`"
    ) from error
