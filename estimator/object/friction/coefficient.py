"""μ of one object, or the bound that the touches set on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.robust import NORMAL_QUARTILE, chi_square_p

from .evidence import SLIDING, UNUSED, WRONG, Evidence, FrictionTouches, Profile, profile, student_t_losses

_LARGEST = 2.0
"""No larger μ is looked for."""
_BOUND = 0.5 * 1.645**2
"""What a bound that holds in 95 % costs, in logarithms of the likelihood."""
_SPARED = 2
"""Of the touches that need not slide so many may be wrong without having set a bound."""
_SHARE = 0.95
_COARSE, _FINE, _FAR, _BETWEEN = 41, 61, 9.0, 17
_SCATTERED = 8


@dataclass(frozen=True, eq=False)
class Coefficient:
    """What the touches say of μ.

    Attributes
    ----------
    mu, std : mean and standard deviation of the posterior, all μ up to `_LARGEST` being alike before.
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
    fits: Profile
    weight: np.ndarray

    @property
    def widened(self) -> float:
        """By what the own deviations were multiplied."""
        return max(self.scatter, 1.0)


def coefficient(evidence: Evidence) -> Coefficient:
    """The posterior of μ; touches that slide and scatter more than their deviations say are believed less."""
    axes = _identifiable_axes(evidence)
    evidence = replace(evidence, modes_rad=evidence.modes_rad @ axes.T)
    found = _profile_on_grids(evidence)
    scatter = _scatter(evidence, found.off[np.argmin(found.evidence)])
    if scatter > 1.0:
        evidence = replace(evidence, std_rad=evidence.std_rad * scatter)
        found = _profile_on_grids(evidence)
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
        strain=chi_square_p(modes @ modes, max(len(modes), 1)),
        axes=axes,
        fits=found,
        weight=weight,
    )


def _identifiable_axes(evidence: Evidence) -> np.ndarray:
    """(L, K) orthonormal: what else the common errors do moves no angle."""
    scaled = evidence.modes_rad / evidence.std_rad[:, None]
    _, sizes, axes = np.linalg.svd(scaled.T @ scaled)
    return axes[sizes > 1e-6]


def _profile_on_grids(evidence: Evidence) -> Profile:
    """At a coarse grid of μ, and at a fine one where that finds the likely values."""
    grid = np.tan(np.linspace(0.0, np.arctan(_LARGEST), _COARSE))
    coarse = profile(evidence, grid)
    worth = coarse.evidence
    likely = np.flatnonzero(worth < worth.min() + _FAR)
    first, last = max(likely[0] - 1, 0), min(likely[-1] + 1, _COARSE - 1)
    between = np.linspace(grid[first], grid[last], _FINE)[1:-1]
    fine = profile(evidence, between, coarse.modes[np.argmin(worth)])
    return Profile.concatenate([coarse.select(slice(0, first + 1)), fine, coarse.select(slice(last, None))])


def _scatter(evidence: Evidence, off: np.ndarray) -> float:
    """Median size of the residuals of what slides in its own deviations, 1 for Gaussian noise as large as was said."""
    off = np.abs(off[evidence.slides])
    return float(np.median(off) / NORMAL_QUARTILE) if len(off) >= _SCATTERED else 1.0


def _cost_without_worst(evidence: Evidence, found: Profile) -> np.ndarray:
    """(G,) the costs without the touches farthest outside the cone."""
    outside = np.sort(student_t_losses(found.off[:, ~evidence.slides]), axis=1)
    return found.cost - outside[:, max(outside.shape[1] - _SPARED, 0) :].sum(axis=1)


def _shortest(grid: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(2,) the shortest interval of that share: from the boundary on, where the posterior is highest there."""
    edges = np.concatenate([[grid[0]], 0.5 * (grid[1:] + grid[:-1]), [grid[-1]]])
    total = np.concatenate([[0.0], np.cumsum(weight)])
    begin = np.linspace(0.0, 1.0 - _SHARE, 101)
    low, high = np.interp(begin, total, edges), np.interp(np.minimum(begin + _SHARE, total[-1]), total, edges)
    best = int(np.argmin(high - low))
    return np.array([low[best], high[best]])


def _bounds(evidence: Evidence, found: Profile) -> tuple[float, float]:
    """Where the profile likelihood rises above its least by `_BOUND`, below and above it."""
    cost = _cost_without_worst(evidence, found)
    dear, best = cost > cost.min() + _BOUND, int(np.argmin(cost))
    below, above = np.flatnonzero(dear[:best]), best + np.flatnonzero(dear[best:])

    def edge(outside: int, inside: int) -> float:
        between = np.linspace(found.mu[outside], found.mu[inside], _BETWEEN)
        finer = _cost_without_worst(evidence, profile(evidence, between, found.modes[inside]))
        return float(between[np.flatnonzero(finer > cost.min() + _BOUND).max(initial=0)])

    lower = edge(below[-1], below[-1] + 1) if len(below) else 0.0
    return lower, edge(above[0], above[0] - 1) if len(above) else np.inf


_FEWEST = 5
"""So many touches have to slide."""
_KNOWN_SHARE = 0.25
"""Directions that are known for fewer of the touches are known by accident."""
_STD, _STD_SHARE = 0.03, 0.1
"""μ is told where its deviation is below the first, or below this share of μ."""
_CONTRADICTED = 4.0
"""Sliding touches that scatter so many times as much as they should do not follow the law."""
_WRONG_SHARE = 0.25
"""Nor do they where so many lie far off."""
_STRAINED = 1e-5
"""Nor do touches that need common errors as improbable as this."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether μ is told, the reason in words, and its interval or one-sided bounds (2,), 0 and inf without any."""

    determined: bool
    reason: str
    interval: np.ndarray

    @property
    def informative(self) -> bool:
        """Whether anything at all is said of μ."""
        return bool(self.interval[0] > 0.0 or np.isfinite(self.interval[1]))


def enough_sliding(rubs: FrictionTouches) -> bool:
    """Whether as many touches slide as μ needs; fewer could all be wrong."""
    return int(np.sum(rubs.used_as == SLIDING)) >= _FEWEST


def judge(rubs: FrictionTouches, mu: Coefficient | None) -> Verdict:
    """What to say of μ; `mu` is None where no touch could be used."""
    sliding, used = int(np.sum(rubs.used_as == SLIDING)), int(np.sum(rubs.used_as != UNUSED))
    if mu is None:
        return _undetermined(
            f"none of {len(rubs)} contacts has a force and a normal from the shape whose directions are both known; "
            "stroke the object across the antenna, over some length"
        )
    if used < _KNOWN_SHARE * len(rubs):
        return _undetermined(
            f"only {used} of {len(rubs)} contacts have a force and a normal from the shape whose directions are known, "
            "too few to believe that these are; stroke the object across the antenna, over some length"
        )
    bounds = np.array([mu.lower, mu.upper if mu.upper < _LARGEST else np.inf])
    if not enough_sliding(rubs):
        few = f"only {sliding}" if sliding else "none"
        words = f"of {used} contacts whose normal is known {few} lie{'s' * (sliding < 2)} in the midst of a slide"
        return Verdict(False, f"{words}{_bound_words(bounds)}", bounds)
    against = _contradiction(sliding, mu)
    if against:
        return _undetermined(against)
    if mu.std > max(_STD, _STD_SHARE * mu.mu):
        return Verdict(False, f"{_why_imprecise(rubs)}{_bound_words(bounds)}", bounds)
    widened = f", scattering {mu.scatter:.1f} times as much as they should" if mu.scatter > 1.5 else ""
    beside = f" and {used - sliding} that must not exceed it" if used > sliding else ""
    return Verdict(True, f"from {sliding} sliding contacts{widened}{beside}", mu.interval)


def _bound_words(bounds: np.ndarray) -> str:
    """The bounds (2,) that there are, ready to be added to a sentence."""
    lower, upper = bounds[0] > 0.005, np.isfinite(bounds[1])
    low = np.floor(100.0 * bounds[0]) / 100.0
    high = np.ceil(100.0 * bounds[1]) / 100.0 if upper else np.inf
    if lower and upper:
        return f"; μ lies from {low:.2f} to {high:.2f} (each bound 95 %)"
    if lower:
        return f"; μ ≥ {low:.2f} (95 %)"
    return f"; μ ≤ {high:.2f} (95 %)" if upper else ""


def _undetermined(reason: str) -> Verdict:
    return Verdict(False, reason, np.array([0.0, np.inf]))


def _contradiction(sliding: int, mu: Coefficient) -> str:
    """Why the sliding touches cannot be friction's, if they cannot; otherwise nothing."""
    if mu.scatter > _CONTRADICTED:
        return (
            f"the {sliding} sliding contacts scatter {mu.scatter:.0f} times as much as they should: the forces do not "
            "follow friction against the slip; did the object move, or does its friction differ from place to place?"
        )
    if mu.wrong > _WRONG_SHARE:
        return f"{100 * mu.wrong:.0f} % of the {sliding} sliding contacts do not follow friction against the slip"
    if mu.strain < _STRAINED:
        return (
            f"the {sliding} sliding contacts could follow friction against the slip only if rig and normals were off "
            "by far more than they should be; did the object move?"
        )
    return ""


def _why_imprecise(rubs: FrictionTouches) -> str:
    sliding = rubs.used_as == SLIDING
    across = np.abs(rubs.slip[sliding, 0])
    whole = np.hypot(rubs.lateral_std_rad, np.linalg.norm(rubs.lateral_modes_rad, axis=1))[sliding]
    known = f"force against the normal to {np.degrees(np.nanmedian(whole)):.1f}°"
    if np.median(across) < 0.3:
        return (
            f"the {sliding.sum()} sliding contacts slide along the antenna, where the force is hardly known; slide "
            "across it, too"
        )
    signs = np.sign(rubs.slip[sliding, 0])
    one_way = abs(signs.sum()) > 0.8 * sliding.sum()
    advice = "; stroke the same place the other way, too" if one_way else ""
    return f"the {sliding.sum()} sliding contacts know the {known}{advice}"
