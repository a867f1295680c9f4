"""What tells the antenna from its surroundings: brighter, darker or of another colour, as the no-load pictures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import cv2
import numpy as np

from vbaa_calib.core import smooth
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths, beside, resample
from vbaa_calib.core.robust import MAD_SCALE

from .acceptance import LEAST_SEEN
from .centreline import Centreline, Visibility
from .corridor import Corridor
from .finder import AntennaFinder
from .profile import SHARED_RUN, measure, measure_on

PLACES, RUN, LEAST_POINTS = 8, 15, 20
"""Places along the antenna at which its colour is learnt, points averaged for a colour, and the fewest points that tell
how brightly it is lit."""
FOREIGN, MOSTLY_FOREIGN, PARTLY_FOREIGN, LEAST_SPREAD = 4.0, 2.5, 1.0, (0.08, 3.0)
"""Deviations from the usual colour beyond which a point is no antenna; beyond which, in the median, the whole line is
none; and beyond which a point may show something else in part. The least deviation, relative to the brightness and in
grey levels, since the light changes as the antenna bends."""
SHOWN = ("ok", "ambiguous")
"""Verdicts of lines that are seen."""
COLOUR_PULLED = 0.05
"""By which part of its width the light on one side of an antenna may pull the line that is seen by its colour."""
LESS_SEEN = 0.05
"""What less of a line may be seen where it is measured by both of its edges."""
SHADE, SHADED_UNSURE, TINT = (0.33, 1.15), 0.3, (0.9, 2.0)
"""Limits of its brightness, over that in the light, where an antenna may lie in a shadow; part of its width to
which it must be known where it lies there, or else it may be the edge of that; and a quantile of how far its hue is off
in the light, and how many times that it may be off in a shadow."""
HIDDEN_PART, AWAY = 0.15, 0.25
"""Part of its width by which a line may lie off where it shows something else in part; and part of its length for which
one of changing polarity lies on another thing and does not come back."""
ROOT, LIGHT = 0.4, (0.6, 1.7)
"""Share of the line, from the clamp, that tells how brightly it is lit; limits of that factor."""
BEGINNING, LEAST_BEGINNING, KNOWN_LIGHT, LAMP = (0.015, 0.1), 5, (0.4, 2.5), 0.3
"""Shares of its length between which a free and a bent antenna lie in one place, and tell how brightly it is lit before
it is found, by so many pixels at least; limits of that factor, and the relative deviation that it has beforehand: a
highlight there is no lamp."""
_GREY_BGR = (0.114, 0.587, 0.299)
"""Weights of the channels in a grey level."""


@dataclass(frozen=True)
class Paint:
    """How a picture is turned into one plane on which the antenna stands out.

    Attributes
    ----------
    bright : on that plane the antenna is brighter than its surroundings; None: here brighter, there darker.
    weights : (b, g, r) of a colour picture's channels; None for its grey level.
    colour : (b, g, r) of the antenna: the plane is then the negative distance of a pixel from it. It is linear in how
        much of the pixel the antenna covers, so that edges stay where they are.
    both_edges : light from one side pulls the line that is seen there, which is measured by both of its edges.
    """

    bright: bool | None = True
    weights: tuple[float, float, float] | None = None
    colour: tuple[float, float, float] | None = None
    both_edges: bool = False

    @property
    def polarity(self) -> bool | None:
        """`bright`, but None where the line is measured by both of its edges, which may be of either polarity."""
        return None if self.both_edges else self.bright

    def plane(self, image: np.ndarray) -> np.ndarray:
        """(H, W) of a grey (H, W) or colour (H, W, 3 or 4) picture: blue, green, red, any depth."""
        if image.ndim == 2:
            return image
        colour = np.ascontiguousarray(image[..., :3])
        if self.colour is not None:
            apart = colour.astype(np.float32) - np.array(self.colour, np.float32)
            return -cv2.sqrt(cv2.transform(apart * apart, np.ones((1, 3), np.float32)))
        if self.weights is None:
            return cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        return cv2.transform(colour.astype(np.float32), np.array([self.weights], np.float32))

    def find(self, finder: AntennaFinder, image: np.ndarray, plane: np.ndarray | None = None) -> Centreline:
        """The centreline in a grey or colour picture, whose `plane` may be known; by both of its edges, here brighter,
        there darker, where an antenna is not found by its own colour. On a calibrated rig one measured by both of its
        edges is looked for by these; before, it is looked for by its polarity."""
        plane = self.plane(image) if plane is None else plane
        calibrated = finder.corridor.shape_px is not None
        line = finder.find(plane, self.polarity if calibrated else self.bright)
        if not line.found and self.colour is not None:
            by_edges = finder.unlit().with_usual_height(0.0).find(Paint(None).plane(image), None)
            return by_edges if by_edges.verdict in SHOWN else line
        if not line.found or not self.both_edges or calibrated:
            return line
        between = measure_on(plane, line.guide_px, finder.corridor.width_px, None)
        return between if between.found and between.seen > line.seen - LESS_SEEN else line

    def by_edges(self, image: np.ndarray, line: Centreline, guide_px: np.ndarray, width_px: float) -> Centreline:
        """The centreline in a picture, measured near a guide (K, 2) by both of the antenna's edges where its own colour
        shows less of it, or shows less well where it is.

        The colour tells the antenna from other things better than where it is: one side of bare metal may be as bright
        as what lies behind it, which pulls the line to the other.
        """
        if self.colour is None:
            return line
        edges = measure(Paint(None).plane(image), guide_px, width_px, None)
        if not edges.found or edges.seen <= line.seen:
            return line
        if not len(line.points_px):
            return edges
        near, aside = beside(line.points_px, edges.points_px)
        apart = np.linalg.norm(line.points_px[near] - edges.points_px, axis=1)
        both = (apart < width_px) & (apart**2 - aside**2 < 1.0)
        pulled = COLOUR_PULLED * width_px
        effective = np.hypot(line.effective_px, pulled * np.sqrt(SHARED_RUN))[near]
        better = both & (effective < edges.effective_px)
        return replace(
            edges,
            points_px=np.where(better[:, None], line.points_px[near], edges.points_px),
            sigma_px=np.where(better, np.hypot(line.sigma_px, pulled)[near], edges.sigma_px),
            effective_px=np.where(better, effective, edges.effective_px),
        )


def _levels(image: np.ndarray) -> tuple[np.ndarray, float]:
    """A picture (H, W[, 3]) as (H, W, 1 or more), and how many of its levels are one of 8 bits."""
    return image if image.ndim == 3 else image[..., None], 257.0 if image.dtype == np.uint16 else 1.0


@kernel
def _colours(image: np.ndarray, level: float, points: np.ndarray) -> np.ndarray:
    """(N, 3) colours of a picture (H, W, 1 or more) at the pixels nearest to points (N, 2), grey levels of 8 bits, of
    which one is so many of its own; grey is three times one."""
    found, last = np.empty((len(points), 3)), image.shape[2] - 1
    for n in range(len(points)):
        column = min(max(int(np.rint(points[n, 0])), 0), image.shape[1] - 1)
        row = min(max(int(np.rint(points[n, 1])), 0), image.shape[0] - 1)
        for c in range(3):
            found[n, c] = image[row, column, min(c, last)] / level
    return found


Looks = tuple[tuple[float, float, float, float], ...]
"""(PLACES, 4) mean colour at places from clamp to tip, and its deviation, grey levels."""


def look_of(image: np.ndarray, line: Centreline) -> np.ndarray:
    """(PLACES, 3) mean colour of a found antenna along its guide, in a picture (H, W[, 3]); NaN where unseen."""
    place = np.minimum((_shares(line.guide_px, _seen(line)) * PLACES).astype(int), PLACES - 1)
    colours = _colours(*_levels(image), line.points_px)
    means = np.full((PLACES, 3), np.nan)
    for own in np.unique(place):
        means[own] = colours[place == own].mean(axis=0)
    return means


def usual_looks(several: Sequence[np.ndarray]) -> Looks | None:
    """Median colours and deviations of (PLACES, 3) in several pictures; None if a place is not seen in two of them."""
    looks = np.array([one for one in several if len(one)])
    if len(looks) < 2 or (np.isfinite(looks).all(axis=2).sum(axis=0) < 2).any():
        return None
    usual = np.nanmedian(looks, axis=0)
    apart = np.linalg.norm(looks - usual, axis=2)
    least = np.hypot(LEAST_SPREAD[0] * np.linalg.norm(usual, axis=1), LEAST_SPREAD[1])
    spread = np.hypot(MAD_SCALE * np.nanmedian(apart, axis=0), least)
    return cast(Looks, tuple(map(tuple, np.column_stack([usual, spread]).tolist())))


def usual_levels(image: np.ndarray, where: Corridor, looks: Looks | None, paint: Paint) -> np.ndarray:
    """(PLACES, 2) how bright the antenna is on the plane of its paint, and the deviation of that, in the light of a
    picture (H, W[, 3]); (0, 2) where that is not known: where its clamp may lie more than a width off, or outside the
    picture, or the light there is very strong or weak.
    """
    table, coloured = (np.empty((0, 4)), False) if looks is None else _table(looks)
    if not len(table) or (image.ndim == 2 and coloured) or where.clamp_px > where.width_px:
        return table[:0, :2]
    pixels, level = _levels(image)
    light, unsure = _light(pixels, level, *resample(where.axis_px, 1.0), table)
    if not KNOWN_LIGHT[0] < light < KNOWN_LIGHT[1]:
        return table[:0, :2]
    now = (level * light * table).astype(np.float32)
    spread = np.hypot(now[:, 3], unsure / light * np.linalg.norm(now[:, :3], axis=1))
    if image.ndim == 2:
        return np.column_stack([now[:, :3].mean(axis=1), spread]).astype(np.float64)
    weight = 1.0 if paint.colour is not None else np.linalg.norm(paint.weights or _GREY_BGR)
    return np.column_stack([paint.plane(now[:, None, :3]).ravel(), weight * spread]).astype(np.float64)


@kernel
def _light(
    image: np.ndarray, level: float, axis: np.ndarray, along: np.ndarray, looks: np.ndarray
) -> tuple[float, float]:
    """How brightly an antenna of looks (PLACES, 4) is lit, over usual, in a picture, see `_colours`, as its axis (K, 2)
    shows near the clamp, (K,) px from there; and the deviation of that. NaN where little of that is in the picture."""
    share, places = along / along[-1], (np.arange(PLACES) + 0.5) / PLACES
    inside = (axis[:, 0] > 0.0) & (axis[:, 1] > 0.0) & (axis[:, 0] < image.shape[1]) & (axis[:, 1] < image.shape[0])
    first = np.flatnonzero(inside & (share > BEGINNING[0]) & (share < BEGINNING[1]))
    if len(first) < LEAST_BEGINNING:
        return np.nan, np.nan
    colours, usual = _colours(image, level, axis[first]), np.empty((4, len(first)))
    for c in range(4):
        usual[c] = np.interp(share[first], places, looks[:, c].copy())
    lit, size = np.zeros(len(first)), np.full(len(first), 1e-9)
    for c in range(3):
        lit, size = lit + colours[:, c] * usual[c], size + usual[c] ** 2
    unsure = np.median(usual[3] / np.sqrt(size))
    trust = LAMP**2 / (LAMP**2 + unsure**2)
    light = np.median(lit / size) ** trust
    return light, light * unsure * np.sqrt(trust)


def without_other_things(
    image: np.ndarray, line: Centreline, looks: Looks | None, width_px: float, paint: Paint
) -> Centreline:
    """The centreline in a picture (H, W[, 3]) without stretches that do not look like an antenna of this width.

    Where the antenna is hidden a line that goes on along an object's edge has not its colour. Where it is hidden in
    part, a line of one polarity is the middle of what is left: what the colour leaves open is added to the deviations,
    alike for all points concerned. The light may be stronger or weaker in all than it was.

    Both edges show in a shadow as well. What throws it may hide the antenna in part: it must be of the line's own hue
    there, or come out of the shadow again; the last of it is left out.
    """
    if looks is None or not line.found:
        return line
    table, coloured = _table(looks)
    if image.ndim == 2 and coloured:
        return line  # a grey picture does not show the colour
    shares, other, off, hue, tinted = _foreign(*_levels(image), line.points_px, line.guide_px, _seen(line), table)
    if not other.any() and off.max(initial=0.0) <= PARTLY_FOREIGN:
        return line
    changing, sure = paint.bright is None, line.sigma_px <= SHADED_UNSURE * width_px
    # a grey camera's pictures may have three channels, too
    hued = (paint.both_edges or changing) and image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())
    shaded, away = other & sure & ~tinted & hued, len(other)
    for start, stop in np.flatnonzero(np.diff(other, prepend=False, append=False)).reshape(-1, 2):
        if changing and shares[stop - 1] - shares[start] > AWAY and shaded[start:stop].mean() < 0.5:
            away = start
            break
    if not other[:away].all():
        last = np.flatnonzero(sure & (shaded | (off < MOSTLY_FOREIGN)))[-1:]
        other &= ((hue > MOSTLY_FOREIGN) | ~sure | (not paint.both_edges)) & ~shaded
        if line.end != "tip" and len(last) and (paint.both_edges or shaded[last[0]]):
            other[max(last[0] + 1 - RUN * shaded[last[0]], 0) :] = True
    other[away:] = True
    hidden = 0.0 if paint.polarity is None else HIDDEN_PART * width_px
    doubt = hidden * np.clip((off - PARTLY_FOREIGN) / (FOREIGN - PARTLY_FOREIGN), 0.0, 1.0)
    shorter = line.only(~other).doubted(doubt[~other])
    if shorter.seen < LEAST_SEEN:
        share_seen = f"{100 * shorter.seen:.0f} % of its length"
        return shorter.with_verdict("too_little", f"most of the line has not the antenna's look ({share_seen} has)")
    return shorter


@lru_cache(maxsize=64)
def _table(looks: Looks) -> tuple[np.ndarray, bool]:
    """Looks as an array (PLACES, 4), and whether they are of a colour."""
    table = np.array(looks)
    return table, bool(np.ptp(table[:, :3], axis=1).max() > LEAST_SPREAD[1])


@kernel
def _foreign(
    image: np.ndarray, level: float, points: np.ndarray, guide: np.ndarray, seen: np.ndarray, looks: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Shares (N,) of its length at which the points (N, 2) of a line lie, see `_shares`; which of them have not the
    looks (PLACES, 4) in a picture, see `_colours`: (N,) bool; how far off these their colours are, (N,) deviations;
    how far those that may lie in a shadow, (N,); and which of them have another hue than that of the line in the light,
    (N,) bool."""
    colours, shares = _colours(image, level, points), _shares(guide, seen)
    count, places = len(shares), (np.arange(PLACES) + 0.5) / PLACES
    usual = np.empty((4, count))
    for c in range(4):
        usual[c] = np.interp(shares, places, looks[:, c].copy())
    root, near = np.empty(count), 0
    for n in range(count):
        if shares[n] < ROOT:
            across, own = 0.0, 1e-9
            for c in range(3):
                across, own = across + colours[n, c] * usual[c, n], own + usual[c, n] ** 2
            root[near], near = across / own, near + 1
    light = 1.0 if near < LEAST_POINTS else min(max(np.median(root[:near]), LIGHT[0]), LIGHT[1])
    off, hue, lit, means = np.zeros(count), np.zeros(count), np.zeros(count), np.empty((3, count))
    for c in range(3):
        off += smooth.running_mean(colours[:, c] - light * usual[c], RUN, smooth.END_VALUE) ** 2
        means[c] = smooth.running_mean(colours[:, c].copy(), RUN, smooth.END_VALUE)
        lit += means[c] * usual[c]
    off = np.sqrt(off) / (light * usual[3])
    squares = np.maximum((usual[:3] ** 2).sum(axis=0), 1e-9)
    local = np.minimum(np.maximum(lit / squares, SHADE[0] * light), SHADE[1] * light)
    for c in range(3):
        hue += (means[c] - local * usual[c]) ** 2
    # what noise there is counts more where it is darker
    tint = np.sqrt(hue / (squares * local * light))
    hue = np.sqrt(hue) / (local * usual[3])
    alike = tint[off < MOSTLY_FOREIGN]
    tinted = np.full(count, True)
    if len(alike) > LEAST_POINTS:
        tinted = tint > TINT[1] * smooth.quantile(alike, TINT[0])
    other = np.full(count, np.median(off) > MOSTLY_FOREIGN)
    for n in range(count):
        if off[n] > FOREIGN:
            # a run's mean blends what lies before and after its middle
            other[max(n - RUN // 2, 0) : n + RUN // 2 + 1] = True
    return shares, other, off, hue, tinted


@kernel
def _shares(guide: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(N,) how far along their guide (K, 2) the points lie that were seen (K,) of it, from 0 at the clamp to 1."""
    along = arc_lengths(guide)
    return along[seen] / max(along[-1], 1e-9)


def _seen(line: Centreline) -> np.ndarray:
    """(K,) where along its guide a line has its points."""
    return line.visibility == Visibility.SEEN
