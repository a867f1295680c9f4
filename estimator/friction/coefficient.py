"""μ of one object, or the bound that the touches set on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from .evidence import WRONG, Evidence, Fits, fits, losses

LARGEST = 2.0
"""No larger μ is looked for."""
BOUND = 0.5 * 1.645**2
"""What a bound that holds in 95 % costs, in logarithms of the likelihood."""
SPARED = 2
"""Of the touches that need not slide so many may be wrong without having set a bound."""
SHARE = 0.95
_COARSE, _FINE, _FAR, _BETWEEN = 41, 61, 9.0, 17
_SCATTERED = 8


@dataclass(frozen=True, eq=False)
class Coefficient:
    """What the touches say of μ.

    Attributes
    ----------
    mu, std : mean and standard deviation of the posterior, all μ up to `LARGEST` being alike before.
    interval : (2,) the shortest that holds 95 % of it.
    lower, upper : one-sided bounds at 95 %, 0 and inf where there is none.
    scatter : the own residuals in own standard deviations (median); the deviations were widened by it where above 1.
    wrong : share of the sliding touches that are not believed.
    strain : probability that common errors as large as the best fit asks for are an accident.
    axes : (L, K) the combinations of the K common errors that the angles tell apart; `fits` are in these.
    fits, weight : at G values of μ, and what each is worth (G,).
    """

    mu: float
    std: float
    interval: np.ndarray
    lower: float
    upper: float
    scatter: float
    wrong: float
    strain: float
    axes: np.ndarray
    fits: Fits
    weight: np.ndarray

    @property
    def widened(self) -> float:
        """By what the own deviations were multiplied."""
        return max(self.scatter, 1.0)


def coefficient(evidence: Evidence) -> Coefficient:
    """The posterior of μ; touches that slide and scatter more than their deviations say are believed less."""
    axes = _told_apart(evidence)
    evidence = replace(evidence, modes_rad=evidence.modes_rad @ axes.T)
    found = _likely(evidence)
    scatter = _scatter(evidence, found.off[np.argmin(found.evidence)])
    if scatter > 1.0:
        evidence = replace(evidence, std_rad=evidence.std_rad * scatter)
        found = _likely(evidence)
    grid = found.mu
    weight = np.exp(found.evidence.min() - found.evidence) * np.gradient(grid)
    weight /= weight.sum()
    mu = float(weight @ grid)
    lower, upper = _bounds(evidence, found)
    best = int(np.argmin(found.cost))
    off, modes = np.abs(found.off[best, evidence.slides]), found.modes[best]
    return Coefficient(
        mu,
        float(np.sqrt(weight @ (grid - mu) ** 2)),
        _shortest(grid, weight),
        lower,
        upper,
        scatter,
        wrong=float(np.mean(off > WRONG)) if len(off) else 0.0,
        strain=float(chi2.sf(modes @ modes, max(len(modes), 1))),
        axes=axes,
        fits=found,
        weight=weight,
    )


def _told_apart(evidence: Evidence) -> np.ndarray:
    """(L, K) orthonormal: what else the common errors do moves no angle."""
    scaled = evidence.modes_rad / evidence.std_rad[:, None]
    _, sizes, axes = np.linalg.svd(scaled.T @ scaled)
    return axes[sizes > 1e-6]


def _likely(evidence: Evidence) -> Fits:
    """At a coarse grid of μ, and at a fine one where that finds the likely values."""
    grid = np.tan(np.linspace(0.0, np.arctan(LARGEST), _COARSE))
    coarse = fits(evidence, grid)
    worth = coarse.evidence
    likely = np.flatnonzero(worth < worth.min() + _FAR)
    first, last = max(likely[0] - 1, 0), min(likely[-1] + 1, _COARSE - 1)
    between = np.linspace(grid[first], grid[last], _FINE)[1:-1]
    fine = fits(evidence, between, coarse.modes[np.argmin(worth)])
    return Fits.joined([coarse.picked(slice(0, first + 1)), fine, coarse.picked(slice(last, None))])


def _scatter(evidence: Evidence, off: np.ndarray) -> float:
    """Median size of the residuals of what slides in its own deviations, 1 for Gaussian noise as large as was said."""
    off = np.abs(off[evidence.slides])
    return float(np.median(off) / 0.6745) if len(off) >= _SCATTERED else 1.0


def _cost_of_most(evidence: Evidence, found: Fits) -> np.ndarray:
    """(G,) the costs without the touches farthest outside the cone."""
    outside = np.sort(losses(found.off[:, ~evidence.slides]), axis=1)
    return found.cost - outside[:, max(outside.shape[1] - SPARED, 0) :].sum(axis=1)


def _shortest(grid: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(2,) the shortest interval of that share: from the boundary on, where the posterior is highest there."""
    edges = np.concatenate([[grid[0]], 0.5 * (grid[1:] + grid[:-1]), [grid[-1]]])
    total = np.concatenate([[0.0], np.cumsum(weight)])
    begin = np.linspace(0.0, 1.0 - SHARE, 101)
    low, high = np.interp(begin, total, edges), np.interp(np.minimum(begin + SHARE, total[-1]), total, edges)
    best = int(np.argmin(high - low))
    return np.array([low[best], high[best]])


def _bounds(evidence: Evidence, found: Fits) -> tuple[float, float]:
    """Where the profile likelihood rises above its least by `BOUND`, below and above it."""
    cost = _cost_of_most(evidence, found)
    dear, best = cost > cost.min() + BOUND, int(np.argmin(cost))
    below, above = np.flatnonzero(dear[:best]), best + np.flatnonzero(dear[best:])

    def edge(outside: int, inside: int) -> float:
        between = np.linspace(found.mu[outside], found.mu[inside], _BETWEEN)
        finer = _cost_of_most(evidence, fits(evidence, between, found.modes[inside]))
        return float(between[np.flatnonzero(finer > cost.min() + BOUND).max(initial=0)])

    lower = edge(below[-1], below[-1] + 1) if len(below) else 0.0
    return lower, edge(above[0], above[0] - 1) if len(above) else np.inf
