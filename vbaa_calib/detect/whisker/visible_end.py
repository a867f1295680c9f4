"""Where the antenna ends in a picture, to a fraction of a pixel, and whether that is its tip.

Along the line, the height of its cross-section drops to nothing over a pixel or two: a blurred step, fitted to the
heights. An object in front of the antenna makes such a step, too: it is the tip only where nothing shows behind it but
the background, and where it is not much nearer than a whole antenna would end.
"""

from __future__ import annotations

from math import erfc
from typing import NamedTuple

import numpy as np

from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.polyline import arc_lengths
from vbaa_calib.core.smooth import median, solve

from .centreline import EndKind
from .crossings import Crossings, crossed, moved
from .line_shape import CrossSection, fit

BEFORE_PX, BEYOND_PX = 60.0, 24.0
"""How much of the line before its end, and of the picture beyond it, is looked at."""
_STRAIGHT_PX = 30.0
"""The line is drawn on beyond its last points as straight as so much of it before is: an end carries no moment."""
_CLEAN_PX = 5.0
"""Beyond a tip nothing must show for so many pixels, and its blur."""
LEAST_CONTRAST = 8.0
"""Height over its own deviation, of the mean profile before the end, for the step to be measured."""
BLUR_PX, BLUR_RANGE_PX = 0.8, (0.3, 4.0)
"""Blur of the step to begin with, and what is possible."""
SHORTER, SHORTER_PX = 0.06, 8.0
"""Ending before so much of a whole antenna's length, and of so many pixels, it may be hidden by what looks like the
background."""
DISTURBED, BROAD = 1.8, 1.25
"""Profiles that leave this many times the noise show something else; a height or width that rises by this factor
towards the end is a ball, a sheath or a kink."""
EDGE = 0.2
"""By so much of the line's height its background may change where it ends."""
_MOST_LONGER = 0.15
"""By so much a line may go on beyond its path; further, something else begins where it ends."""
_AT_LEAST_ON = 12
"""So many profiles beyond the path's end still show the line where it is longer than its path."""
MOST_STD_PX, MOST_RMS = 1.5, 0.2
"""A step known less well, px, or that leaves more of the heights, is none to trust."""
ROUNDS = 12
_LEAST_STD_PX = 0.1
"""What the pixel grid and the shape of a cut end leave open, at a blur of a pixel; more of it leaves more."""


LEAST_PROFILES, LEAST_BEFORE, LEAST_STEP = 12, 8, 16
"""Profiles that are looked at, those of them before the end, and those that a step is fitted to, at the least."""
_TIP, _HIDDEN, _BORDER, _UNSURE, _LONGER = range(5)
_KINDS: tuple[EndKind, ...] = ("tip", "hidden", "border", "unsure")


class VisibleEnd(NamedTuple):
    """Where the antenna ends in a picture: place (2,), deviation along the antenna, and what it is."""

    end_px: np.ndarray
    std_px: float
    end: EndKind


class _Step(NamedTuple):
    """A blurred step from `height` to nothing at `place`, px; the place's deviation, and the rms residual; whether
    there is one at all."""

    place: float
    blur: float
    height: float
    std: float
    rms: float
    there: bool


class _Continued(NamedTuple):
    """A line from some way before its last seen point, drawn on straight beyond it; no points where it is too short.

    Attributes
    ----------
    path_px : (B, 2). last : which of its points was the last one seen.
    whole_px, rest_px : length of the whole path, and of what of it is not seen at its end.
    """

    path_px: np.ndarray
    last: int
    whole_px: float
    rest_px: float


class Look(NamedTuple):
    """What the line looks like: its cross-section, seen in profiles of 2·half + 1 pixels with this noise, grey levels;
    whether it is brighter than its background, None where that changes."""

    section: CrossSection
    half: int
    noise: float
    bright: bool | None


def visible_end(image: np.ndarray, path_px: np.ndarray, seen: np.ndarray, look: Look) -> VisibleEnd:
    """The end of a line in an (H, W) picture.

    Parameters
    ----------
    path_px : (K, 2) the line, from the clamp to where a whole antenna ends; bridged where it is hidden.
    seen : (K,) where it was measured.
    """
    sign = -1.0 if look.bright is False else 1.0
    kind, place, std = _found(np.ascontiguousarray(image), path_px, seen, look.section, (look.half, look.noise, sign))
    return VisibleEnd(place, std, _KINDS[kind])


@kernel
def _found(
    image: np.ndarray, path_px: np.ndarray, seen: np.ndarray, section: CrossSection, look: tuple[int, float, float]
) -> tuple[int, np.ndarray, float]:
    """What the end is, its place (2,) and its deviation. look : `half` and `noise` of it; the line's sign."""
    (half, noise, sign), farthest_px = look, (1.0 + _MOST_LONGER) * arc_lengths(path_px)[-1]
    while True:
        last, ahead = np.flatnonzero(seen)[-1], _continued(path_px, seen)
        if not len(ahead.path_px):
            return _HIDDEN, path_px[last].copy(), np.nan
        kind, place, std, longer = _end_or_longer(crossed(image, ahead.path_px, half, sign), section, noise, ahead)
        if kind != _LONGER:
            return kind, place, std
        path_px = np.concatenate((path_px[: last + 1], longer))
        seen = np.concatenate((seen[: last + 1], np.ones(len(longer), np.bool_)))
        if arc_lengths(path_px)[-1] > farthest_px:
            return _UNSURE, path_px[-1].copy(), np.nan


@kernel
def _end_or_longer(
    found: Crossings, section: CrossSection, noise: float, ahead: _Continued
) -> tuple[int, np.ndarray, float, np.ndarray]:
    """What the end is, its place (2,) and its deviation; or points (M, 2) of a line that goes on beyond its path."""
    here, along = found.along, arc_lengths(ahead.path_px)  # from the first point of the path that is looked at
    last_at, end = along[ahead.last], ahead.path_px[ahead.last]
    nothing, no_points = (_HIDDEN, end, np.nan, np.empty((0, 2))), np.empty((0, 2))
    if len(here) < LEAST_PROFILES:
        return nothing
    fits = fit(section, found, np.zeros(len(here)))
    known = found.inside & (here < last_at - 4.0)
    if known.sum() < LEAST_BEFORE:
        return nothing
    usual = median(fits.height[known])
    if usual <= 0.0:
        return nothing
    # only what lies before the picture's border
    edge, stop = False, len(here)
    for n in range(len(here)):
        if not found.inside[n] and here[n] > last_at - 1.0:
            edge, stop = edge or here[n] < last_at + BEYOND_PX, min(stop, n)
    used = np.flatnonzero(found.inside[: stop if edge else len(here)])
    on = used[(here[used] > last_at) & (fits.height[used] > 0.5 * usual)]
    if not edge and len(on) >= _AT_LEAST_ON and on[-1] >= used[-3]:
        # bent towards the camera, it is longer in the picture than a whole antenna of the corridor
        return _LONGER, end, np.nan, moved(found, fits.shift)[on]
    at, heights = here[used], fits.height[used] / usual
    step = _fitted(at, heights, noise * fits.unit_height[used] / usual)
    if not step.there or (edge and at[-1] < step.place + _CLEAN_PX + 2.0 * step.blur):
        return _BORDER if edge else _HIDDEN, end, np.nan, no_points
    kind = _kind(_Seen(at, heights, _beside(found, used) / usual, fits.rms[used] / noise), step)
    if kind == _HIDDEN:
        return nothing
    if kind == _TIP and ahead.rest_px - (step.place - last_at) > max(SHORTER * ahead.whole_px, SHORTER_PX):
        kind = _UNSURE
    place = np.empty(2)
    for axis in range(2):
        place[axis] = np.interp(step.place, along, ahead.path_px[:, axis])
    return kind, place, step.std, no_points


@kernel
def _beside(found: Crossings, used: np.ndarray) -> np.ndarray:
    """(M,) grey levels beside the line in some of the profiles."""
    ground = np.empty(len(used))
    for k in range(len(used)):
        profile = found.profiles[used[k]]
        ground[k] = 0.25 * (profile[0] + profile[1] + profile[-2] + profile[-1])
    return ground


class _Seen(NamedTuple):
    """What N profiles show: places (N,) px, heights (N,) and background (N,) over the usual height, residuals (N,) over
    the noise."""

    at: np.ndarray
    heights: np.ndarray
    background: np.ndarray
    residuals: np.ndarray


@kernel
def _kind(seen: _Seen, step: _Step) -> int:
    """What the end is."""
    gone = step.place + 2.0 * step.blur
    after = (seen.at > gone) & (seen.at < gone + _CLEAN_PX)
    near = (seen.at > step.place - 2.0 * _CLEAN_PX) & (seen.at < step.place - 2.0 * step.blur)
    if after.sum() < 3 or near.sum() < 3 or (seen.residuals[after] > DISTURBED).mean() > 0.4:
        return _HIDDEN
    if abs(np.median(seen.background[after]) - np.median(seen.background[near])) > EDGE:
        return _HIDDEN
    swollen = seen.heights[near].max() > BROAD or (seen.residuals[near] > 2.0 * DISTURBED).mean() > 0.3
    return _UNSURE if swollen or step.std > MOST_STD_PX or step.rms > MOST_RMS else _TIP


@kernel
def _continued(path_px: np.ndarray, seen: np.ndarray) -> _Continued:
    """A line (K, 2) drawn on beyond where it was last seen (K,)."""
    along = arc_lengths(path_px)
    last = np.flatnonzero(seen)[-1]
    first = 0
    while along[first] < along[last] - BEFORE_PX:
        first += 1
    near = seen & (along > along[last] - _STRAIGHT_PX) & (along <= along[last])
    if near.sum() < 8 or last - first < 12:
        return _Continued(np.empty((0, 2)), 0, along[-1], along[-1] - along[last])
    t = along[near] - along[last]
    middle = t.mean()
    path = np.empty((last + 1 - first + int(BEYOND_PX), 2))
    path[: last + 1 - first] = path_px[first : last + 1]
    end, direction = np.empty(2), np.empty(2)
    for axis in range(2):
        values = path_px[:, axis][near]
        direction[axis] = ((t - middle) * values).sum() / ((t - middle) ** 2).sum()
        end[axis] = values.mean() - direction[axis] * middle
    direction /= np.hypot(direction[0], direction[1])
    for k in range(int(BEYOND_PX)):
        path[last + 1 - first + k] = end + (k + 1.0) * direction
    return _Continued(path, last - first, along[-1], along[-1] - along[last])


@kernel
def _fitted(at: np.ndarray, heights: np.ndarray, sigma: np.ndarray) -> _Step:
    """The step that heights (N,) of deviations (N,) at places (N,) show, if they show one."""
    none = _Step(np.nan, np.nan, np.nan, np.nan, np.nan, False)
    if len(at) < LEAST_STEP:
        return none
    place, height = _cut(at, heights)
    blur = BLUR_PX
    near = (at > place - BEFORE_PX) & (at < place + BEYOND_PX)
    s, h, weight = at[near], heights[near], 1.0 / np.maximum(sigma[near], 1e-6)
    if (s > place + 2.0).sum() < 3:
        return none
    row, variance = np.empty(3), np.nan
    for _ in range(ROUNDS):
        matrix, sides = np.diag(np.array([1e-9, 25.0 + 1e-9, 1e-9])), np.zeros((3, 2))
        sides[1, 0], sides[0, 1] = 25.0 * (BLUR_PX - blur), 1.0
        for k in range(len(s)):
            away = (place - s[k]) / blur
            bell, below = np.exp(-0.5 * away**2) / np.sqrt(2.0 * np.pi), 0.5 * erfc(-away / np.sqrt(2.0))
            row[0], row[1], row[2] = height * bell / blur, -height * bell * away / blur, below
            for i in range(3):
                sides[i, 0] += weight[k] ** 2 * row[i] * (h[k] - height * below)
                for j in range(i + 1):
                    matrix[i, j] += weight[k] ** 2 * row[i] * row[j]
        solve(matrix, sides)
        variance = sides[0, 1]
        move = min(max(sides[0, 0], -2.0), 2.0)
        place, blur = place + move, min(max(blur + sides[1, 0], BLUR_RANGE_PX[0]), BLUR_RANGE_PX[1])
        height += sides[2, 0]
        if abs(move) < 1e-4:
            break
    weighted, plain = 0.0, 0.0
    for k in range(len(s)):
        left = h[k] - height * 0.5 * erfc(-(place - s[k]) / (blur * np.sqrt(2.0)))
        weighted, plain = weighted + (left * weight[k]) ** 2, plain + left**2
    std = np.sqrt(variance) * max(1.0, np.sqrt(weighted / len(s)))
    if height < LEAST_CONTRAST * np.median(1.0 / weight) / np.sqrt(8.0) or not s[0] < place < s[-1]:
        return none
    return _Step(place, blur, height, np.hypot(std, _LEAST_STD_PX * max(blur, 1.0)), np.sqrt(plain / len(s)), True)


@kernel
def _cut(at: np.ndarray, heights: np.ndarray) -> tuple[float, float]:
    """Where heights (N,) drop from a constant to nothing, and that constant: by the least sum of squares."""
    best, place, height = np.inf, 0.0, 0.0
    total = 0.0
    for k in range(len(at) - 2):
        total += heights[k]
        left = -(total**2) / (k + 1)  # beside what is the same everywhere
        if k >= 4 and left < best:
            best, place, height = left, 0.5 * (at[k] + at[k + 1]), total / (k + 1)
    return place, height
