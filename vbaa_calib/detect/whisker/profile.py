"""Measure the antenna to a fraction of a pixel: its cross-section, as the picture shows it, fitted to raw profiles.

Raw pixels of every column that it crosses (of every row where it runs more upward than sideways), because interpolated
ones share their noise, and shift a thin line with its phase on the pixel grid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.ndimage import binary_closing, binary_erosion, uniform_filter1d
from scipy.special import chdtri

from vbaa_calib.core import smooth

from .acceptance import FittedLine, accepted
from .centreline import NOTHING, Centreline
from .crossings import Crossings, crossings
from .line_shape import Fits, LineShape, binned, expected, fit, learn, nearest, tapering
from .path_refinement import refine_path
from .reflectance import learn_reflectance, stiffened
from .visible_end import Look, visible_end

SEEN_RATIO, SEEN_CHANGING = 4.5, 3.5
"""Least height over its standard deviation for a profile to count as seen; and where the line changes along its length:
what its neighbours show tells its sign and shape."""
QUIET = 0.4
"""Quantile of the profiles' residuals taken for the picture's noise: more than half may lie beside an object."""
DISTURBED = 1.8
"""Profiles that leave this many times the noise show something beside the antenna, which draws the line aside."""
LEAST_CLEAN = 0.3
"""With less than this fraction undisturbed, disturbed profiles are kept too, with the deviations that they deserve."""
MARGIN_PX = 2
"""Columns dropped on either side of a gap: part of their profile shows what hides the antenna."""
STRAY, STRAY_PX = 5.0, 0.12
"""A point this many deviations, and at least so far, off a smooth curve through its neighbours is another thing's."""
TRAINING_PROFILES = 160
"""The cross-section is learned from about so many profiles."""
ALIKE = 0.8
"""Length of the mean phase on the pixel grid above which the profiles lie alike."""
LOPSIDED, FLANKED_PX, PULLED = 0.012, 5.0, 0.05
"""With its sides so different, as a part of its height, a line this broad is measured by its own reflectance; a
highlight, or a shadow beside it, still pulls it by about this part of its width, alike for all its points."""
END_PROFILES = 40
"""The antenna's look at its visible end is that of so many profiles before it."""
EDGE_RUN, EDGE_NOTICED = 21, 3.0
"""An object's edge beside the antenna draws about so many neighbouring points aside alike: what a step of the
background behind the line would move them by, on average, is doubt where it exceeds so many of its own deviations."""
CURVE_PIECES = 12
"""Of the curve that the points scatter about: enough for a cantilever, too few to follow errors that neighbours
share."""
NEAR_POINTS, RUN = 41, 16
"""Neighbours whose scatter is compared with their deviations, and whose mean shows what they share."""
LIKELY_POINTS, LIKELY_RUNS = 20.0, 4.0
"""So many points, and runs, that scatter as predicted are added to those that are seen."""
ORDINARY_BLUR_PX = 0.8
"""Blur of a lens in focus, standard deviation."""
LEAST_PROFILES = 8
"""Across the antenna, for there to be a line, and for its noise to be measured."""
BROADER = 1.5
"""A line so much broader than expected is measured again with longer profiles."""


def measure(image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool | None = True) -> Centreline:
    """The centreline near a guide, one point for every column (or row) of pixels that it crosses.

    Parameters
    ----------
    image : (H, W) grey levels.
    guide_px : (K, 2) a path within about one antenna width of the truth, from clamp to tip.
    width_px : the antenna's width.
    bright : brighter than its background; None: here brighter, there darker.

    Notes
    -----
    A point is kept where the line's height stands out from its noise and agrees with its neighbours', the profile
    leaves no more residual than noise does, and it lies on a smooth curve with the others: an object's edge beside the
    antenna draws the line aside, and alike for many neighbours.
    """
    if len(guide_px) < 2 or np.hypot(*np.diff(guide_px, axis=0).T).sum() < 8.0:
        return NOTHING
    return measure_on(image, refine_path(image, guide_px, width_px, width_px + 2.0, bright).path_px, width_px, bright)


def measure_on(
    image: np.ndarray, path_px: np.ndarray, width_px: float, bright: bool | None, blurred_px: float = 0.0
) -> Centreline:
    """As `measure`, along a path (K, 2) that lies on the antenna to a fraction of its width.

    `blurred_px` : by how much broader than the antenna the line may be.
    """
    half = int(np.ceil(0.8 * (width_px + blurred_px) + 5.0))
    path_px = stiffened(path_px) if bright is None else path_px
    line = _measured(image, path_px, width_px, half, bright)
    if line.breadth > BROADER:
        wider = _measured(image, path_px, width_px, int(np.ceil(half + 0.7 * line.breadth * width_px + 2.0)), bright)
        return wider if len(wider.points_px) >= len(line.points_px) else line
    return line


@lru_cache(maxsize=16)
def _ordinary(width_px: float, half: int) -> LineShape:
    return expected(width_px, ORDINARY_BLUR_PX, half + 2)


def _measured(image: np.ndarray, path_px: np.ndarray, width_px: float, half: int, bright: bool | None) -> Centreline:
    found = crossings(image, path_px, half, bright)
    if found.inside.sum() < LEAST_PROFILES:
        return NOTHING
    width_px = round(width_px, 2)
    lines = _changing_lines(found, width_px, half) if bright is None else _lines(found, width_px, half)
    kept, clean, there = _kept(found, lines, bright is None)
    if not kept.any():
        return NOTHING
    sigma = _deviations(found, lines, clean if clean.sum() >= LEAST_PROFILES else kept)
    edge = _edge_doubt(found, lines, there)
    doubt = np.hypot(edge, lines.shared)
    kept, course = _without_strays(found, lines, np.hypot(sigma, doubt), kept)
    margin = 1 if bright is None else MARGIN_PX
    # a profile or two that noise hides are no gap
    kept &= binary_erosion(kept | binary_closing(kept), iterations=margin, border_value=1)
    if not kept.any():
        return NOTHING
    breadth = lines.half_width_px / _ordinary(width_px, half).half_width_px
    sigma, effective = _calibrated(found, lines, sigma, doubt, kept)
    line = FittedLine(
        lines.centre, course, sigma, effective, kept, lines.fits.height, lines.noise, breadth, bright is None
    )
    measured = accepted(found, line)
    end = visible_end(image, measured.guide_px, kept, Look(lines.shape, half, lines.noise, bright))
    return replace(measured, end_px=end.end_px, end_std_px=end.std_px, end=end.end)


@dataclass(frozen=True, eq=False)
class _Lines:
    """The fitted lines.

    Attributes
    ----------
    centre : (N,) along the profiles from the path, px.
    fits, rms : the last fit and its residuals' rms (N,).
    shape : the cross-section; at the line's end, where it changes. half_width_px : half its width.
    noise : of a pixel, grey levels.
    usual : (N,) height that the line should have. shared : (N,) error of the place that neighbours share, px.
    """

    centre: np.ndarray
    fits: Fits
    rms: np.ndarray
    shape: LineShape
    half_width_px: float
    noise: float
    usual: np.ndarray
    shared: np.ndarray


def _lines(found: Crossings, width_px: float, half: int) -> _Lines:
    """Learn the cross-section from some of the profiles, then fit it to all.

    At first an antenna in focus; then one at the blur that is seen; then whatever the profiles show. Where all of them
    lie alike on the pixel grid, a free shape and a shift could not be separated, and the second is kept. The shape is
    broader where the antenna is nearer to the camera.
    """
    some = found.every(max(1, len(found.along) // TRAINING_PROFILES))
    length = max(float(found.along[-1]), 1e-6)
    shape, curve, base = _ordinary(width_px, half), np.zeros(len(found.along)), np.zeros(len(some.along))
    pulled = 0.0
    for step in range(2):
        fits = fit(shape, some, base)
        chosen = _training_profiles(fits, some.inside, half)
        if chosen.sum() < 4:
            break
        if step:
            # not at first: the path is good enough to tell the blur by
            course = smooth.fit(some.along / length, fits.shift, chosen.astype(float), (1.0, 0.3), 12, 1e-3)
            base, curve = course.values, course.at(found.along / length)
        heights = shape.at(some.distances(base)[chosen])[0] + fits.residuals[chosen] / fits.height[chosen, None]
        taper = tapering(shape, some, base, fits, chosen)
        found, some = found.tapered(taper), some.tapered(taper)
        seen = binned(some.distances(base)[chosen], heights, half + 2)
        free = step == 1 and abs(np.exp(2j * np.pi * some.across[chosen, 0]).mean()) < ALIKE
        shape = learn(seen) if free else nearest(seen, width_px)
        if free:
            lopsided = seen.lopsided(smooth.median(fits.rms[chosen] / fits.height[chosen]))
            pulled = PULLED * width_px * float(np.clip((lopsided - 0.5 * LOPSIDED) / LOPSIDED, 0.0, 1.0))
            if width_px > FLANKED_PX and lopsided > LOPSIDED:
                return _changing_lines(found, width_px, half, (curve, pulled))
    fits = fit(shape, found, curve)
    rms, noise = fits.rms, _noise(fits.rms[found.inside], half)
    seen = found.inside & (fits.height > SEEN_RATIO * np.maximum(rms, noise) * fits.unit_height)
    usual = np.full(len(rms), smooth.median(fits.height[seen]) if seen.any() else 0.0)
    return _Lines(curve + fits.shift, fits, rms, shape, shape.half_width_px, noise, usual, np.full(len(rms), pulled))


def _changing_lines(
    found: Crossings, width_px: float, half: int, about: tuple[np.ndarray, float] | None = None
) -> _Lines:
    """The fitted lines of an antenna with its own reflectance."""
    learned = learn_reflectance(found, width_px, ORDINARY_BLUR_PX, half + 2, about)
    found, reflectance = found.tapered(learned.taper), learned.reflectance
    fits = fit(reflectance, found, learned.course)
    noise = _noise(fits.rms[found.inside], half)
    seen = np.flatnonzero(found.inside & (fits.height > SEEN_RATIO * noise * fits.unit_height))
    shape = reflectance.shape(seen[-END_PROFILES:] if len(seen) else slice(None))
    broad = expected(reflectance.width_px, reflectance.blur_px, half + 2).half_width_px
    return _Lines(
        learned.course + fits.shift,
        fits,
        fits.rms,
        shape,
        broad,
        noise,
        reflectance.height,
        learned.shared_px,
    )


def _training_profiles(fits: Fits, inside: np.ndarray, half: int) -> np.ndarray:
    """(N,) profiles that show a clear line, as high as most, and nothing else."""
    rms = fits.rms
    noise = _noise(rms[inside], half)
    good = inside & (fits.height > SEEN_RATIO * noise * fits.unit_height) & (np.abs(fits.shift) < 1.5)
    if not good.any():
        return good
    typical = smooth.median(fits.height[good])
    good &= (fits.height > 0.4 * typical) & (fits.height < 2.5 * typical)
    calm = good & (rms < DISTURBED * noise + 0.02 * typical)
    return calm if calm.sum() >= 0.3 * good.sum() else good


def _kept(found: Crossings, lines: _Lines, changing: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) which profiles show the antenna well enough, which show nothing else beside it, which show it at all.

    One that changes along its length mostly lies before something: its profiles are judged by its height alone, and the
    disturbed ones kept with the deviations that they deserve.
    """
    fits, rms, noise = lines.fits, lines.rms, lines.noise
    half = 0.5 * (fits.gain.shape[1] - 1)
    seen = found.inside & (np.abs(lines.centre) < half - 2.0)
    least = SEEN_CHANGING * noise if changing else SEEN_RATIO * np.maximum(rms, noise)
    seen &= fits.height > least * fits.unit_height
    if not seen.any():
        return seen, seen, seen
    seen &= (fits.height > 0.3 * lines.usual) & (fits.height < 3.0 * lines.usual)
    clean = seen & (rms < DISTURBED * noise)
    if clean.mean() >= LEAST_CLEAN and not changing:
        return clean, clean, seen
    kept = seen & (rms < 4.0 * noise + (0.3 if changing else 0.1) * lines.usual)
    return kept, clean, seen


def _deviations(found: Crossings, lines: _Lines, clean: np.ndarray) -> np.ndarray:
    """(N,) standard deviation across the antenna, from the residuals at each distance from the centre.

    Where along the antenna there is more noise than elsewhere, the deviations are larger in proportion.
    """
    fits = lines.fits
    distance = np.abs(found.across - lines.centre[:, None]).astype(np.intp)
    bins = int(distance.max()) + 1
    squares = fits.residuals[clean] ** 2 / fits.freed[clean]
    at = distance[clean].ravel()
    number = np.bincount(at, minlength=bins)
    variance = np.bincount(at, squares.ravel(), bins) / np.maximum(number, 1)
    variance = np.where(number > 0, variance, lines.noise**2)
    power = np.where(clean, lines.rms**2, 0.0)
    near, overall = uniform_filter1d(power, 41, mode="constant"), power.sum() / max(int(clean.sum()), 1)
    share = uniform_filter1d(clean.astype(float), 41, mode="constant")
    local = np.where(share > 0.2, near / np.maximum(share, 1e-9), overall) / max(overall, 1e-12)
    own = np.where(clean, local, np.maximum(local, lines.rms**2 / max(overall, 1e-12)))
    return np.sqrt(np.einsum("nt,nt->n", fits.gain**2, variance[distance]) * own) / found.stretch


def _edge_doubt(found: Crossings, lines: _Lines, there: np.ndarray) -> np.ndarray:
    """(N,) by how much an edge of the background along the antenna may draw the points aside, px."""
    share = uniform_filter1d(there.astype(float), EDGE_RUN, mode="constant")
    moved, noise = (
        uniform_filter1d(np.where(there, values, 0.0), EDGE_RUN, mode="constant") / np.maximum(share, 1e-9)
        for values in (lines.fits.stepped, (lines.noise * lines.fits.stepped_unit) ** 2)
    )
    # running sums leave rounding below zero
    deviation = np.sqrt(np.maximum(noise, 0.0) / np.maximum(EDGE_RUN * share, 1.0))
    return np.where(np.abs(moved) > EDGE_NOTICED * deviation, np.abs(moved), 0.0) / found.stretch


def _without_strays(
    found: Crossings, lines: _Lines, sigma: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the kept points that lie on one smooth curve, and that curve's course (N,) along the profiles."""
    share = found.along / max(float(found.along[-1]), 1e-6)
    weights = kept / np.maximum(sigma, 0.02) ** 2
    spread = max(smooth.median(sigma[kept]), 0.02)
    curve = smooth.fit(share, lines.centre, weights, (6.0 * spread, 4.0 * spread), 24, 1e-4)
    off = np.abs(lines.centre - curve.values)
    return kept & (off < np.maximum(STRAY * sigma * found.stretch, STRAY_PX)), curve.values


def _calibrated(
    found: Crossings, lines: _Lines, sigma: np.ndarray, doubt: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) deviations as the kept points scatter about a smooth curve, and those (N,) of points that count as one each.

    A profile's residuals do not show by how much noise that the camera has filtered, or a shape that is not quite
    right, moves the line; its neighbours do. What neighbours share shows in means of runs: they scatter by more than
    those of independent points.
    """
    share, spread = found.along / max(float(found.along[-1]), 1e-6), max(smooth.median(sigma[kept]), 0.02)
    total = np.maximum(np.hypot(sigma, doubt), 1e-9)
    weights = kept / np.maximum(total, 0.02) ** 2
    curve = smooth.fit(share, lines.centre, weights, (6.0 * spread, 6.0 * spread), CURVE_PIECES, 1e-6)
    off = ((lines.centre - curve.values) / (found.stretch * total))[kept]
    count = len(off)
    # where an edge may draw points aside, their scatter says little of the noise
    trusted = (sigma / total)[kept] ** 2
    square = off**2 * (count / max(count - CURVE_PIECES - 2.0, 0.5 * count))
    overall = (LIKELY_POINTS + float(trusted @ square)) / (LIKELY_POINTS + float(trusted.sum()))
    near = overall + uniform_filter1d(trusted * (square - overall), NEAR_POINTS, mode="nearest")
    scale = np.ones(len(sigma))
    scale[kept] = np.sqrt(0.5 * (overall + np.maximum(near, 0.0)))
    sums = np.cumsum(np.append(0.0, off / scale[kept]))
    runs = (sums[RUN:] - sums[:-RUN]) / RUN
    # second differences, which a curve that is too stiff or too supple changes little
    bends = RUN / 6.0 * (runs[2 * RUN :] - 2.0 * runs[RUN:-RUN] + runs[: -2 * RUN]) ** 2
    weight = trusted[RUN + RUN // 2 :][: len(bends)] / RUN
    shared = (LIKELY_RUNS + float(weight @ bends)) / (LIKELY_RUNS + float(weight.sum()))
    sigma = sigma * scale
    return np.hypot(sigma, doubt), np.sqrt(sigma**2 * max(shared, 1.0) + EDGE_RUN * doubt**2)


def _noise(rms: np.ndarray, half: int) -> float:
    """The picture's noise from the profiles' residuals (N,), of which more than half may be disturbed."""
    return smooth.quantile(rms, QUIET) / _quiet_part(2 * half - 3) + 1e-6 if len(rms) else 1e-6


@lru_cache(maxsize=32)
def _quiet_part(freedom: int) -> float:
    return float(np.sqrt(chdtri(freedom, 1.0 - QUIET) / freedom))
