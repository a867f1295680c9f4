"""Did something change between two views? A scan over all moments, with the false alarms counted beforehand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from .scores import OwnScores

FEWEST_VIEWS = 6
_LEAST_SIDE = 2
_SEED, _DRAWS, _MOST_NUMBERS = 0, 40_000, 8_000_000


@dataclass(frozen=True)
class Change:
    """The pattern over the views that explains most.

    Attributes
    ----------
    index : of the pattern. size : of the change, in the parameter's unit, with its standard deviation `std`: from the
        scatter between the views, or from the residuals' variance if that says more.
    chance : of one so clear among all patterns tried, were there none.
    """

    index: int
    size: float
    std: float
    chance: float


def steps(count: int) -> np.ndarray:
    """(K, V) patterns: 0 before some view, 1 from it on; two views at least on either side."""
    return (np.arange(count) >= np.arange(_LEAST_SIDE, count - _LEAST_SIDE + 1)[:, None]).astype(float)


def drift(count: int) -> np.ndarray:
    """(1, V): from 0 at the first view to 1 at the last."""
    return np.linspace(0.0, 1.0, count)[None]


def find_change(own: OwnScores, patterns: np.ndarray, variance_px2: float) -> Change | None:
    """The pattern (K, V) that a parameter's values over the views follow best; None with too few views.

    The scatter of the views about the pattern sets the scale, not the corners' noise: a print that is not flat, or a
    lens that is not quite the model's, moves whole views. The chance is that of normal scatter of any size, by drawing.
    """
    if len(own.score) < FEWEST_VIEWS:
        return None
    white, score = own.whitened
    shapes = patterns @ white.T
    strength = np.linalg.norm(shapes, axis=1)
    seen = strength > 1e-9 * max(float(np.linalg.norm(white)), 1e-300)
    freedom = len(score) - 1
    if not seen.any() or freedom < FEWEST_VIEWS - 2:
        return None
    shapes = shapes[seen] / strength[seen, None]
    share = _shares(shapes, score[None])[0]
    best = int(share.argmax())
    left = float(score @ score) * (1.0 - share[best]) / freedom
    size = float(shapes[best] @ score / strength[seen][best])
    std = float(np.sqrt(max(left, variance_px2)) / strength[seen][best])
    chance = max(_chance(shapes, float(share[best])), _plain_chance(size / std, len(shapes)))
    return Change(int(np.flatnonzero(seen)[best]), size, std, chance)


def _shares(shapes: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """(S, K) share of the squares of scores (S, R) that each unit shape (K, R) explains."""
    return (scores @ shapes.T) ** 2 / np.maximum((scores**2).sum(axis=1, keepdims=True), 1e-300)


def _chance(shapes: np.ndarray, share: float) -> float:
    draws = min(_DRAWS, _MOST_NUMBERS // shapes.shape[1])
    drawn = np.random.default_rng(_SEED).standard_normal((draws, shapes.shape[1]))
    return float((1 + (_shares(shapes, drawn).max(axis=1) >= share).sum()) / (1 + draws))


def _plain_chance(deviations: float, patterns: int) -> float:
    """Bound by the residuals' variance alone."""
    return min(1.0, 2.0 * patterns * float(norm.sf(abs(deviations))))
