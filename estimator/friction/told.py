"""Whether the touches tell μ, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .coefficient import LARGEST, Coefficient
from .rubs import SLIDING, UNUSED, Rubs

FEWEST = 5
"""So many touches have to slide."""
KNOWN_SHARE = 0.25
"""Directions that are known for fewer of the touches are known by accident."""
STD, STD_SHARE = 0.03, 0.1
"""μ is told where its deviation is below the first, or below this share of μ."""
CONTRADICTED = 4.0
"""Sliding touches that scatter so many times as much as they should do not follow the law."""
WRONG_SHARE = 0.25
"""Nor do they where so many lie far off."""
STRAINED = 1e-5
"""Nor do touches that need common errors as improbable as this."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether μ is told, the reason in words, and its interval or one-sided bounds (2,), 0 and inf without any."""

    told: bool
    reason: str
    interval: np.ndarray

    @property
    def stands(self) -> bool:
        """Whether anything at all is said of μ."""
        return bool(self.interval[0] > 0.0 or np.isfinite(self.interval[1]))


def enough(rubs: Rubs) -> bool:
    """Whether as many touches slide as μ needs; fewer could all be wrong."""
    return int(np.sum(rubs.used_as == SLIDING)) >= FEWEST


def verdict(rubs: Rubs, mu: Coefficient | None) -> Verdict:
    """What to say of μ; `mu` is None where no touch could be used."""
    sliding, used = int(np.sum(rubs.used_as == SLIDING)), int(np.sum(rubs.used_as != UNUSED))
    if mu is None:
        return _nothing(
            f"none of {len(rubs)} contacts has a force and a normal from the shape whose directions are both known; "
            "stroke the object across the antenna, over some length"
        )
    if used < KNOWN_SHARE * len(rubs):
        return _nothing(
            f"only {used} of {len(rubs)} contacts have a force and a normal from the shape whose directions are known, "
            "too few to believe that these are; stroke the object across the antenna, over some length"
        )
    bounds = np.array([mu.lower, mu.upper if mu.upper < LARGEST else np.inf])
    if not enough(rubs):
        few = f"only {sliding}" if sliding else "none"
        words = f"of {used} contacts whose normal is known {few} lie{'s' * (sliding < 2)} in the midst of a slide"
        return Verdict(False, f"{words}{bound_words(bounds)}", bounds)
    against = _contradiction(sliding, mu)
    if against:
        return _nothing(against)
    if mu.std > max(STD, STD_SHARE * mu.mu):
        return Verdict(False, f"{_weakness(rubs)}{bound_words(bounds)}", bounds)
    widened = f", scattering {mu.scatter:.1f} times as much as they should" if mu.scatter > 1.5 else ""
    beside = f" and {used - sliding} that must not exceed it" if used > sliding else ""
    return Verdict(True, f"from {sliding} sliding contacts{widened}{beside}", mu.interval)


def bound_words(bounds: np.ndarray) -> str:
    """The bounds (2,) that there are, ready to be added to a sentence."""
    lower, upper = bounds[0] > 0.005, np.isfinite(bounds[1])
    low = np.floor(100.0 * bounds[0]) / 100.0
    high = np.ceil(100.0 * bounds[1]) / 100.0 if upper else np.inf
    if lower and upper:
        return f"; μ lies from {low:.2f} to {high:.2f} (each bound 95 %)"
    if lower:
        return f"; μ ≥ {low:.2f} (95 %)"
    return f"; μ ≤ {high:.2f} (95 %)" if upper else ""


def _nothing(reason: str) -> Verdict:
    return Verdict(False, reason, np.array([0.0, np.inf]))


def _contradiction(sliding: int, mu: Coefficient) -> str:
    """Why the sliding touches cannot be friction's, if they cannot; otherwise nothing."""
    if mu.scatter > CONTRADICTED:
        return (
            f"the {sliding} sliding contacts scatter {mu.scatter:.0f} times as much as they should: the forces do not "
            "follow friction against the slip; did the object move, or does its friction differ from place to place?"
        )
    if mu.wrong > WRONG_SHARE:
        return f"{100 * mu.wrong:.0f} % of the {sliding} sliding contacts do not follow friction against the slip"
    if mu.strain < STRAINED:
        return (
            f"the {sliding} sliding contacts could follow friction against the slip only if rig and normals were off "
            "by far more than they should be; did the object move?"
        )
    return ""


def _weakness(rubs: Rubs) -> str:
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
