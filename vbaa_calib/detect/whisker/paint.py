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
from vbaa_calib.core.polyline import arc_lengths, normals, resample
from vbaa_calib.core.robust import MAD_SCALE

from .acceptance import LEAST_SEEN
from .centreline import Centreline, Visibility
from .corridor import Corridor, better_shaped
from .crossings import too_short
from .finder import AntennaFinder
from .path_refinement import Known
from .profile import measure_on

PLACES, RUN, LEAST_POINTS = 8, 15, 20
"""Places along the antenna at which its colour is learnt, points averaged for a colour, and the fewest points that tell
how brightly it is lit."""
FOREIGN, MOSTLY_FOREIGN, PARTLY_FOREIGN, LEAST_SPREAD = 4.0, 2.5, 1.0, (0.08, 3.0)
"""Deviations from the usual colour beyond which a point is no antenna; beyond which, in the median, the whole line is
none; and beyond which a point may show something else in part. The least deviation, relative to the brightness and in
grey levels, since the light changes as the antenna bends."""
SHOWN = ("ok", "ambiguous")
"""Verdicts of lines that are seen."""
_MEASURED = ("ok", "too_little")
"""Verdicts of lines that are measured in colour."""
OWN, FLANK_PX, ALIKE = np.array([-0.2, 0.0, 0.2]), np.array([1.5, 2.5]), 15
"""Where an antenna's own colour is looked at, parts of its width, and those beside it, px beyond its edges; so many
places along it, twice, are averaged."""
FAINT_CONTRAST, REACH_PX = 2.5, 10.0
"""With less contrast, grey levels in each channel, the plane is nearly grey; how far beside the antenna it is weighted.
"""
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

    def in_colour(self, image: np.ndarray, line: Centreline, where: Corridor, width_px: float) -> Centreline:
        """The better shaped of two: a centreline in a picture (H, W[, 3]), and the same measured in its colours.

        One plane for the whole picture tells the antenna from other things better than where it is: here or there one
        of its sides is as bright on it as what lies behind, which pulls the line to the other. Only a calibrated rig
        knows the shape that is measured along.
        """
        told = self.polarity is None or self.colour is not None
        if not told or where.shape_px is None or line.verdict not in _MEASURED or not _coloured(image):
            return line
        guide = where.nearest(line.points_px, line.sigma_px)
        if too_short(guide):
            return line
        plane = contrast_plane(image, guide, width_px)
        other = measure_on(plane, guide, width_px, None, known=Known(stands_out=True))
        return better_shaped(line, replace(other, familiar=line.familiar), where)


def _coloured(image: np.ndarray) -> bool:
    """Whether a picture (H, W[, 3]) has colours: a grey camera's may have three channels, too."""
    return image.ndim == 3 and bool(np.ptp(image[::8, ::8, :3], axis=2).any())


def contrast_plane(image: np.ndarray, path_px: np.ndarray, width_px: float) -> np.ndarray:
    """(H, W) grey levels of a colour picture (H, W, 3) in which an antenna along a path (K, 2), K ≥ 2, stands out.

    Near it the channels are weighted so that it is brighter than what lies on either side, by as much as can be at that
    place, where it has a contrast at all; farther off it is the grey picture.
    """
    points, _ = resample(path_px, 1.0)
    across, (colours, level) = normals(points), _levels(image)
    own, left, right = (
        np.mean([_colours(colours, level, points + offset * across) for offset in offsets], axis=0)
        for offsets in (OWN * width_px, -0.5 * width_px - FLANK_PX, 0.5 * width_px + FLANK_PX)
    )
    # the smaller one of two contrasts is largest along the point nearest to none on the line between them
    contrast, apart = _along_it(own - left), _along_it(left - right)
    share = -(contrast * apart).sum(axis=1) / np.maximum((apart**2).sum(axis=1), 1e-9)
    contrast += np.clip(share, 0.0, 1.0)[:, None] * apart
    contrast += FAINT_CONTRAST * np.where(contrast.sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    # of as much noise as the mean of the channels
    weights = contrast / (np.sqrt(3.0) * np.linalg.norm(contrast, axis=1)[:, None])
    plane = Paint(None).plane(image).astype(np.float32)
    _weigh(colours, plane, points, weights, int(np.ceil(width_px + REACH_PX)))
    return plane


def _along_it(colours: np.ndarray) -> np.ndarray:
    """(K, 3) means of neighbouring colours."""
    return cv2.blur(cv2.blur(colours, (1, ALIKE)), (1, ALIKE))


@kernel
def _weigh(image: np.ndarray, plane: np.ndarray, points: np.ndarray, weights: np.ndarray, reach: int) -> None:
    """Into a plane (H, W), near points (K, 2): a picture's (H, W, 3) channels by the weights (K, 3) of the nearest."""
    nearest = np.full(plane.shape, np.float32((reach + 1) ** 2))
    for k in range(len(points)):
        column, row = int(np.rint(points[k, 0])), int(np.rint(points[k, 1]))
        for v in range(max(row - reach, 0), min(row + reach + 1, len(plane))):
            for u in range(max(column - reach, 0), min(column + reach + 1, plane.shape[1])):
                square = (u - points[k, 0]) ** 2 + (v - points[k, 1]) ** 2
                if square < nearest[v, u]:
                    nearest[v, u], plane[v, u] = square, 0.0
                    for c in range(3):
                        plane[v, u] += weights[k, c] * image[v, u, c]


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
    hued = (paint.both_edges or changing) and _coloured(image)
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
