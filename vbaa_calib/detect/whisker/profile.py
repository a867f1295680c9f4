"""Measure the antenna to a fraction of a pixel: its cross-section, as the picture shows it, fitted to raw profiles.

Raw pixels of every column that it crosses (of every row where it runs more upward than sideways), because interpolated
ones share their noise, and shift a thin line with its phase on the pixel grid.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vbaa_calib.core import smooth
from vbaa_calib.core.compiled import kernel
from vbaa_calib.core.smooth import END_VALUE, ZEROS, median, quantile, running_mean

from .acceptance import FittedLine, accepted, look_of, without_margins
from .centreline import NOTHING, Centreline
from .crossings import Crossings, crossings, every, pixels_off, shares, tapered, too_short
from .line_shape import (
    CrossSection,
    Fits,
    Shapes,
    binned,
    expected,
    fit,
    half_width_px,
    learn,
    lopsided,
    nearest,
    shapes,
    shown,
)
from .path_refinement import NOTHING_KNOWN, Known, refine_path
from .reflectance import learn_reflectance, mean_shape, stiffened
from .visible_end import Look, visible_end

SEEN_RATIO, SEEN_CHANGING = 4.5, 3.5
"""Least height over its standard deviation for a profile to count as seen; and where the line changes along its length:
what its neighbours show tells its sign and shape."""
QUIET = 0.4
"""Quantile of the profiles' residuals taken for the picture's noise: more than half may lie beside an object."""
DISTURBED = 1.8
"""Profiles that leave this many times the noise show something beside the antenna, which draws the line aside."""
_LEAST_CLEAN = 0.3
"""With less than this fraction undisturbed, disturbed profiles are kept too, with the deviations that they deserve."""
_MARGIN_PX = 2
"""Columns dropped on either side of a gap: part of their profile shows what hides the antenna."""
STRAY, STRAY_PX = 5.0, 0.12
"""A point this many deviations, and at least so far, off a smooth curve through its neighbours is another thing's."""
_TRAINING_PROFILES = 160
"""The cross-section is learned from about so many profiles."""
ALIKE = 0.8
"""Length of the mean phase on the pixel grid above which the profiles lie alike."""
LOPSIDED, FLANKED_PX, PULLED = 0.012, 5.0, 0.05
"""With its sides so different, as a part of its height, a line this broad is measured by its own reflectance; a
highlight, or a shadow beside it, still pulls it by up to this part of its width, half of it as a deviation, alike for
all its points."""
FAINTER = 0.7
"""Where less than this part of the usual height is left, the same highlight, if it is clear, pulls the line more."""
_END_PROFILES = 40
"""The antenna's look at its visible end is that of so many profiles before it."""
EDGE_RUN, EDGE_NOTICED, SHARED_RUN = 21, 3.0, 100
"""An object's edge beside the antenna draws about so many neighbouring points aside alike: what a step of the
background behind the line would move them by, on average, is doubt where it exceeds so many of its own deviations.
A wrong look of the antenna draws about so many aside alike."""
_CURVE_PIECES = 12
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
_BESIDE_PX = 3.0
"""How much is looked at on either side of an antenna whose polarity changes: what lies farther is another thing's."""
_BROADER = 1.5
"""A line so much broader than expected is measured again with longer profiles."""


def measure(image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool | None = True) -> Centreline:
    """The centreline near a guide, one point for every column (or row) of pixels that it crosses.

    Parameters
    ----------
    image : (H, W) grey levels.
    guide_px : (K, 2) a path within about one antenna width of the truth, from clamp to tip.
    width_px : the antenna's width.
    bright : brighter than its background; None: here brighter, there darker.

    A point is kept where its height stands out from the noise and agrees with its neighbours', its profile leaves no
    more residual than noise does, and it lies on a smooth curve with the others.
    """
    if too_short(guide_px):
        return NOTHING
    return measure_on(image, refine_path(image, guide_px, width_px, width_px + 2.0, bright).path_px, width_px, bright)


def measure_on(
    image: np.ndarray,
    path_px: np.ndarray,
    width_px: float,
    bright: bool | None,
    blurred_px: float = 0.0,
    known: Known = NOTHING_KNOWN,
) -> Centreline:
    """As `measure`, along a path (K, 2) on the antenna; `blurred_px` : by how much broader the line may be."""
    half = int(np.ceil(0.8 * (width_px + blurred_px) + 5.0))
    if bright is None:
        path_px, half = stiffened(path_px), int(np.ceil(0.5 * width_px + _BESIDE_PX))
    line = _measured(image, path_px, width_px, half, bright, known)
    if line.breadth > _BROADER:
        half = int(np.ceil(half + 0.7 * line.breadth * width_px + 2.0))
        wider = _measured(image, path_px, width_px, half, bright, known)
        return wider if len(wider.points_px) >= len(line.points_px) else line
    return line


def _measured(
    image: np.ndarray, path_px: np.ndarray, width_px: float, half: int, bright: bool | None, antenna: Known
) -> Centreline:
    found = crossings(image, path_px, half, bright)
    if found.inside.sum() < LEAST_PROFILES:
        return NOTHING
    width_px = round(float(width_px), 2)
    known, quiet = shapes(width_px, ORDINARY_BLUR_PX, half + 2), _quiet_part(2 * half - 3)
    line, section = _line(found, known, width_px, quiet, bright is None)
    if not line.kept.any():
        return NOTHING
    seen = look_of(found, line, antenna)
    return accepted(line, seen, visible_end(image, seen.guide, line.kept, Look(section, half, line.noise, bright)))


@kernel
def _line(
    found: Crossings, known: Shapes, width_px: float, quiet: float, changing: bool
) -> tuple[FittedLine, CrossSection]:
    """The line that profiles show, as far as it is to be trusted, and what it looks like across."""
    if changing:
        lines = _changing_lines(found, width_px, quiet, (np.empty(0), 0.0))
    else:
        lines, broadening, about = _lines(found, known, width_px, quiet)
        if about[1] > 0.0:
            lines = _changing_lines(broadening, width_px, quiet, about)
    return _fitted_line(found, lines, known, changing), lines.section


class _Lines(NamedTuple):
    """The fitted lines.

    Attributes
    ----------
    centre : (N,) along the profiles from the path, px.
    fits : the last fit.
    section : the cross-section; at the line's end, where it changes. half_width_px : half its width.
    noise : of a pixel, grey levels.
    usual : (N,) height that the line should have. shared : (N,) error of the place that neighbours share, px.
    sure : (N,) how surely it is a line, not one edge.
    """

    centre: np.ndarray
    fits: Fits
    section: CrossSection
    half_width_px: float
    noise: float
    usual: np.ndarray
    shared: np.ndarray
    sure: np.ndarray


@kernel
def _lines(
    found: Crossings, known: Shapes, width_px: float, quiet: float
) -> tuple[_Lines, Crossings, tuple[np.ndarray, float]]:
    """Learn the cross-section from some of the profiles, then fit it to all.

    At first an antenna in focus; then one at the blur that is seen; then whatever the profiles show. Where all of them
    lie alike on the pixel grid, a free shape and a shift could not be separated, and the second is kept. The shape is
    broader where the antenna is nearer to the camera.

    Returns
    -------
    The lines; the crossings in widths of the broadening line; and, where the line is so lopsided that it must be
    measured by its own reflectance, its course (N,) and by how much it may be pulled aside, px; else zero.
    """
    half = found.profiles.shape[1] // 2
    some = every(found, max(1, len(found.along) // _TRAINING_PROFILES))
    section, curve, base = known.ordinary, np.zeros(len(found.along)), np.zeros(len(some.along))
    pulled, reflecting = 0.0, 0.0
    for step in range(2):
        fits = fit(section, some, base)
        chosen = _training_profiles(fits, some.inside, quiet)
        if chosen.sum() < 4:
            break
        if step:
            # not at first: the path is good enough to tell the blur by
            at = some.along / max(found.along[-1], 1e-6)
            course = smooth.fit(at, fits.shift, chosen.astype(np.float64), (1.0, 0.3), 12, 1e-3)
            base, curve = course.values, smooth.at(course, shares(found))
        heights, taper = shown(section, some, base, fits, chosen)
        found, some = tapered(found, taper), tapered(some, taper)
        by_distance = binned(some, base, heights, chosen, half + 2)
        phase = 2.0 * np.pi * some.across[chosen, 0]
        if step == 0 or np.hypot(np.cos(phase).mean(), np.sin(phase).mean()) >= ALIKE:
            section = nearest(by_distance, known)
        else:
            section = learn(by_distance, known)
            sides = lopsided(by_distance, median(fits.rms[chosen] / fits.height[chosen]))
            pulled = PULLED * width_px * min(max((sides - 0.5 * LOPSIDED) / LOPSIDED, 0.0), 1.0)
            reflecting = pulled if width_px > FLANKED_PX and sides > LOPSIDED else 0.0
    fits = fit(section, found, curve)
    noise = _noise(fits.rms[found.inside], quiet)
    seen_at = found.inside & (fits.height > SEEN_RATIO * np.maximum(fits.rms, noise) * fits.unit_height)
    usual = np.full(len(curve), median(fits.height[seen_at]) if seen_at.any() else 0.0)
    shared = np.full(len(curve), 0.5 * pulled)
    if pulled > 0.5 * PULLED * width_px:
        near = running_mean(np.maximum(fits.height, 0.0), NEAR_POINTS, END_VALUE)
        shared *= np.maximum(FAINTER * usual / np.maximum(near, 0.1 * usual + 1e-9), 1.0)
    lines = _Lines(curve + fits.shift, fits, section, half_width_px(section), noise, usual, shared, np.ones(len(curve)))
    return lines, found, (curve, reflecting)


@kernel
def _changing_lines(found: Crossings, width_px: float, quiet: float, about: tuple[np.ndarray, float]) -> _Lines:
    """The fitted lines of an antenna with its own reflectance; about a course (N,), within px, where that is known."""
    learned = learn_reflectance(found, width_px, ORDINARY_BLUR_PX, about[0], about[1])
    found, reflectance = tapered(found, learned.taper), learned.reflectance
    fits = fit(reflectance.section, found, learned.course)
    noise = _noise(fits.rms[found.inside], quiet)
    seen = np.flatnonzero(found.inside & (fits.height > SEEN_RATIO * noise * fits.unit_height))
    section = mean_shape(reflectance, seen[-_END_PROFILES:] if len(seen) else np.arange(len(fits.height)))
    broad = half_width_px(expected(reflectance.width_px, reflectance.blur_px, found.profiles.shape[1] // 2 + 2))
    centre, usual = learned.course + fits.shift, reflectance.height
    fits.height[learned.none] = 0.0
    return _Lines(centre, fits, section, broad, noise, usual, learned.shared_px, learned.sure)


@kernel
def _training_profiles(fits: Fits, inside: np.ndarray, quiet: float) -> np.ndarray:
    """(N,) profiles that show a clear line, as high as most, and nothing else."""
    noise = _noise(fits.rms[inside], quiet)
    good = inside & (fits.height > SEEN_RATIO * noise * fits.unit_height) & (np.abs(fits.shift) < 1.5)
    if not good.any():
        return good
    typical = median(fits.height[good])
    good &= (fits.height > 0.4 * typical) & (fits.height < 2.5 * typical)
    calm = good & (fits.rms < DISTURBED * noise + 0.02 * typical)
    return calm if calm.sum() >= 0.3 * good.sum() else good


@kernel
def _fitted_line(found: Crossings, lines: _Lines, known: Shapes, changing: bool) -> FittedLine:
    """What of the lines is kept, and how far to trust it."""
    breadth = lines.half_width_px / half_width_px(known.ordinary)
    kept, clean, there = _kept(found, lines, changing)
    sigma, effective, course = np.zeros(len(kept)), np.zeros(len(kept)), lines.centre
    if kept.any():
        sigma = _deviations(found, lines, clean if clean.sum() >= LEAST_PROFILES else kept)
        edge = _edge_doubt(found, lines, there)
        doubt = np.hypot(edge, lines.shared)
        kept, course = _without_strays(found, lines, np.hypot(sigma, doubt), kept)
        kept = without_margins(kept, 1 if changing else _MARGIN_PX)
    if kept.any():
        sigma, effective = _calibrated(found, lines, sigma, edge, kept)
    sure = (lines.sure * kept).sum() / max(kept.sum(), 1)
    return FittedLine(
        lines.centre, course, sigma, effective, kept, lines.fits.height, lines.noise, breadth, changing, sure
    )


@kernel
def _kept(found: Crossings, lines: _Lines, changing: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) which profiles show the antenna well enough, which show nothing else beside it, which show it at all.

    One that changes along its length mostly lies before something: its profiles are judged by its height alone, and the
    disturbed ones kept with the deviations that they deserve.
    """
    fits, rms, noise = lines.fits, lines.fits.rms, lines.noise
    half = 0.5 * (fits.gain.shape[1] - 1)
    least = np.full(len(rms), SEEN_CHANGING * noise) if changing else SEEN_RATIO * np.maximum(rms, noise)
    seen = found.inside & (np.abs(lines.centre) < half - 2.0) & (fits.height > least * fits.unit_height)
    if not seen.any():
        return seen, seen, seen
    seen &= (fits.height > 0.3 * lines.usual) & (fits.height < 3.0 * lines.usual)
    clean = seen & (rms < DISTURBED * noise)
    if clean.mean() >= _LEAST_CLEAN and not changing:
        return clean, clean, seen
    kept = seen & (rms < 4.0 * noise + (0.3 if changing else 0.1) * lines.usual)
    return kept, clean, seen


@kernel
def _deviations(found: Crossings, lines: _Lines, clean: np.ndarray) -> np.ndarray:
    """(N,) standard deviation across the antenna, from the residuals at each distance from the centre.

    Where along the antenna there is more noise than elsewhere, the deviations are larger in proportion.
    """
    fits, (count, length) = lines.fits, found.across.shape
    number, squares = np.zeros(2 * length), np.zeros(2 * length)
    for n in range(count):
        if clean[n]:
            for t in range(length):
                at = pixels_off(found.across[n, t] - lines.centre[n], length)
                number[at] += 1.0
                squares[at] += fits.residuals[n, t] ** 2 / fits.freed[n, t]
    variance = np.where(number > 0.0, squares / np.maximum(number, 1.0), lines.noise**2)
    power = np.where(clean, fits.rms**2, 0.0)
    near, overall = running_mean(power, 41, ZEROS), power.sum() / max(clean.sum(), 1)
    share = running_mean(clean.astype(np.float64), 41, ZEROS)
    sigma = np.empty(count)
    for n in range(count):
        own = (near[n] / max(share[n], 1e-9) if share[n] > 0.2 else overall) / max(overall, 1e-12)
        if not clean[n]:
            own = max(own, fits.rms[n] ** 2 / max(overall, 1e-12))
        square = 0.0
        for t in range(length):
            at = pixels_off(found.across[n, t] - lines.centre[n], length)
            square += fits.gain[n, t] ** 2 * variance[at]
        sigma[n] = np.sqrt(square * own) / found.stretch[n]
    return sigma


@kernel
def _edge_doubt(found: Crossings, lines: _Lines, there: np.ndarray) -> np.ndarray:
    """(N,) by how much an edge of the background along the antenna may draw the points aside, px."""
    share = running_mean(there.astype(np.float64), EDGE_RUN, ZEROS)
    moved = running_mean(np.where(there, lines.fits.stepped, 0.0), EDGE_RUN, ZEROS) / np.maximum(share, 1e-9)
    unit = np.where(there, (lines.noise * lines.fits.stepped_unit) ** 2, 0.0)
    noise = running_mean(unit, EDGE_RUN, ZEROS) / np.maximum(share, 1e-9)
    # running sums leave rounding below zero
    deviation = np.sqrt(np.maximum(noise, 0.0) / np.maximum(EDGE_RUN * share, 1.0))
    return np.where(np.abs(moved) > EDGE_NOTICED * deviation, np.abs(moved), 0.0) / found.stretch


@kernel
def _without_strays(
    found: Crossings, lines: _Lines, sigma: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) the kept points that lie on one smooth curve, and that curve's course (N,) along the profiles."""
    weights = kept / np.maximum(sigma, 0.02) ** 2
    spread = max(median(sigma[kept]), 0.02)
    course = smooth.fit(shares(found), lines.centre, weights, (6.0 * spread, 4.0 * spread), 24, 1e-4).values
    off = np.abs(lines.centre - course)
    return kept & (off < np.maximum(STRAY * sigma * found.stretch, STRAY_PX)), course


@kernel
def _calibrated(
    found: Crossings, lines: _Lines, sigma: np.ndarray, edge: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) deviations as the kept points scatter about a smooth curve, and those (N,) of points that count as one each.

    A profile's residuals do not show by how much noise that the camera has filtered, or a shape that is not quite
    right, moves the line; its neighbours do. What neighbours share shows in means of runs: they scatter by more than
    those of independent points.
    """
    spread = max(median(sigma[kept]), 0.02)
    doubt = np.hypot(edge, lines.shared)
    total = np.maximum(np.hypot(sigma, doubt), 1e-9)
    weights = kept / np.maximum(total, 0.02) ** 2
    curve = smooth.fit(shares(found), lines.centre, weights, (6.0 * spread, 6.0 * spread), _CURVE_PIECES, 1e-6).values
    off = ((lines.centre - curve) / (found.stretch * total))[kept]
    count = len(off)
    # where an edge may draw points aside, their scatter says little of the noise
    trusted = (sigma / total)[kept] ** 2
    square = off**2 * (count / max(count - _CURVE_PIECES - 2.0, 0.5 * count))
    overall = (LIKELY_POINTS + (trusted * square).sum()) / (LIKELY_POINTS + trusted.sum())
    near = overall + running_mean(trusted * (square - overall), NEAR_POINTS, END_VALUE)
    scale = np.sqrt(0.5 * (overall + np.maximum(near, 0.0)))
    sums = np.zeros(count + 1)
    for k in range(count):
        sums[k + 1] = sums[k] + off[k] / scale[k]
    told, informed = LIKELY_RUNS, LIKELY_RUNS
    for k in range(count + 1 - 3 * RUN):
        # second differences, which a curve that is too stiff or too supple changes little
        bend = (sums[k + 3 * RUN] - 3.0 * sums[k + 2 * RUN] + 3.0 * sums[k + RUN] - sums[k]) / RUN
        weight = trusted[k + RUN + RUN // 2] / RUN
        told += weight * RUN / 6.0 * bend**2
        informed += weight
    calibrated = sigma.copy()
    calibrated[kept] *= scale
    effective = np.sqrt(calibrated**2 * max(told / informed, 1.0) + EDGE_RUN * edge**2 + SHARED_RUN * lines.shared**2)
    return np.hypot(calibrated, doubt), effective


@kernel
def _noise(rms: np.ndarray, quiet: float) -> float:
    """The picture's noise from the profiles' residuals (N,), of which more than half may be disturbed."""
    return quantile(rms, QUIET) / quiet + 1e-6 if len(rms) else 1e-6


@lru_cache(maxsize=32)
def _quiet_part(freedom: int) -> float:
    """The `QUIET` quantile of the root mean square of so many normal numbers."""
    from scipy.special import chdtri  # slow to load

    return float(np.sqrt(chdtri(freedom, 1.0 - QUIET) / freedom))
