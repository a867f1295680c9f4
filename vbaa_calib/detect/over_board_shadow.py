"""The shadow that an antenna throws on the board beside it."""

from __future__ import annotations

import numpy as np

from .over_board_profile import Profiles

BESIDE = 2.5
"""How much wider than usual the profiles are cut to look for a shadow."""
_STRETCHES, _LEAST_WHITE = 6, 4
_WHITE, _FLAT = 0.9, 0.05


def darkest_beside(cut: Profiles, core_px: float) -> float:
    """How much darker white print is, in units of the print, along the darkest band beside a line.

    The middle one of a few stretches: the shadow of a sagging antenna is not parallel to it. `core_px` is how far the
    line itself reaches to either side.
    """
    known = np.isfinite(cut.noise) & (cut.slope < _FLAT) & (cut.behind > _WHITE) & (np.abs(cut.across) > core_px)
    column = np.round(cut.across).astype(int)
    depths = []
    for stretch in np.array_split(np.arange(len(cut.stretch)), _STRETCHES):
        white = known[stretch]
        place, dimmed = column[stretch][white], (cut.behind - cut.seen)[stretch][white]
        if len(place):
            count = np.bincount(place - place.min())
            means = np.bincount(place - place.min(), dimmed) / np.maximum(count, 1)
            depths.append(float(means[count >= _LEAST_WHITE].max(initial=0.0)))
    return float(np.median(depths)) if depths else 0.0
