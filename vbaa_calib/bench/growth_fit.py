"""Exponents: how fast a cost grows with the size of the work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LEAST = 3
"""Sizes that an exponent is fitted to, at least."""
MARGIN = 0.15
"""An exponent is worse than expected where it exceeds that by so much and by two of its standard deviations."""


@dataclass(frozen=True)
class Power:
    """cost = at_one · size^exponent over the sizes from `smallest` on; `std` is the exponent's, by the scatter."""

    exponent: float
    std: float
    at_one: float
    smallest: float

    def at(self, size: np.ndarray) -> np.ndarray:
        """(...) the fitted cost."""
        return self.at_one * size**self.exponent

    def worse_than(self, expected: float) -> bool:
        """Whether the cost grows faster than it should."""
        return bool(self.exponent - expected > max(MARGIN, 2.0 * self.std))


UNKNOWN = Power(np.nan, np.nan, np.nan, np.nan)


def fitted(sizes: Sequence[float], costs: Sequence[float]) -> Power:
    """The straight line through logarithms, over the upper half of the sizes, three at least.

    What every call costs, however small, hides the growth at the lower end. Costs that are not positive say nothing;
    with fewer than three left all is NaN.
    """
    size, cost = np.asarray(sizes, float), np.asarray(costs, float)
    known = np.isfinite(cost) & (cost > 0.0)
    size, cost = size[known], cost[known]
    count = max(LEAST, (len(size) + 1) // 2)
    if len(size) < LEAST:
        return UNKNOWN
    order = np.argsort(size)[-count:]
    x, y = np.log(size[order]), np.log(cost[order])
    away = x - x.mean()
    spread = float(away @ away)
    exponent = float(away @ y) / spread
    left = y - y.mean() - exponent * away
    std = float(np.sqrt(left @ left / (count - 2) / spread))
    return Power(exponent, std, float(np.exp(y.mean() - exponent * x.mean())), float(np.exp(x.min())))
