"""`vbaa bench estimator`: contacts against the Cramér–Rao bound, hard cases, random scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.harness import Findings, Options

from . import grid, hard

_MATCHED = "elastica"
"""The rung without error on the grid's straight, weightless antenna: the grid is to show noise, not the ladder."""


def measure(options: Options) -> Findings:
    """All parts, in proportion to the draws of a cell of the grid."""
    draws, seed, quick = options.draws, options.seed, options.quick
    cells = grid.run(draws, seed, model=_MATCHED)
    lines = grid.summary(cells)
    cases = hard.run(max(draws // 2, 4), seed)
    random = hard.hostile((50 if quick else 100) * draws, seed)
    texts = (
        grid.grid_text(cells, lines),
        hard.hard_text(cases),
        hard.hostile_text(random),
    )
    found: dict[str, Sequence[Any]] = {"grid": cells, "hard": cases, "random": random}
    told = {line.measure: line for line in lines if line.quantity == "l"}
    headline = "no kind of scene could be judged"
    if told:
        headline = (
            f"distance: rms error {told['of_bound'].pooled:.2f} × the bound over {told['of_bound'].cells} kinds of "
            f"scene, {100 * told['covered'].pooled:.0f} % covered"
        )
    return Findings(
        "\n\n".join(texts),
        {"estimator.csv" if name == "grid" else f"estimator_{name}.csv": rows for name, rows in found.items()},
        numbers={**found, "lines": lines},
        headline=headline,
    )
