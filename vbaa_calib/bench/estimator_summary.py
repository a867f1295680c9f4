"""All cells of the estimator's grid in a few lines: pooled, the worst one, and how many miss the goal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .estimator_grid import CellRow
from .estimator_statistics import QUANTITIES, standard_errors

OF_BOUND_GOAL, BIAS_GOAL, COVERED_GOAL = 1.05, 0.1, (0.93, 0.97)
CLEARLY = 2.5
"""A cell misses its goal clearly when it is beyond it by more than so many standard errors: noise alone does so for a
cell that just meets the goal in six of a thousand."""


@dataclass(frozen=True)
class SummaryRow:
    """One measure of one quantity over all cells that were run.

    Attributes
    ----------
    measure : of_bound, bias or covered. goal : in words.
    pooled : root mean square over the cells of of_bound, mean of the others. pooled_error : its standard error.
    worst : in the cell furthest from the goal. cell_error : standard error in one cell, from noise alone.
    beyond, clearly : number of cells beyond the goal, and by more than `CLEARLY` standard errors.
    """

    quantity: str
    measure: str
    goal: str
    cells: int
    draws: int
    pooled: float
    pooled_error: float
    worst: float
    worst_cell: str
    cell_error: float
    beyond: int
    clearly: int

    @property
    def met(self) -> bool:
        """Whether no cell misses the goal clearly."""
        return self.clearly == 0


@dataclass(frozen=True)
class _Measure:
    """One measure: its goal in words, how far values (K,) are beyond it, and how cells are pooled."""

    name: str
    goal: str
    beyond: Callable[[np.ndarray], np.ndarray]
    pooled: Callable[[np.ndarray], float]


_MEASURES = (
    _Measure(
        "of_bound",
        f"≤ {OF_BOUND_GOAL}",
        lambda values: values - OF_BOUND_GOAL,
        lambda values: float(np.sqrt(np.mean(values**2))),
    ),
    _Measure(
        "bias", f"|…| ≤ {BIAS_GOAL}", lambda values: np.abs(values) - BIAS_GOAL, lambda values: float(values.mean())
    ),
    _Measure(
        "covered",
        f"{COVERED_GOAL[0]} to {COVERED_GOAL[1]}",
        lambda values: np.maximum(COVERED_GOAL[0] - values, values - COVERED_GOAL[1]),
        lambda values: float(values.mean()),
    ),
)


def summary(rows: Sequence[CellRow]) -> list[SummaryRow]:
    """Nine lines: every measure of every quantity. Cells in which fewer than two draws came with numbers are beyond."""
    found = []
    for quantity in QUANTITIES:
        own = [row for row in rows if row.quantity == quantity and row.draws]
        found += [_line(measure, quantity, own) for measure in _MEASURES if own]
    return found


def _line(measure: _Measure, quantity: str, rows: Sequence[CellRow]) -> SummaryRow:
    values = np.array([getattr(row, measure.name) for row in rows], float)
    counts = np.array([row.draws * (1.0 - (row.without_numbers or 0.0)) for row in rows])
    errors = np.array([getattr(standard_errors(max(count, 1.0)), measure.name) for count in counts])
    beyond = np.where(np.isfinite(values), measure.beyond(values), np.inf)
    worst = int(np.argmax(beyond))
    there = np.isfinite(values)
    return SummaryRow(
        quantity=quantity,
        measure=measure.name,
        goal=measure.goal,
        cells=len(rows),
        draws=rows[0].draws,
        pooled=measure.pooled(values[there]) if there.any() else np.nan,
        pooled_error=float(np.sqrt(np.mean(errors[there] ** 2) / there.sum())) if there.any() else np.nan,
        worst=float(values[worst]),
        worst_cell=rows[worst].cell,
        cell_error=float(np.median(errors)),
        beyond=int((beyond > 0).sum()),
        clearly=int((beyond > CLEARLY * errors).sum()),
    )
