"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

import numpy as np

from vbaa_calib.native import core


def refine_path(image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool) -> np.ndarray:
    """(K, 2) a path moved by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    found: np.ndarray = core.search.refine_path(image, path_px, width_px, reach_px, 1.0 if bright else -1.0)
    return found
