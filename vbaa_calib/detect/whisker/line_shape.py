"""The antenna's cross-section as this picture shows it: paint, light, focus and motion, learned from its own profiles.

A function of the distance from the centreline, in cubic splines, symmetric; what is not is `reflectance`'s.
With it every profile is a least-squares problem in four unknowns: level and slope of the background, the line's
height, its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np

from .crossings import Crossings

PER_PX = 32
"""Rows of a tabled shape per pixel."""
BINS_PER_PX = 4
WIDTHS, BLURS_PX = (0.85, 1.0, 1.2), (0.45, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 3.0, 4.0)
"""Widths, as parts of the antenna's, and blurs that are tried."""
MOST_TAPER = 0.6
"""By which part the line may be broader at one end than at the other."""
LIKELY_TAPER = 0.3
"""Deviation of that beforehand: where little of the line is seen, its noise is no taper."""
KNOT_PX = 0.85
"""Spacing of the splines' knots: finer than the point spread of an ordinary lens."""


class CrossSection(Protocol):
    """What a line looks like across."""

    def at(self, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heights and their derivatives at distances (N, T) from the centre, px."""
        ...


@dataclass(frozen=True, eq=False)
class LineShape:
    """A cross-section of height one: (2R + 1,) `values` and `slopes`, `PER_PX` rows a pixel, the middle one at 0 px."""

    values: np.ndarray
    slopes: np.ndarray

    def at(self, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The shape and its derivative at distances (N, T) from the centre, px."""
        last = len(self.values) - 1
        place = np.clip(across * PER_PX + 0.5 * last, 0.0, last)
        row = place.astype(np.intp)
        place -= row
        rises, turns = self._steps
        return self.values.take(row) + rises.take(row) * place, self.slopes.take(row) + turns.take(row) * place

    @cached_property
    def _steps(self) -> tuple[np.ndarray, np.ndarray]:
        """(2R + 1,) from every row of `values`, and of `slopes`, to the next; none from the last."""
        return np.diff(self.values, append=self.values[-1]), np.diff(self.slopes, append=self.slopes[-1])

    @property
    def half_width_px(self) -> float:
        """Half the width at half the height."""
        return float((self.values > 0.5).sum()) / (2.0 * PER_PX)


def expected(width_px: float, blur_px: float, reach_px: int) -> LineShape:
    """A round, evenly painted antenna of this width, seen through this blur and the pixel's own square."""
    t = np.arange(-reach_px * PER_PX, reach_px * PER_PX + 1) / PER_PX
    half = 0.5 * width_px
    body = np.where(np.abs(t) < half, 0.4 + 0.6 * np.sqrt(np.clip(1.0 - (t / half) ** 2, 0.0, None)), 0.0)
    spread = np.exp(-0.5 * (t / np.hypot(blur_px, 0.29)) ** 2)
    seen = np.convolve(body, spread / spread.sum(), mode="same")
    seen /= seen.max()
    return LineShape(seen, np.gradient(seen) * PER_PX)


@lru_cache(maxsize=32)
def _splines(reach_px: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Even cubic splines over ±`reach_px`: values in the bins (B, M), values and slopes at the table's rows (R, M)."""
    from scipy.interpolate import BSpline

    inner = max(4, int(np.ceil(reach_px / KNOT_PX)))
    knots = reach_px / inner * np.arange(-inner - 3, inner + 4)
    count = len(knots) - 4
    full = BSpline(knots, np.eye(count), 3, extrapolate=True)
    basis = np.minimum(np.eye(count) + np.eye(count)[::-1], 1.0)[:, : (count + 1) // 2]
    bins = (np.arange(2 * reach_px * BINS_PER_PX) + 0.5) / BINS_PER_PX - reach_px
    table = np.arange(2 * reach_px * PER_PX + 1) / PER_PX - reach_px
    return full(bins) @ basis, full(table) @ basis, full.derivative()(table) @ basis


@lru_cache(maxsize=16)
def _family(width_px: float, reach_px: int) -> tuple[list[LineShape], np.ndarray]:
    """Shapes of antennas somewhat thinner and broader, from sharp to far out of focus, and their bins (F, B)."""
    shapes = [expected(width_px * part, blur, reach_px) for part in WIDTHS for blur in BLURS_PX]
    rows = (np.arange(2 * reach_px * BINS_PER_PX) + 0.5) * (PER_PX / BINS_PER_PX)
    return shapes, np.stack([shape.values[np.rint(rows).astype(np.intp)] for shape in shapes])


@dataclass(frozen=True, eq=False)
class Binned:
    """Heights by distance from the centre: how many (B,) and their means (B,), `BINS_PER_PX` a pixel."""

    count: np.ndarray
    mean: np.ndarray

    @property
    def reach_px(self) -> int:
        """How far the bins reach to either side."""
        return len(self.count) // (2 * BINS_PER_PX)

    def lopsided(self, noise: float) -> float:
        """Root mean square difference of the two sides where the line is, beyond what `noise` of one height makes."""
        apart = 0.5 * (self.mean - self.mean[::-1])
        weight = np.minimum(self.count, self.count[::-1]) * (np.abs(self.mean) + np.abs(self.mean[::-1]) > 0.2)
        total = max(float(weight.sum()), 1.0)
        by_chance = 0.5 * noise**2 * float((weight > 0).sum()) / total
        return float(np.sqrt(max(float((weight * apart**2).sum()) / total - 2.0 * by_chance, 0.0)))


def binned(across: np.ndarray, heights: np.ndarray, reach_px: int) -> Binned:
    """Heights (N, T), grey levels less the background over the line's height, at distances (N, T) from the centre."""
    bins = 2 * reach_px * BINS_PER_PX
    at = np.clip((across + reach_px) * BINS_PER_PX, 0, bins).astype(np.intp).ravel()
    count = np.bincount(at, minlength=bins + 1)[:bins].astype(float)
    return Binned(count, np.bincount(at, heights.ravel(), bins + 1)[:bins] / np.maximum(count, 1.0))


def nearest(seen: Binned, width_px: float) -> LineShape:
    """The shape that an antenna of about this width has at the blur that the heights show."""
    shapes, family = _family(width_px, seen.reach_px)
    middle = family - (family @ seen.count / seen.count.sum())[:, None]
    mean = seen.mean - seen.mean @ seen.count / seen.count.sum()
    power = (middle**2) @ seen.count
    # the height that fits each shape best is left free
    return shapes[int(((middle @ (seen.count * mean)) ** 2 / np.maximum(power, 1e-9)).argmax())]


def learn(seen: Binned) -> LineShape:
    """The smooth symmetric shape that the heights show, whatever it is."""
    bins, values, slopes = _splines(seen.reach_px)
    weighted = bins * seen.count[:, None]
    second = np.diff(np.eye(bins.shape[1]), 2, axis=0)
    penalty = 1e-3 * seen.count.mean() * (second.T @ second) + 1e-9 * (1.0 + seen.count.sum()) * np.eye(bins.shape[1])
    coefficients = np.linalg.solve(weighted.T @ bins + penalty, weighted.T @ seen.mean)
    # einsum, unlike a matrix product, wakes no threads for so little
    shape, slope = (np.einsum("rm,m->r", table, coefficients) for table in (values, slopes))
    shape -= 0.5 * (shape[0] + shape[-1])
    scale = float(shape.max())
    scale = scale if scale > 1e-6 else 1.0
    return LineShape(shape / scale, slope / scale)


@dataclass(frozen=True, eq=False)
class Fits:
    """Lines fitted to N profiles of T pixels.

    Attributes
    ----------
    shift : (N,) by how much the line lies beside the assumed centre, along the profile, px.
    height : (N,) grey levels.
    unit_height : (N,) the height's standard deviation, were the noise of every pixel one.
    gain : (N, T) derivative of the shift by each pixel.
    residuals : (N, T) grey levels.
    freed : (N, T) what of a pixel's variance its residual keeps.
    stepped : (N,) by how much further the line would lie along the profile if the background had a step behind it: an
        object's edge that runs along the antenna. stepped_unit : (N,) its deviation, were the noise of every pixel one.
    """

    shift: np.ndarray
    height: np.ndarray
    unit_height: np.ndarray
    gain: np.ndarray
    residuals: np.ndarray
    freed: np.ndarray
    stepped: np.ndarray
    stepped_unit: np.ndarray

    @property
    def rms(self) -> np.ndarray:
        """(N,) root mean square of the residuals, freed of the four unknowns."""
        return np.sqrt(np.einsum("nt,nt->n", self.residuals, self.residuals) / (self.residuals.shape[1] - 4))


@lru_cache(maxsize=32)
def _background(count: int) -> np.ndarray:
    """(T, 2) orthonormal level and slope."""
    t = np.arange(count) - (count - 1) / 2
    return np.stack([np.full(count, count**-0.5), t / np.sqrt((t**2).sum())], axis=1)


def without_background(rows: np.ndarray) -> np.ndarray:
    flat = _background(rows.shape[1])
    return rows - (rows @ flat) @ flat.T


def fit(shape: CrossSection, found: Crossings, centre: np.ndarray) -> Fits:
    """One Gauss–Newton step from the centres (N,), given along the profile from the path."""
    across = found.distances(centre)
    value, slope = shape.at(across)
    by_centre = (-found.side / found.stretch)[:, None]
    value, slope = without_background(value), without_background(slope * by_centre)
    grey = without_background(found.profiles)
    vv, vs, ss = (np.einsum("nt,nt->n", a, b) for a, b in ((value, value), (value, slope), (slope, slope)))
    vy, sy = np.einsum("nt,nt->n", value, grey), np.einsum("nt,nt->n", slope, grey)
    determinant = np.maximum(vv * ss - vs**2, 1e-9)
    height = (ss * vy - vs * sy) / determinant
    safe = np.where(np.abs(height) > 1e-6, height, 1e-6)
    by_pixel = (vv[:, None] * slope - vs[:, None] * value) / determinant[:, None]
    product = (vv * sy - vs * vy) / determinant
    residuals = grey - height[:, None] * value - product[:, None] * slope
    leverage = (
        (_background(grey.shape[1]) ** 2).sum(axis=1) + by_pixel * slope + value**2 / np.maximum(vv, 1e-9)[:, None]
    )
    # the step, less what height and place make of it
    step = without_background(np.clip(across, -1.0, 1.0))
    vb, sb = np.einsum("nt,nt->n", value, step), np.einsum("nt,nt->n", slope, step)
    moved = (vv * sb - vs * vb) / determinant
    apart = step - ((ss * vb - vs * sb) / determinant)[:, None] * value - moved[:, None] * slope
    power = np.maximum(np.einsum("nt,nt->n", apart, apart), 1e-9)
    return Fits(
        shift=np.clip(product / safe, -0.5 * grey.shape[1], 0.5 * grey.shape[1]),
        height=height,
        unit_height=np.sqrt(ss / determinant),
        gain=by_pixel / safe[:, None],
        residuals=residuals,
        freed=np.maximum(1.0 - leverage, 0.15),
        stepped=-moved / safe * np.einsum("nt,nt->n", apart, residuals) / power,
        stepped_unit=np.abs(moved / safe) / np.sqrt(power),
    )


def tapering(shape: LineShape, found: Crossings, centre: np.ndarray, fits: Fits, chosen: np.ndarray) -> float:
    """By which part the line is broader at the path's end than at its start, as the fits' residuals show it.

    `chosen` (N,) are the profiles that count. To first order in how the width changes.
    """
    across = found.distances(centre)[chosen]
    value, slope = shape.at(across)
    value, wider = without_background(value), without_background(-across * slope)
    wider -= value * (np.einsum("nt,nt->n", wider, value) / np.einsum("nt,nt->n", value, value))[:, None]
    height = fits.height[chosen]
    slopes = np.einsum("nt,nt->n", fits.residuals[chosen], wider) * height
    information = np.einsum("nt,nt->n", wider, wider) * height**2
    share = found.along[chosen] / max(float(found.along[-1]), 1e-6)
    share = share - (information @ share) / max(float(information.sum()), 1e-9)
    prior = float(np.median(fits.rms[chosen])) ** 2 / LIKELY_TAPER**2
    return float(np.clip((share @ slopes) / max(float(share**2 @ information) + prior, 1e-9), -MOST_TAPER, MOST_TAPER))
