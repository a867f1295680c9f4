"""Calibration and camera geometry for the 3D vision-based active antenna."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .calibrate.from_corners import calibrate_lens
    from .camera import Camera
    from .rig import Rig

__version__ = "0.2.0"
__all__ = ["Camera", "Rig", "__version__", "calibrate_lens"]

_HOMES = {"Camera": ".camera", "Rig": ".rig", "calibrate_lens": ".calibrate.from_corners"}


def __getattr__(name: str) -> Any:
    """Load a public name on first use, so that `vbaa --help` need not wait for NumPy."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name], __name__), name)
