"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vbaa_calib.native import core


class RefinedPath(NamedTuple):
    """A path (K, 2) that follows a ridge; along which share of it there is a ridge, and its median height there, grey
    levels."""

    path_px: np.ndarray
    share: float
    strength: float


def refine_path(image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool) -> RefinedPath:
    """Move a path (K, 2) by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    return RefinedPath(*core.search.refine_path(image, path_px, width_px, reach_px, 1.0 if bright else -1.0))
