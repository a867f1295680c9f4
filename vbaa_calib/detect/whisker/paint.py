"""The antenna's paint: what distinguishes it from its surroundings (brighter, darker, another colour), as learnt
from no-load pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np

from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.core.robust import MAD_SCALE
from vbaa_calib.native import core

from .centreline import Centreline
from .finder import AntennaFinder, coloured
from .profile import measure_between
from .settings import AcceptanceSettings, LookSettings

PLACES = 8
"""Places along the antenna at which its colour is learnt."""
VISIBLE = ("ok", "ambiguous")
"""Verdicts of lines that are seen."""


@dataclass(frozen=True)
class Paint:
    """Conversion of a picture into one plane on which the antenna stands out.

    Attributes
    ----------
    bright : on that plane the antenna is brighter than its surroundings; None: here brighter, there darker.
    both_edges : whether the line is measured by both of its edges, since light from one side displaces its middle.
    """

    bright: bool | None = True
    both_edges: bool = False

    @property
    def polarity(self) -> bool | None:
        """`bright`; None where the line is measured by both of its edges, which may be of either polarity."""
        return None if self.both_edges else self.bright

    def plane(self, image: np.ndarray) -> np.ndarray:
        """(H, W) plane of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
        return _grey(image)

    def find(self, finder: AntennaFinder, image: np.ndarray, plane: np.ndarray | None = None) -> Centreline:
        """The centreline in a grey or colour picture; `plane` : its plane of paint, if known. An antenna that is
        measured by both edges is searched by these on a calibrated rig, before that by its polarity."""
        plane = self.plane(image) if plane is None else plane
        calibrated = finder.corridor.shape_px is not None
        line = finder.find(plane, self.polarity if calibrated else self.bright, image)
        if not line.found or not self.both_edges or calibrated:
            return line
        between = measure_between(image if coloured(image) else plane, line, finder.corridor.width_px)
        return between if between.found else line


Looks = tuple[tuple[float, float, float, float], ...]
"""(PLACES, 4) mean colour at places from clamp to tip, and its deviation, grey levels."""


def look_of(image: np.ndarray, line: Centreline) -> np.ndarray:
    """(PLACES, 3) mean colours of a detected antenna along its guide, in a picture (H, W[, 3]); NaN where unseen."""
    place = np.minimum((_shares(line.guide_px, line.measured) * PLACES).astype(int), PLACES - 1)
    colours = core.search.colours_at(*_channels(image), line.points_px)
    means = np.full((PLACES, 3), np.nan)
    for own in np.unique(place):
        means[own] = colours[place == own].mean(axis=0)
    return means


def usual_looks(several: Sequence[np.ndarray]) -> Looks | None:
    """Medians and standard deviations of the colours (PLACES, 3) in several pictures; None if a place is not seen in
    two of them."""
    looks = np.array([one for one in several if len(one)])
    if len(looks) < 2 or (np.isfinite(looks).all(axis=2).sum(axis=0) < 2).any():
        return None
    usual = np.nanmedian(looks, axis=0)
    apart = np.linalg.norm(looks - usual, axis=2)
    least = np.hypot(LookSettings.least_spread * np.linalg.norm(usual, axis=1), LookSettings.least_spread_levels)
    spread = np.hypot(MAD_SCALE * np.nanmedian(apart, axis=0), least)
    return cast(Looks, tuple(map(tuple, np.column_stack([usual, spread]).tolist())))


def without_other_things(
    image: np.ndarray, line: Centreline, looks: Looks | None, width_px: float, paint: Paint
) -> Centreline:
    """The centreline in a picture (H, W[, 3]) without stretches that do not look like an antenna of this width.

    A line that goes on along an object's edge where the antenna is hidden differs in colour. Where the antenna is
    hidden in part, a line of one polarity is the middle of the visible part: the error that the colour allows is added
    to the standard deviations, as one that all points concerned share. The light as a whole may have become stronger or
    weaker.

    Both edges are visible in a shadow, too, but the thing that casts it may hide the antenna in part: there the line
    must have the antenna's own hue, or leave the shadow again; its last stretch in the shadow is left out.
    """
    if looks is None or not line.found:
        return line
    table, has_hue = _table(looks)
    if image.ndim == 2 and has_hue:
        return line  # a grey picture does not show the colour
    shares = _shares(line.guide_px, line.measured)
    other, off, hue, tinted = core.search.foreign(*_channels(image), line.points_px, shares, table)
    if not other.any() and off.max(initial=0.0) <= LookSettings.partly_foreign:
        return line
    changing, sure = paint.bright is None, line.sigma_px <= LookSettings.shaded_unsure * width_px
    hued = (paint.both_edges or changing) and coloured(image)
    shaded = other & sure & ~tinted & hued
    if not other.all():
        last = np.flatnonzero(sure & (shaded | (off < core.search.MOSTLY_FOREIGN)))[-1:]
        other &= ((hue > core.search.MOSTLY_FOREIGN) | ~sure | (not paint.both_edges)) & ~shaded
        if line.end != "tip" and len(last) and (paint.both_edges or shaded[last[0]]):
            other[max(last[0] + 1 - core.search.RUN * shaded[last[0]], 0) :] = True
    hidden = 0.0 if paint.polarity is None else LookSettings.hidden_part * width_px
    doubt = hidden * np.clip(
        (off - LookSettings.partly_foreign) / (core.search.FOREIGN - LookSettings.partly_foreign), 0.0, 1.0
    )
    if line.odds >= AcceptanceSettings.likely_odds:
        # what it shows there may be something else next to it or before a part of it, but it is there
        return line.doubted(np.where(other, LookSettings.strange_doubt * width_px, doubt))
    shorter = line.only(~other).doubted(doubt[~other])
    if shorter.seen < AcceptanceSettings.least_seen:
        share_seen = f"{100 * shorter.seen:.0f} % of its length"
        return shorter.with_verdict("too_little", f"most of the line has not the antenna's look ({share_seen} has)")
    return shorter


@lru_cache(maxsize=64)
def _table(looks: Looks) -> tuple[np.ndarray, bool]:
    """The mean colours and their deviations as an array (PLACES, 4), and whether any of them is chromatic."""
    table = np.array(looks)
    return table, bool(np.ptp(table[:, :3], axis=1).max() > LookSettings.least_spread_levels)


def _shares(guide: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(N,) positions, 0 at the clamp to 1, of the seen places (mask (K,)) along their guide (K, 2)."""
    along = arc_lengths(guide)
    return along[seen] / max(along[-1], 1e-9)


def _grey(image: np.ndarray) -> np.ndarray:
    """(H, W) grey levels of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
    if image.ndim == 2:
        return image
    import cv2  # slow to load

    return cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_BGR2GRAY)


def _channels(image: np.ndarray) -> tuple[np.ndarray, float]:
    """A picture (H, W[, 3]) as (H, W, 1 or more), and the number of its grey levels that make one of 8 bits."""
    return image if image.ndim == 3 else image[..., None], 257.0 if image.dtype == np.uint16 else 1.0
