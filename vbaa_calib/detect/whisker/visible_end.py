"""Where the antenna ends in a picture, to a fraction of a pixel, and whether that is its tip.

Along the line, the height of its cross-section drops to nothing over a pixel or two: a blurred step, fitted to the
heights. An object in front of the antenna makes such a step, too: it is the tip only where nothing shows behind it but
the background, and where it is not much nearer than a whole antenna would end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from vbaa_calib.core import smooth
from vbaa_calib.core.polyline import arc_lengths

from .centreline import EndKind
from .crossings import crossings
from .line_shape import LineShape, fit

BEFORE_PX, BEYOND_PX = 60.0, 24.0
"""How much of the line before its end, and of the picture beyond it, is looked at."""
STRAIGHT_PX = 30.0
"""The line is drawn on beyond its last points as straight as so much of it before is: an end carries no moment."""
CLEAN_PX = 5.0
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
LONGER = 0.15
"""By so much a line may go on beyond its path; further, something else begins where it ends."""
AT_LEAST_ON = 12
"""So many profiles beyond the path's end still show the line where it is longer than its path."""
MOST_STD_PX, MOST_RMS = 1.5, 0.2
"""A step known less well, px, or that leaves more of the heights, is none to trust."""
ROUNDS = 12
LEAST_STD_PX = 0.1
"""What the pixel grid and the shape of a cut end leave open, at a blur of a pixel; more of it leaves more."""


@dataclass(frozen=True, eq=False)
class _VisibleEnd:
    """Where the antenna ends in a picture: place (2,), deviation along the antenna, and what it is."""

    end_px: np.ndarray
    std_px: float
    end: EndKind


@dataclass(frozen=True)
class _Step:
    """A blurred step from `height` to nothing at `place`, px; the place's deviation, and the rms residual."""

    place: float
    blur: float
    height: float
    std: float
    rms: float


@dataclass(frozen=True, eq=False)
class Look:
    """What the line looks like: its cross-section, seen in profiles of 2·half + 1 pixels with this noise, grey levels;
    whether it is brighter than its background, None where that changes."""

    shape: LineShape
    half: int
    noise: float
    bright: bool | None


def visible_end(image: np.ndarray, path_px: np.ndarray, seen: np.ndarray, look: Look) -> _VisibleEnd:
    """The end of a line in an (H, W) picture.

    Parameters
    ----------
    path_px : (K, 2) the line, from the clamp to where a whole antenna ends; bridged where it is hidden.
    seen : (K,) where it was measured.
    """
    farthest_px = (1.0 + LONGER) * float(arc_lengths(path_px)[-1])
    while True:
        found = _end_or_longer(image, path_px, seen, look)
        if isinstance(found, _VisibleEnd):
            return found
        path_px, seen = found
        if arc_lengths(path_px)[-1] > farthest_px:
            return _VisibleEnd(path_px[-1], np.nan, "unsure")


def _end_or_longer(
    image: np.ndarray, path_px: np.ndarray, seen: np.ndarray, look: Look
) -> _VisibleEnd | tuple[np.ndarray, np.ndarray]:
    """The end, or path (K, 2) and `seen` (K,) drawn on where the line goes on beyond it."""
    last = int(np.flatnonzero(seen)[-1])
    nothing = _VisibleEnd(path_px[last], np.nan, "hidden")
    along = arc_lengths(path_px)
    whole = float(along[-1])
    beyond = _continued(path_px, seen, last, along)
    if beyond is None:
        return nothing
    found = crossings(image, beyond, look.half, look.bright)
    here = found.along  # from the first point of the path that is looked at
    if len(here) < 12:
        return nothing
    fits = fit(look.shape, found, np.zeros(len(here)))
    last_at = float(arc_lengths(beyond)[np.hypot(*(beyond - path_px[last]).T).argmin()])
    before = found.inside & (here < last_at - 4.0)
    if before.sum() < 8:
        return nothing
    usual = smooth.median(fits.height[before])
    inside = found.inside
    if usual <= 0.0 or not inside.any():
        return nothing
    edge = bool((~inside & (here > last_at - 1.0) & (here < last_at + BEYOND_PX)).any())
    # only what lies before the picture's border
    stop = int(np.flatnonzero(~found.inside & (here > last_at - 1.0))[0]) if edge else len(here)
    used = np.flatnonzero(found.inside[:stop])
    on = used[(here[used] > last_at) & (fits.height[used] > 0.5 * usual)]
    if not edge and len(on) >= AT_LEAST_ON and on[-1] >= used[-3]:
        # bent towards the camera, it is longer in the picture than a whole antenna of the corridor
        path = np.vstack([path_px[: last + 1], found.moved(fits.shift)[on]])
        longer = np.concatenate([seen[: last + 1], np.ones(len(on), bool)])
        return path, longer
    step = _fitted(here[used], fits.height[used] / usual, look.noise * fits.unit_height[used] / usual)
    if step is None or (edge and here[used[-1]] < step.place + CLEAN_PX + 2.0 * step.blur):
        return _VisibleEnd(path_px[last], np.nan, "border" if edge else "hidden")
    shorter_px = whole - along[last] - (step.place - last_at)
    ground = found.profiles[:, [0, 1, -2, -1]].mean(axis=1) / usual  # beside the line
    kind = _kind(_Seen(here[used], fits.height[used] / usual, ground[used], fits.rms[used] / look.noise), step)
    if kind == "tip" and shorter_px > max(SHORTER * whole, SHORTER_PX):
        kind = "unsure"
    if kind == "hidden":
        return _VisibleEnd(path_px[last], np.nan, "hidden")
    place = np.array([np.interp(step.place, arc_lengths(beyond), beyond[:, axis]) for axis in (0, 1)])
    return _VisibleEnd(place, step.std, kind)


@dataclass(frozen=True, eq=False)
class _Seen:
    """What N profiles show: places (N,) px, heights (N,) and background (N,) over the usual height, residuals (N,) over
    the noise."""

    at: np.ndarray
    heights: np.ndarray
    background: np.ndarray
    residuals: np.ndarray


def _kind(seen: _Seen, step: _Step) -> EndKind:
    """What the end is."""
    gone = step.place + 2.0 * step.blur
    after = (seen.at > gone) & (seen.at < gone + CLEAN_PX)
    near = (seen.at > step.place - 2.0 * CLEAN_PX) & (seen.at < step.place - 2.0 * step.blur)
    if after.sum() < 3 or near.sum() < 3 or (seen.residuals[after] > DISTURBED).mean() > 0.4:
        return "hidden"
    if abs(np.median(seen.background[after]) - np.median(seen.background[near])) > EDGE:
        return "hidden"
    swollen = seen.heights[near].max() > BROAD or (seen.residuals[near] > 2.0 * DISTURBED).mean() > 0.3
    return "unsure" if swollen or step.std > MOST_STD_PX or step.rms > MOST_RMS else "tip"


def _continued(path_px: np.ndarray, seen: np.ndarray, last: int, along: np.ndarray) -> np.ndarray | None:
    """The line from some way before its last seen point, drawn on straight beyond it; None where it is too short."""
    near = np.flatnonzero(seen & (along > along[last] - STRAIGHT_PX) & (along <= along[last]))
    first = int(np.searchsorted(along, along[last] - BEFORE_PX))
    if len(near) < 8 or last - first < 12:
        return None
    t = along[near] - along[last]
    slopes = [np.polyfit(t, path_px[near, axis], 1) for axis in (0, 1)]
    direction = np.array([slope[0] for slope in slopes])
    direction /= np.hypot(*direction)
    end = np.array([slope[1] for slope in slopes])
    ahead = np.arange(1.0, BEYOND_PX + 1.0)[:, None] * direction + end
    return np.vstack([path_px[first : last + 1], ahead])


def _fitted(at: np.ndarray, heights: np.ndarray, sigma: np.ndarray) -> _Step | None:
    """The step that heights (N,) of deviations (N,) at places (N,) show; None where none does."""
    if len(at) < 16:
        return None
    rest = heights**2
    after = rest.sum() - np.cumsum(rest)
    mean = np.cumsum(heights) / np.arange(1, len(at) + 1)
    before = np.cumsum(rest) - np.arange(1, len(at) + 1) * mean**2
    cut = int((before + after)[4:-2].argmin()) + 4
    theta = np.array([0.5 * (at[cut] + at[cut + 1]), BLUR_PX, mean[cut]])
    near = (at > theta[0] - BEFORE_PX) & (at < theta[0] + BEYOND_PX)
    s, h, weight = at[near], heights[near], 1.0 / np.maximum(sigma[near], 1e-6)
    if (s > theta[0] + 2.0).sum() < 3:
        return None
    for _ in range(ROUNDS):
        away = (theta[0] - s) / theta[1]
        bell = np.exp(-0.5 * away**2) / np.sqrt(2.0 * np.pi)
        rows = np.stack([theta[2] * bell / theta[1], -theta[2] * bell * away / theta[1], ndtr(away)], axis=1)
        left = h - theta[2] * ndtr(away)
        normal_matrix = (rows * weight[:, None]).T @ (rows * weight[:, None]) + np.diag([0.0, 25.0, 0.0])
        side = (rows * weight[:, None]).T @ (left * weight) + np.array([0.0, 25.0 * (BLUR_PX - theta[1]), 0.0])
        move = np.linalg.solve(normal_matrix + 1e-9 * np.eye(3), side)
        move[0] = np.clip(move[0], -2.0, 2.0)
        theta = theta + move
        theta[1] = np.clip(theta[1], *BLUR_RANGE_PX)
        if abs(move[0]) < 1e-4:
            break
    left = h - theta[2] * ndtr((theta[0] - s) / theta[1])
    excess = max(1.0, float(np.sqrt(np.mean((left * weight) ** 2))))
    std = float(np.sqrt(np.linalg.inv(normal_matrix + 1e-9 * np.eye(3))[0, 0])) * excess
    if theta[2] < LEAST_CONTRAST * float(np.median(1.0 / weight)) / np.sqrt(8.0) or not s[0] < theta[0] < s[-1]:
        return None
    return _Step(
        float(theta[0]),
        float(theta[1]),
        float(theta[2]),
        float(np.hypot(std, LEAST_STD_PX * max(theta[1], 1.0))),
        float(np.sqrt(np.mean(left**2))),
    )
