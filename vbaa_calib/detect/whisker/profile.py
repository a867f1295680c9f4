"""Sub-pixel measurement of the antenna: its cross-section in the picture, fitted to raw profiles.

Profiles are the raw pixels of every column that it crosses (of every row where it is steeper than 45°), because
interpolated ones share their noise, and shift a thin line with its phase on the pixel grid.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from vbaa_calib.core.polyline import offsets_from
from vbaa_calib.core.robust import MAD_SCALE
from vbaa_calib.native import core

from .acceptance import accepted
from .centreline import NOTHING, Centreline, too_short
from .settings import ProfileSettings, RibbonSettings

LINE_MODES = 3  # offset, slope and curvature: the first Legendre polynomials of the place along a line
_shapes = lru_cache(maxsize=32)(core.profile.shapes)


def refine_path(image: np.ndarray, path_px: np.ndarray, width_px: float, reach_px: float, bright: bool) -> np.ndarray:
    """(K, 2) a path moved by up to `reach_px` across itself onto the antenna.

    Two rounds: over the whole reach with a stiff curve, then near that curve with a supple one.
    """
    found: np.ndarray = core.search.refine_path(image, path_px, width_px, reach_px, 1.0 if bright else -1.0)
    return found


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
    if bright is None:
        return measure_ribbon(image, path_px, width_px)
    half = int(np.ceil(0.8 * (width_px + blurred_px) + 5.0))
    path_px = np.ascontiguousarray(path_px, np.float64)
    return _measured(image, path_px, width_px, half, bright, taper)


def _measured(
    image: np.ndarray, path_px: np.ndarray, width_px: float, half: int, bright: bool, taper: float
) -> Centreline:
    width_px = round(float(width_px), 2)
    how = (width_px, half, 1.0 if bright else -1.0, taper, _quiet_part(2 * half - 3))
    shapes = _shapes(width_px, ProfileSettings.blur_px, half + 2)
    found = core.profile.measured(np.ascontiguousarray(image), path_px, *how, shapes)
    if found is None:
        return NOTHING
    more, evened = _row_errors(image, found[0], half)
    if evened is not None and (again := core.profile.measured(evened, path_px, *how, shapes)) is not None:
        found = again
        more = np.full(len(found[0]["points_px"]), np.median(more))
    line = accepted(found[0] | {"row_px": more}, *found[1:4])
    if not (line.found and found[4] > 0.0):
        return line
    return _between(image if evened is None else evened, line, width_px, found[4])


def _between(image: np.ndarray, line: Centreline, width_px: float, pulled_px: float) -> Centreline:
    """The centreline between both edges of a line that light from one side makes lopsided, by about `pulled_px` all
    along it. The line itself where the edges do not agree on that: then something next to it is the cause."""
    between = measure_ribbon(image, line.guide_px, width_px)
    if not between.found:
        return between
    uneven = float(offsets_from(line.guide_px, between.points_px)[1].std())
    return (line if uneven > ProfileSettings.uneven * pulled_px else between).doubted(pulled_px)


def measure_ribbon(picture: np.ndarray, path_px: np.ndarray, width_px: float) -> Centreline:
    """The centreline along a path (K, 2) on the antenna in a picture (H, W[, 3]): a ribbon, brighter or darker than
    both backgrounds, with illumination that varies smoothly along it."""
    how = RibbonSettings
    half = int(np.ceil(how.flank_widths * width_px + how.flank_px))
    path_px = np.ascontiguousarray(path_px, np.float64)
    picture = np.ascontiguousarray(picture if picture.ndim == 2 else picture[..., :3])
    found = core.profile.measured_ribbon(picture, path_px, float(width_px), ProfileSettings.blur_px, half, how)
    if found is None:
        return NOTHING
    more, _ = _row_errors(picture, found[0], half)
    return accepted(found[0] | {"row_px": more}, *found[1:4])


def measure_between(picture: np.ndarray, line: Centreline, width_px: float) -> Centreline:
    """The centreline between both edges of a line that one polarity showed, in a picture (H, W[, 3]).

    Measured twice: light from one side has displaced that line, and a ribbon's course stays near its path.
    """
    first = measure_ribbon(picture, line.guide_px, width_px)
    return measure_ribbon(picture, first.guide_px, width_px) if first.found else first


@lru_cache(maxsize=32)
def _quiet_part(freedom: int) -> float:
    """The quantile of the root mean square of `freedom` normal numbers that the core takes for a picture's noise, by
    Newton's method.

    The probability is the series of the incomplete gamma function: SciPy's takes longer to load than a contact to find.
    """
    half = at = 0.5 * freedom
    for _ in range(8):  # to the last digit for profiles of any length
        terms = np.cumprod(at / (half + np.arange(1.0, 60.0 + 2.0 * freedom)))
        first = math.exp(half * math.log(at) - at - math.lgamma(half + 1.0))
        at -= (first * (1.0 + float(terms.sum())) - core.profile.QUIET) / (first * half / at)
    return math.sqrt(at / half)


def locking_std(points_px: np.ndarray) -> np.ndarray:
    """(3,) standard deviations, in the modes of a line through ordered points (N, 2) px, of errors of 1 px rms that
    are periodic in the line's position on the pixel grid.

    A line that crosses n rows averages them to about 1/πn; one along a row keeps them. Their phase is unknown.
    """
    count = len(points_px)
    if count < LINE_MODES:
        return np.zeros(LINE_MODES)
    along = np.gradient(points_px, axis=0)
    across = np.abs(along[:, ::-1]) / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    waves = np.exp(2j * np.pi * points_px) * across
    modes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count), LINE_MODES - 1)
    parts = (2.0 * np.arange(LINE_MODES) + 1.0)[:, None] / count * (modes.T @ waves)
    return np.asarray(np.linalg.norm(parts, axis=1))


def _evened(image: np.ndarray, points_px: np.ndarray, reach_px: int) -> tuple[np.ndarray, float]:
    """A picture (H, W) without the noise of whole rows: the offset that the pixels of a row near a line's points (N, 2)
    px share, apart from a parabola across the rows, is subtracted. And the standard deviation of the remaining offsets,
    infinite where too few pixels show them. Pixels up to `reach_px` from the line and those behind its first point do
    not count."""
    first = max(int(points_px[:, 1].min()) - 2 * reach_px, 0)
    rows = np.arange(first, min(int(points_px[:, 1].max()) + 2 * reach_px + 2, len(image)))
    columns, along = np.arange(image.shape[1]), np.argsort(points_px[:, 0])
    near = np.abs(rows[:, None] - np.interp(columns, *points_px[along].T)) <= reach_px
    onwards = np.sign(points_px[-1, 0] - points_px[0, 0])
    near[:, onwards * (columns - points_px[-1, 0]) > reach_px] = False
    values = np.where(near, np.nan, image[rows[0] : rows[-1] + 1].astype(np.float32))
    values -= np.nanmean(np.where(near.all(axis=0), 0.0, values), axis=0)
    enough = (~near).sum(axis=1) >= ProfileSettings.row_pixels
    if enough.sum() < ProfileSettings.row_run:
        return image, np.inf
    shared = np.where(enough, np.nanmedian(np.where(enough[:, None], values, 0.0), axis=1), 0.0)
    shared -= enough * np.polynomial.Polynomial.fit(rows[enough], shared[enough], 2)(rows)
    noise = MAD_SCALE * float(np.nanmedian(np.abs(values - shared[:, None])[enough]))
    evened = image.astype(np.float32)
    evened[rows] -= shared[:, None]
    # a median is by a quarter less sure than a mean
    return evened, 1.25 * noise / float(np.sqrt(np.median((~near).sum(axis=1)[enough])))


def _row_errors(image: np.ndarray, line: Mapping[str, Any], reach_px: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Standard deviations (N,) that noise of whole rows and columns of a picture adds to those of a line's points in
    its order, for points that count as independent; and the picture without most of that noise, to which they then
    apply, where it is grey and that lowers them, else None. line : fields of a `Centreline`.

    All points on a row share its error, so that a line along rows keeps it, and one across them has none. reach_px :
    how far from the line pixels are its own.
    """
    points_px, sigma_px, noise = line["points_px"], line["sigma_px"], line["noise"]
    found, step = np.zeros(len(points_px)), ProfileSettings.row_run
    evened: np.ndarray | None = None
    if len(points_px) <= step:
        return found, None
    along = points_px[step:] - points_px[:-step]
    for axis in (1, 0):
        alike, shared = core.profile.row_noise(image, points_px, axis, ProfileSettings.row_band, step)
        if not shared > 0.0:
            continue
        own = max(noise**2 - shared**2, 0.25 * noise**2) ** 0.5
        across = float(np.abs(along[:, 1 - axis]).mean() / np.hypot(*along.T).mean())
        more = sigma_px * (across * shared / max(own, 1e-9)) * np.sqrt(alike)
        if image.ndim == 2 and core.search.median(more) > core.search.median(sigma_px):
            rows = image if axis else image.T
            better, left = _evened(rows, points_px if axis else points_px[:, ::-1], reach_px)
            if left < shared:
                more, evened = more * left / shared, better if axis else np.ascontiguousarray(better.T)
        found = np.hypot(found, more)
    return found, evened
