"""Measure the antenna to a fraction of a pixel: a line profile fitted to the raw pixels of every column it crosses.

Where the antenna runs more upward than sideways, of every row. Raw pixels, because interpolated ones share their
noise, and shift a thin line with its phase on the pixel grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from .corridor import normals, resample

SEEN_RATIO = 6.0
"""Least amplitude over its standard deviation for a profile to count as seen."""
LEAST_SEEN = 0.2
"""Least fraction of the guide that must be seen for there to be an antenna at all."""
BROAD, LEAST_SEEN_BROAD = 1.8, 0.6
"""So much broader than expected it may be an antenna out of focus, or a soft edge: then more must be seen of it."""
QUIET = 0.4
"""Quantile of the profiles' residuals taken for the picture's noise: more than half may lie beside an object."""
DISTURBED = 1.8
"""Profiles that leave this many times the noise show something beside the antenna, which draws the line aside."""
LEAST_CLEAN = 0.3
"""With less than this fraction undisturbed, disturbed profiles are kept too, with the deviations that they deserve."""
MARGIN_PX = 2
"""Columns dropped on either side of a gap: part of their profile shows what hides the antenna."""


@dataclass(frozen=True, eq=False)
class Centreline:
    """The antenna's centreline in one picture, ordered from clamp to tip.

    Attributes
    ----------
    points_px : (N, 2).
    sigma_px : (N,) standard deviation across the antenna.
    seen : fraction of the guide where the antenna was seen.
    amplitude : median height of the line above its background, grey levels.
    breadth : how broad the line is, over what its width and an ordinary lens make of it.
    """

    points_px: np.ndarray
    sigma_px: np.ndarray
    seen: float
    amplitude: float
    breadth: float

    @property
    def found(self) -> bool:
        """Whether enough of the antenna was seen to speak of one."""
        least = LEAST_SEEN if self.breadth < BROAD else LEAST_SEEN_BROAD
        return self.seen >= least and len(self.points_px) >= 12


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Where a guide crosses the middles of columns (or rows): the raw profiles there.

    Attributes
    ----------
    points : (N, 2) px.
    axis : (N,) index of the coordinate along the profile: 1 (v) where the guide runs sideways, 0 (u) where upward.
    stretch : (N,) length along the profile per length across the antenna, at most √2.
    across : (N, T) distance along the profile from the guide, px.
    profiles : (N, T) grey levels; NaN outside the picture.
    """

    points: np.ndarray
    axis: np.ndarray
    stretch: np.ndarray
    across: np.ndarray
    profiles: np.ndarray


def _crossings(image: np.ndarray, guide: np.ndarray, half: int) -> _Crossings:
    normal = normals(guide)
    axis = (np.abs(normal[:, 1]) >= np.abs(normal[:, 0])).astype(int)
    found = []
    for along in (0, 1):
        a, b = guide[:-1, along], guide[1:, along]
        column = np.ceil(np.minimum(a, b))
        hit = (axis[:-1] == 1 - along) & (column < np.maximum(a, b))
        part = ((column - a) / np.where(a == b, 1.0, b - a))[:, None]
        points = guide[:-1] + part * np.diff(guide, axis=0)
        found.append((np.flatnonzero(hit), points[hit], np.full(hit.sum(), 1 - along)))
    index, points, axis = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(index, kind="stable")
    index, points, axis = index[order], points[order], axis[order]
    rows = np.arange(len(points))
    middle = np.round(points[rows, axis])
    offsets = np.arange(-half, half + 1)
    where = np.repeat(np.round(points).astype(int)[:, None], len(offsets), axis=1)
    where[rows, :, axis] = (middle[:, None] + offsets).astype(int)
    height, width = image.shape
    inside = (where >= 0).all(axis=-1) & (where[..., 0] < width) & (where[..., 1] < height)
    grey = image[np.clip(where[..., 1], 0, height - 1), np.clip(where[..., 0], 0, width - 1)]
    return _Crossings(
        points=points,
        axis=axis,
        stretch=1.0 / np.abs(normal[index][rows, axis]),
        across=middle[:, None] + offsets - points[rows, axis][:, None],
        profiles=np.where(inside, grey, np.nan).astype(float),
    )


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines fitted to N profiles of T pixels.

    Attributes
    ----------
    centre, amplitude : (N,).
    unit_centre, unit_amplitude : (N,) their standard deviations, were the noise of every pixel one.
    own_centre : (N,) standard deviation of the centre by the profile's own residuals, pixel by pixel.
    rms : (N,) root mean square of the residuals, freed of the four parameters.
    """

    centre: np.ndarray
    amplitude: np.ndarray
    unit_centre: np.ndarray
    unit_amplitude: np.ndarray
    own_centre: np.ndarray
    rms: np.ndarray


def _fit(profiles: np.ndarray, across: np.ndarray, scale: np.ndarray, centre: np.ndarray, steps: int = 5) -> _Lines:
    """Gauss–Newton for a Gaussian line of known width (N,) on a sloping background, all profiles (N, T) at once."""
    reach = np.abs(across).max()
    for _ in range(steps):
        t = (across - centre[:, None]) / scale[:, None]
        line = np.exp(-0.5 * t**2)
        basis = np.stack([np.ones_like(line), across / reach, line, line * t / scale[:, None]], axis=-1)
        normal_matrix = np.swapaxes(basis, 1, 2) @ basis + 1e-9 * np.eye(4)
        inverse = np.linalg.inv(normal_matrix)
        coefficients = inverse @ (np.swapaxes(basis, 1, 2) @ profiles[..., None])
        amplitude = coefficients[:, 2, 0]
        safe = np.where(np.abs(amplitude) > 1e-6, amplitude, 1e-6)
        centre = np.clip(centre + np.clip(coefficients[:, 3, 0] / safe, -1.0, 1.0), -reach, reach)
    unit = np.sqrt(np.clip(np.diagonal(inverse, axis1=1, axis2=2), 0.0, None))
    residuals = profiles - (basis @ coefficients)[..., 0]
    squares = residuals**2
    noise_squares = 0.5 * np.diff(residuals, axis=0, append=residuals[-2:-1]) ** 2
    gain = inverse @ np.swapaxes(basis, 1, 2)
    # What a pixel's residual lacks because the pixel itself drew the line towards it.
    left = 1.0 - np.minimum((np.swapaxes(gain, 1, 2) * basis).sum(axis=-1), 0.9)
    own = np.sqrt((gain[:, 3] ** 2 * noise_squares / left).sum(axis=1))
    rms = np.sqrt(squares.sum(axis=1) / (squares.shape[1] - basis.shape[2]))
    return _Lines(centre, amplitude, unit[:, 3] / np.abs(safe), unit[:, 2], own / np.abs(safe), rms)


def _line_scale(found: _Crossings, guess: float, centre: np.ndarray) -> float:
    """The Gaussian width across the antenna that fits this picture's profiles best."""
    few = slice(None, None, max(1, len(found.points) // 80))

    def misfit(scale: float) -> float:
        fitted = _fit(found.profiles[few], found.across[few], scale * found.stretch[few], centre[few], steps=3)
        return float(np.median(fitted.rms))

    best = minimize_scalar(misfit, bounds=(0.5 * guess, 2.5 * guess), method="bounded", options={"xatol": 0.02})
    return float(best.x)


NOTHING = Centreline(np.empty((0, 2)), np.empty(0), 0.0, 0.0, 1.0)


def measure(image: np.ndarray, guide_px: np.ndarray, width_px: float, bright: bool = True) -> Centreline:
    """The centreline near a guide, one point for every column (or row) of pixels that it crosses.

    Parameters
    ----------
    image : (H, W) float32 grey levels.
    guide_px : (K, 2) a path within about one antenna width of the truth, from clamp to tip.
    width_px : the antenna's width.
    bright : brighter than its background.

    Notes
    -----
    A point is kept where the line's amplitude stands out from its noise and agrees with the rest of the antenna's, and
    the profile leaves no more residual than noise does: an object's edge beside the antenna draws the line aside, and
    alike for many neighbours.
    """
    guide = resample(guide_px, 0.5)[0] if len(guide_px) > 1 else guide_px
    if len(guide) < 8:
        return NOTHING
    guide = gaussian_filter1d(guide, 8.0, axis=0, mode="nearest")
    half = int(np.ceil(2.0 * width_px + 4.0))
    found = _crossings(image if bright else -image, guide, half)
    inside = np.isfinite(found.profiles).all(axis=1)
    if inside.sum() < 4:
        return NOTHING
    profiles = np.where(inside[:, None], found.profiles, 0.0)
    near = np.abs(found.across) <= max(2.5, width_px)
    start = np.take_along_axis(found.across, np.where(near, profiles, -np.inf).argmax(axis=1)[:, None], axis=1)[:, 0]
    expected = float(np.hypot(0.3 * width_px, 0.7))
    scale = _line_scale(_only(found, inside), expected, start[inside])
    lines = _fit(profiles, found.across, scale * found.stretch, start)
    rms, noise = lines.rms, _noise(lines.rms[inside], found.across.shape[1] - 4)
    seen = inside & (np.abs(lines.centre) < half - 2.0)
    seen &= lines.amplitude > SEEN_RATIO * np.maximum(rms, noise) * lines.unit_amplitude
    if not seen.any():
        return NOTHING
    typical = float(np.median(lines.amplitude[seen]))
    seen &= (lines.amplitude > 0.3 * typical) & (lines.amplitude < 3.0 * typical)
    clean = seen & (rms < DISTURBED * noise)
    seen = clean if clean.mean() >= LEAST_CLEAN else seen & (rms < 4.0 * noise + 0.1 * typical)
    seen = binary_erosion(seen, iterations=MARGIN_PX, border_value=1)
    points = found.points.copy()
    points[np.arange(len(points)), found.axis] += lines.centre
    sigma = np.where(rms > DISTURBED * noise, rms, noise) * lines.unit_centre * _uneven(lines, clean, noise)
    sigma /= found.stretch
    return Centreline(points[seen], sigma[seen], float(seen.mean()), typical, scale / expected)


def _noise(rms: np.ndarray, freedom: int) -> float:
    """The picture's noise from the profiles' residuals (N,), of which more than half may be disturbed."""
    expected = np.sqrt(chi2.ppf(QUIET, freedom) / freedom)
    return float(np.quantile(rms, QUIET) / expected) + 1e-6


def _uneven(lines: _Lines, clean: np.ndarray, noise: float) -> float:
    """How much more the centres scatter than noise that is alike everywhere would make them: light brings its own."""
    if clean.sum() < 8:
        return 1.0
    even = noise * lines.unit_centre[clean]
    return float(np.clip(np.sqrt((lines.own_centre[clean] ** 2).sum() / (even**2).sum()), 0.3, 3.0))


def _only(found: _Crossings, chosen: np.ndarray) -> _Crossings:
    return _Crossings(
        found.points[chosen],
        found.axis[chosen],
        found.stretch[chosen],
        found.across[chosen],
        found.profiles[chosen],
    )
