"""μ of one object, or the bound that the touches set on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.core.robust import NORMAL_QUARTILE, chi_square_p

from .evidence import SLIDING, UNUSED, WRONG, Evidence, FrictionTouches, Profile, profile, student_t_losses

_LARGEST = 2.0  # no larger μ is looked for
_BOUND = 0.5 * 1.645**2  # what a bound that holds in 95 % costs, in logarithms of the likelihood
_SPARED = 2  # of the touches that need not slide so many may be wrong without having set a bound
_SHARE = 0.95
_COARSE, _FINE, _FAR, _BETWEEN = 41, 61, 9.0, 17  # points of the grids of μ, and in which losses the fine one lies
_SCATTERED = 8  # fewer sliding angles do not tell their scatter
_FEWEST = 5  # so many touches have to slide
_KNOWN_SHARE = 0.25  # directions that are known for fewer of the touches are known by accident
_STD, _STD_SHARE = 0.03, 0.1  # μ is told where its deviation is below the first, or below this share of μ
# Sliding touches that scatter so many times as much as they should do not follow the law, nor where so many lie far
# off, nor where they need common errors as improbable as this.
_CONTRADICTED, _WRONG_SHARE, _STRAINED = 4.0, 0.25, 1e-5


@dataclass(frozen=True, eq=False)
class Coefficient:
    """What the touches say of μ.

    Attributes
    ----------
    mu, std : mean and standard deviation of the posterior, all μ up to `_LARGEST` being alike before.
    interval : (2,) the shortest that holds 95 % of it. bounds : (2,) one-sided at 95 %, 0 and inf where there is none.
    scatter : the own residuals in own standard deviations (median); the deviations were widened by it where above 1.
    wrong : share of the sliding touches that are not believed.
    strain : probability that common errors as large as the best fit asks for are an accident.
    axes : (L, K) the combinations of the K common errors that the angles tell apart; `fits` are in these.
    fits, weight : at G values of μ, and their probabilities (G,).
    """

    mu: float
    std: float
    interval: np.ndarray
    bounds: np.ndarray
    scatter: float
    wrong: float
    strain: float
    axes: np.ndarray
    fits: Profile
    weight: np.ndarray


def coefficient(evidence: Evidence) -> Coefficient:
    """The posterior of μ; touches that slide and scatter more than their deviations say are believed less."""
    angles = evidence.angles
    # orthonormal: what else the common errors do moves no angle
    scaled = angles.modes_rad / angles.std_rad[:, None]
    _, sizes, axes = np.linalg.svd(scaled.T @ scaled)
    axes = axes[sizes > 1e-6]
    angles = replace(angles, modes_rad=angles.modes_rad @ axes.T)
    evidence = replace(evidence, angles=angles)
    found, scatter = _profile_on_grids(evidence), 1.0
    off = np.abs(found.off[np.argmin(found.evidence)][evidence.slides])
    if len(off) >= _SCATTERED:  # 1 for Gaussian noise as large as was said
        scatter = float(np.median(off) / NORMAL_QUARTILE)
    if scatter > 1.0:
        evidence = replace(evidence, angles=replace(angles, std_rad=angles.std_rad * scatter))
        found = _profile_on_grids(evidence)
    weight = np.exp(found.evidence.min() - found.evidence) * np.gradient(found.mu)
    weight /= weight.sum()
    mu, best = float(weight @ found.mu), int(np.argmin(found.cost))
    off, modes = np.abs(found.off[best, evidence.slides]), found.modes[best]
    return Coefficient(
        mu,
        float(np.sqrt(weight @ (found.mu - mu) ** 2)),
        _shortest(found.mu, weight),
        _bounds(evidence, found),
        scatter,
        wrong=float(np.mean(off > WRONG)) if len(off) else 0.0,
        strain=chi_square_p(modes @ modes, max(len(modes), 1)),
        axes=axes,
        fits=found,
        weight=weight,
    )


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


def _bounds(evidence: Evidence, found: Profile) -> np.ndarray:
    """(2,) where the profile likelihood rises above its least by `_BOUND`, below and above it."""
    cost = _cost_without_worst(evidence, found)
    dear, best = cost > cost.min() + _BOUND, int(np.argmin(cost))
    below, above = np.flatnonzero(dear[:best]), best + np.flatnonzero(dear[best:])

    def edge(outside: int, inside: int) -> float:
        between = np.linspace(found.mu[outside], found.mu[inside], _BETWEEN)
        finer = _cost_without_worst(evidence, profile(evidence, between, found.modes[inside]))
        return float(between[np.flatnonzero(finer > cost.min() + _BOUND).max(initial=0)])

    lower = edge(below[-1], below[-1] + 1) if len(below) else 0.0
    upper = edge(above[0], above[0] - 1) if len(above) else np.inf
    return np.array([lower, upper if upper < _LARGEST else np.inf])


def enough_sliding(rubs: FrictionTouches) -> bool:
    """Whether as many touches slide as μ needs; fewer could all be wrong."""
    return int(np.sum(rubs.used_as == SLIDING)) >= _FEWEST


def judge(rubs: FrictionTouches, mu: Coefficient | None) -> tuple[bool, str, np.ndarray]:
    """Whether μ is told, the reason in words, and its interval or one-sided bounds (2,), 0 and inf without any.

    `mu` is None where no touch could be used.
    """
    sliding, used = int(np.sum(rubs.used_as == SLIDING)), int(np.sum(rubs.used_as != UNUSED))
    advice = "stroke the object across the antenna, over some length"
    nothing = np.array([0.0, np.inf])
    if mu is None:
        known = "a force and a normal from the shape whose directions are both known"
        return False, f"none of {len(rubs)} contacts has {known}; {advice}", nothing
    if used < _KNOWN_SHARE * len(rubs):
        known = "a force and a normal from the shape whose directions are known, too few to believe that these are"
        return False, f"only {used} of {len(rubs)} contacts have {known}; {advice}", nothing
    if not enough_sliding(rubs):
        few = f"only {sliding}" if sliding else "none"
        words = f"of {used} contacts whose normal is known {few} lie{'s' * (sliding < 2)} in the midst of a slide"
        return False, f"{words}{_bound_words(mu.bounds)}", mu.bounds
    for fails, against in (
        (
            mu.scatter > _CONTRADICTED,
            f"the {sliding} sliding contacts scatter {mu.scatter:.0f} times as much as they should: the forces do not "
            "follow friction against the slip; did the object move, or does its friction differ from place to place?",
        ),
        (
            mu.wrong > _WRONG_SHARE,
            f"{100 * mu.wrong:.0f} % of the {sliding} sliding contacts do not follow friction against the slip",
        ),
        (
            mu.strain < _STRAINED,
            f"the {sliding} sliding contacts could follow friction against the slip only if rig and normals were off "
            "by far more than they should be; did the object move?",
        ),
    ):
        if fails:
            return False, against, nothing
    if mu.std > max(_STD, _STD_SHARE * mu.mu):
        return False, f"{_why_imprecise(rubs)}{_bound_words(mu.bounds)}", mu.bounds
    widened = f", scattering {mu.scatter:.1f} times as much as they should" if mu.scatter > 1.5 else ""
    beside = f" and {used - sliding} that must not exceed it" if used > sliding else ""
    return True, f"from {sliding} sliding contacts{widened}{beside}", mu.interval


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


def _why_imprecise(rubs: FrictionTouches) -> str:
    sliding = rubs.used_as == SLIDING
    across = rubs.slip[sliding, 0]
    many = f"the {sliding.sum()} sliding contacts"
    if np.median(np.abs(across)) < 0.3:
        return f"{many} slide along the antenna, where the force is hardly known; slide across it, too"
    one_way = abs(np.sign(across).sum()) > 0.8 * sliding.sum()
    advice = "; stroke the same place the other way, too" if one_way else ""
    known = np.degrees(np.nanmedian(rubs.lateral.whole_std_rad[sliding]))
    return f"{many} know the force against the normal to {known:.1f}°{advice}"
