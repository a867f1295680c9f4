"""Path refinement: the best place across a rough path, column by column, and a smooth curve through these."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vbaa_calib.native import core

CURVE_POINTS, CURVE_STEP_PX, CLAMP_PX = core.search.CURVE_POINTS, core.search.CURVE_STEP_PX, 8.0
"""Points and spacing of the curves that are tried, and how far off they may begin at most."""


class Known(NamedTuple):
    """What is known of an antenna that is looked for along a path.

    Attributes
    ----------
    clamp_px : how far off the path it may begin.
    levels : (L, 2) its usual brightness at places from clamp to tip and the deviation of that, grey levels; (0, 2)
        where not known.
    leaves_along : whether it leaves its clamp along the path: on a rig that is calibrated.
    stands_out : on a plane that was made for it: that it is bright where what lies behind it is says nothing there.
    """

    clamp_px: float = CLAMP_PX
    levels: np.ndarray = np.empty((0, 2))
    leaves_along: bool = False
    stands_out: bool = False


NOTHING_KNOWN = Known()
"""Of a rig that is not calibrated yet."""


class RefinedPath(NamedTuple):
    """A path that follows a ridge.

    Attributes
    ----------
    path_px : (K, 2).
    share : fraction of the path along which there is a ridge.
    strength : median height of the ridge where there is one, grey levels.
    other_px : (K, 2) another path, nearly as clear, that leaves this one; (0, 2) where there is none.
    clear : how clearly the antenna shows along it, where the polarity changes.
    """

    path_px: np.ndarray
    share: float
    strength: float
    other_px: np.ndarray
    clear: float


def refine_path(
    image: np.ndarray,
    path_px: np.ndarray,
    width_px: float,
    reach_px: float,
    bright: bool | None,
    known: Known = NOTHING_KNOWN,
) -> RefinedPath:
    """Move a path (K, 2) by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    if bright is None:
        tried = _tried(int(np.ceil(reach_px)), min(known.clamp_px, CLAMP_PX), known.leaves_along)
        return RefinedPath(*core.search.refine_changing_path(image, path_px, width_px, tried, known.levels))
    return RefinedPath(*core.search.refine_path(image, path_px, width_px, reach_px, 1.0 if bright else -1.0))


@lru_cache(maxsize=8)
def _tried(reach: int, clamp_px: float, leaves_along: bool) -> Any:
    """The curves that are tried within ±`reach` px, and ±`clamp_px` at the clamp, which they may leave along zero."""
    curves, bent = _curves(float(reach), clamp_px, leaves_along)
    finer = 0.5 * _curves(2.0 * CURVE_STEP_PX, 2.0 * CURVE_STEP_PX, leaves_along)[0]
    return core.search.Curves(reach, curves, bent, finer)


def _curves(reach_px: float, clamp_px: float, leaves_along: bool, most: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """(C, CURVE_POINTS) smooth curves within ±`reach_px`, and ±`clamp_px` at the clamp, in at most so many steps to
    either side; how bent each (C,) is."""
    share = np.linspace(0.0, 1.0, CURVE_POINTS)
    bow = 4.0 * share * (1.0 - share)
    parts = np.stack([1.0 - share, share, bow, 2.6 * bow * (1.0 - 2.0 * share)])
    if leaves_along:
        bow = 1.7 * bow * share
        parts[1:] = share**2, bow, 1.5 * bow * (1.0 - 1.6 * share)
    reaches = np.array([min(clamp_px, reach_px), reach_px, 0.5 * reach_px, 0.25 * reach_px])
    step = max(CURVE_STEP_PX, reach_px / most)
    steps = [step * np.arange(-(far // step), far // step + 1) for far in reaches]
    places = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, len(parts))
    curves = places @ parts
    inside = np.abs(curves).max(axis=1) <= reach_px
    return curves[inside], ((places / reaches) ** 2).mean(axis=1)[inside]
