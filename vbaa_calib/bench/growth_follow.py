"""One kind of work at growing sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .growth_clock import Cost, cost_of
from .growth_fit import Power, fitted
from .growth_series import Series

GRAIN_MB = 8.0
"""Rises below this say more of the allocator than of the work."""


@dataclass(frozen=True, eq=False)
class Grown:
    """A series as it was measured: at `sizes` (K,) the `costs`."""

    series: Series
    sizes: Sequence[int]
    costs: Sequence[Cost]

    @cached_property
    def seconds(self) -> np.ndarray:
        """(K,) of each size."""
        return np.array([cost.seconds for cost in self.costs])

    @cached_property
    def risen_MB(self) -> np.ndarray:
        """(K,) what the resident set rose by."""
        return np.array([cost.risen_MB for cost in self.costs])

    @cached_property
    def time(self) -> Power:
        """Fitted to the seconds."""
        return fitted(self.sizes, self.seconds.tolist())

    @cached_property
    def memory(self) -> Power:
        """Fitted to the memory, where it is more than the allocator's grain."""
        return fitted(self.sizes, np.where(self.risen_MB >= GRAIN_MB, self.risen_MB, np.nan).tolist())

    @property
    def worse(self) -> bool:
        """Whether either grows faster than it should."""
        series = self.series
        return self.time.worse_than(series.time_exponent) or self.memory.worse_than(series.memory_exponent)


def follow(series: Series, sizes: Sequence[int], seed: int, repeats: int) -> Grown:
    """The smallest size runs once before the first: what is loaded and kept for ever does not count."""
    series.prepare(sizes[0], seed)()
    return Grown(series, sizes, [cost_of(series.prepare(size, seed), repeats) for size in sizes])
