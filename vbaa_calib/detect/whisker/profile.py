"""Sub-pixel measurement of the antenna: its cross-section in the picture, fitted to raw profiles.

Profiles are the raw pixels of every column that it crosses (of every row where it is steeper than 45°), because
interpolated ones share their noise, and shift a thin line with its phase on the pixel grid.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from vbaa_calib.native import core

from .acceptance import Evidence, accepted
from .centreline import NOTHING, Centreline
from .crossings import too_short
from .locking import row_errors
from .settings import RibbonSettings


def refine_path(image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool) -> np.ndarray:
    """(K, 2) a path moved by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    found: np.ndarray = core.search.refine_path(image, path_px, width_px, reach_px, 1.0 if bright else -1.0)
    return found


_QUIET = 0.4
"""Quantile of the profiles' residuals that the core takes for the picture's noise."""
ORDINARY_BLUR_PX = 0.8
"""Blur of a lens in focus, standard deviation."""
_MARGIN_PX = 3.0
"""Length of a profile beyond an antenna whose polarity changes: what lies farther is another thing's."""
_BROADER = 1.5
"""A line so much broader than expected is measured again with longer profiles."""
_POLARITY = {True: 1, False: -1, None: 0}
_shapes = lru_cache(maxsize=32)(core.profile.shapes)


def measure(
    image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool | None = True, taper: float = 0.0
) -> Centreline:
    """The centreline near a guide, one point for every column (or row) of pixels that it crosses.

    Parameters
    ----------
    image : (H, W) grey levels.
    guide_px : (K, 2) a path within about one antenna width of the truth, from clamp to tip.
    width_px : the antenna's width, half way.
    bright : brighter than its background; None: here brighter, there darker.
    taper : part of that width by which it is broader at its tip than at its clamp.
    """
    if too_short(guide_px):
        return NOTHING
    if bright is not None:
        guide_px = refine_path(image, guide_px, width_px, width_px + 2.0, bright)
    return measure_on(image, guide_px, width_px, bright, taper=taper)


def measure_on(
    image: np.ndarray,
    path_px: np.ndarray,
    width_px: float,
    bright: bool | None,
    blurred_px: float = 0.0,
    taper: float = 0.0,
) -> Centreline:
    """Measure the centreline as `measure` does, along a path (K, 2) that lies on the antenna already.

    blurred_px : by how much broader the line may be.
    """
    half = int(np.ceil(0.8 * (width_px + blurred_px) + 5.0))
    path_px = np.ascontiguousarray(path_px, np.float64)
    if bright is None:
        path_px, half = core.profile.stiffened(path_px), int(np.ceil(0.5 * width_px + _MARGIN_PX))
    line = _measured(image, path_px, width_px, half, bright, taper)
    if line.breadth > _BROADER:
        half = int(np.ceil(half + 0.7 * line.breadth * width_px + 2.0))
        wider = _measured(image, path_px, width_px, half, bright, taper)
        return wider if len(wider.points_px) >= len(line.points_px) else line
    return line


def _measured(
    image: np.ndarray, path_px: np.ndarray, width_px: float, half: int, bright: bool | None, taper: float
) -> Centreline:
    width_px = round(float(width_px), 2)
    how = (width_px, half, _POLARITY[bright], taper, _quiet_part(2 * half - 3))
    shapes = _shapes(width_px, ORDINARY_BLUR_PX, half + 2)
    found = core.profile.measured(np.ascontiguousarray(image), path_px, *how, shapes)
    if found is None:
        return NOTHING
    line = Centreline(**found[0])
    more, evened = row_errors(image, line.points_px, line.sigma_px, line.noise, half)
    if evened is not None and (again := core.profile.measured(evened, path_px, *how, shapes)) is not None:
        found, line = again, Centreline(**again[0])
        more = np.full(len(line.points_px), np.median(more))
    return accepted(replace(line, row_px=more), Evidence(**found[1]))


def measure_in_colour(
    picture: np.ndarray, path_px: np.ndarray, width_px: float, settings: RibbonSettings | None = None
) -> Centreline:
    """The centreline along a path (K, 2) on the antenna in a colour picture (H, W, 3): a ribbon, brighter or darker
    than both backgrounds, with illumination that varies smoothly along it."""
    how = settings or RibbonSettings()
    half = int(np.ceil(how.flank_widths * width_px + how.flank_px))
    path_px = np.ascontiguousarray(path_px, np.float64)
    picture = np.ascontiguousarray(picture[..., :3])
    found = core.profile.measured_ribbon(picture, path_px, float(width_px), how.blur_px, half, how)
    if found is None:
        return NOTHING
    line = Centreline(**found[0])
    more, _ = row_errors(picture, line.points_px, line.sigma_px, line.noise, half)
    return accepted(replace(line, row_px=more), Evidence(**found[1]))


@lru_cache(maxsize=32)
def _quiet_part(freedom: int) -> float:
    """The `_QUIET` quantile of the root mean square of `freedom` normal numbers, by Newton's method.

    The probability is the series of the incomplete gamma function: what has SciPy's takes longer to load than a contact
    to find.
    """
    half = at = 0.5 * freedom
    for _ in range(8):  # to the last digit for profiles of any length
        terms = np.cumprod(at / (half + np.arange(1.0, 60.0 + 2.0 * freedom)))
        first = math.exp(half * math.log(at) - at - math.lgamma(half + 1.0))
        at -= (first * (1.0 + float(terms.sum())) - _QUIET) / (first * half / at)
    return math.sqrt(at / half)
