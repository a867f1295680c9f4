"""`vbaa bench estimator`: contacts against the Cramér–Rao bound, speed against error, hard cases, random scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.harness import Findings, Options

from . import grid, hard, rods, speed

_RODS, _HARD, _RANDOM = {False: 2.0, True: 0.5}, 0.5, {False: 100, True: 50}
"""Frames of each population of rods, of each hard case, and random ones, per draw of a cell; two without and with
--quick."""
_SPEED_FRAMES, _SPEED_REPEATS = {False: 2000, True: 100}, {False: 5, True: 2}
"""Frames of a batch and timings of each, without and with --quick."""
_MATCHED = "elastica"
"""The rung without error on the grid's straight, weightless antenna: the grid is to show noise, not the ladder."""


def measure(options: Options) -> Findings:
    """All parts, in proportion to the draws of a cell of the grid."""
    draws, seed, quick = options.draws, options.seed, options.quick
    cells = grid.run(draws, seed, model=_MATCHED)
    lines = grid.summary(cells)
    populations = rods.FIRST_LOOK if quick else rods.POPULATIONS
    real = rods.run(max(int(_RODS[quick] * draws), 6), seed, chosen=populations)
    timed = speed.run(_SPEED_FRAMES[quick], seed, _SPEED_REPEATS[quick])
    cases = hard.run(max(int(_HARD * draws), 4), seed)
    random = hard.hostile(_RANDOM[quick] * draws, seed)
    texts = (
        grid.grid_text(cells, lines),
        rods.rod_text(real),
        speed.speed_text(timed),
        hard.hard_text(cases),
        hard.hostile_text(random),
    )
    found: dict[str, Sequence[Any]] = {"grid": cells, "rods": real, "speed": timed, "hard": cases, "random": random}
    return Findings(
        "\n\n".join(texts),
        {"estimator.csv" if name == "grid" else f"estimator_{name}.csv": rows for name, rows in found.items()},
        {"estimator.png": lambda: speed.figure(timed), "estimator_grid.png": lambda: grid.figure(cells)},
        {**found, "lines": lines},
        headline(lines, timed),
    )


def headline(lines: Sequence[grid.SummaryRow], timed: Sequence[speed.SpeedRow]) -> str:
    """The distance's error over its bound in all cells, how often it is covered, and the quickest batch."""
    measures = {line.measure: line for line in lines if line.quantity == "l"}
    if not measures:
        return "no kind of scene could be judged"
    fastest = max(1e6 / row.us_per_frame for row in timed if row.family == speed.ESTIMATOR)
    return (
        f"distance: rms error {measures['of_bound'].pooled:.2f} × the bound over {measures['of_bound'].cells} kinds of "
        f"scene, {100 * measures['covered'].pooled:.0f} % covered; up to {fastest:.0f} frames/s"
    )
