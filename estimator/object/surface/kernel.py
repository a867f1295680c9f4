"""A Gaussian process with a linear trend, seen by values and by slopes: Matérn 5/2 (Rasmussen and Williams, Eqs. 4.17
and 9.1), in one or two coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist


@dataclass(frozen=True, eq=False)
class Functionals:
    """N views Σ value_c · h_c(x) + slope_c · ∇h_c(x) of C functions at x (N, D), m: value (N, C), slope (N, C, D)."""

    x: np.ndarray
    value: np.ndarray
    slope: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    def select(self, which: np.ndarray) -> Functionals:
        """Some of the views."""
        return Functionals(self.x[which], self.value[which], self.slope[which])

    @property
    def of_lines(self) -> np.ndarray:
        """(N, C·D) what each view sees of lines through the origin."""
        return (self.value[:, :, None] * self.x[:, None, :] + self.slope).reshape(len(self), -1)


@dataclass(frozen=True)
class Prior:
    """Of the function: Matérn of this length and amplitude, and a linear trend of these standard deviations."""

    length_m: float
    amplitude_m: float
    offset_m: float
    incline: float

    @property
    def steepness(self) -> float:
        """Prior variance of a slope, without the trend."""
        return 5.0 * self.amplitude_m**2 / (3.0 * self.length_m**2)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """What does not change with the prior between N and M views, (N, M) each: products of their values and slopes."""

    distance_m: np.ndarray
    values: np.ndarray
    mixed: np.ndarray
    slopes: np.ndarray
    along: np.ndarray
    linear: np.ndarray


def values_at(x: np.ndarray, value: np.ndarray) -> Functionals:
    """Sums of the functions' values (N, C) at places (N, D); `value` (C,) stands for all."""
    value = np.broadcast_to(value, (len(x), np.shape(value)[-1]))
    return Functionals(x, value, np.zeros((*value.shape, x.shape[1])))


def slopes_at(x: np.ndarray, slope: np.ndarray) -> Functionals:
    """Sums of the functions' slopes at places (N, D) along directions (N, C, D), which need not have length 1."""
    slope = np.broadcast_to(slope, (len(x), *np.shape(slope)[-2:]))
    return Functionals(x, np.zeros(slope.shape[:2]), slope)


def concatenate(*parts: Functionals) -> Functionals:
    """One after the other."""
    return Functionals(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))


def pairs(a: Functionals, b: Functionals) -> _Pairs:
    """Every view of a with every view of b."""
    mixed, along = np.zeros((2, len(a), len(b)))
    for index in range(a.value.shape[1]):
        value_a, slope_a, value_b, slope_b = a.value[:, index], a.slope[:, index], b.value[:, index], b.slope[:, index]
        along_a = np.sum(a.x * slope_a, axis=1)[:, None] - slope_a @ b.x.T
        along_b = a.x @ slope_b.T - np.sum(b.x * slope_b, axis=1)
        mixed += value_a[:, None] * along_b - value_b * along_a
        along += along_a * along_b
    values, slopes = a.value @ b.value.T, a.slope.reshape(len(a), -1) @ b.slope.reshape(len(b), -1).T
    return _Pairs(cdist(a.x, b.x), values, mixed, slopes, along, a.of_lines @ b.of_lines.T)


def covariance(between: _Pairs, prior: Prior) -> np.ndarray:
    """(N, M) prior covariance of the views."""
    scaled = np.sqrt(5.0) / prior.length_m * between.distance_m
    result = between.values * (prior.amplitude_m**2 * (1.0 + scaled + scaled**2 / 3.0))
    result += (prior.steepness * (1.0 + scaled)) * (between.mixed + between.slopes)
    result -= (prior.steepness * 5.0 / prior.length_m**2) * between.along
    result *= np.exp(-scaled)
    return result + prior.offset_m**2 * between.values + prior.incline**2 * between.linear


def covariance_by_log_length(between: _Pairs, prior: Prior) -> np.ndarray:
    """(N, M) derivative of `covariance` by the logarithm of the prior's length."""
    scaled = np.sqrt(5.0) / prior.length_m * between.distance_m
    result = between.values * (prior.amplitude_m**2 * scaled**2 * (1.0 + scaled) / 3.0)
    result += (prior.steepness * (scaled**2 - 2.0 * scaled - 2.0)) * (between.mixed + between.slopes)
    result -= (prior.steepness * 5.0 / prior.length_m**2 * (scaled - 4.0)) * between.along
    return np.asarray(result * np.exp(-scaled))


def trend(rows: Functionals, prior: Prior) -> np.ndarray:
    """(N, C + C·D) H with H·Hᵀ the covariance of the prior's linear trend."""
    return np.hstack([prior.offset_m * rows.value, prior.incline * rows.of_lines])


def variance(rows: Functionals, prior: Prior) -> np.ndarray:
    """(N,) prior variance of each view, the diagonal of `covariance(pairs(rows, rows), prior)`."""
    result = (rows.value**2).sum(axis=1) * (prior.amplitude_m**2 + prior.offset_m**2)
    result = result + prior.steepness * (rows.slope**2).sum(axis=(1, 2))
    return np.asarray(result + prior.incline**2 * (rows.of_lines**2).sum(axis=1))
