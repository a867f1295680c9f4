"""Raw pixels across a path: one profile for every column (or row) of pixels that the path crosses."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from vbaa_calib.native import core

Crossings: TypeAlias = Any
"""`core.search.Crossings`: points (N, 2) px, along (N,) px, profiles (N, T) grey levels, inside (N,) the picture."""


def crossings(image: np.ndarray, path_px: np.ndarray, half: int, bright: bool | None) -> Crossings:
    """Profiles of 2·half + 1 pixels of an (H, W) picture across a path (K, 2); negative ones for a dark line."""
    return core.search.crossings(image, path_px, half, -1.0 if bright is False else 1.0)


def too_short(path_px: np.ndarray) -> bool:
    """Whether a path (K, 2) is too short for a line to be measured along it."""
    return len(path_px) < 2 or bool(np.hypot(*np.diff(path_px, axis=0).T).sum() < 8.0)
