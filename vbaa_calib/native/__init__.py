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

_LEVELS = ("base", "v3", "v4")


def _core() -> Any:
    try:
        best = _LEVELS.index(import_module(f"{__name__}.processor").LEVEL)
        asked = os.environ.get("VBAA_PROCESSOR", _LEVELS[best])
        if asked not in (*_LEVELS[: best + 1], "sanitized"):
            sys.exit(f"VBAA_PROCESSOR={asked}: this processor runs {', '.join(_LEVELS[: best + 1])}; unset it")
        return import_module(f"{__name__}.{asked}.core")
    except ModuleNotFoundError as error:
        raise ImportError(
            "the compiled core of vbaa-calib is not built for this Python: run `make install` in a checkout, "
            "or `pip install .`"
        ) from error


core: Any = _core()
