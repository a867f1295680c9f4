"""`vbaa bench estimator`: contacts against the Cramér–Rao bound, speed against error, hard cases, random scenes."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.harness import Findings, Options

from . import grid as estimator_grid
from . import hard as estimator_hard
from . import hard as estimator_hostile
from . import rods as estimator_rods
from . import speed as estimator_speed
from .grid import SummaryRow, summary
from .report import grid_text, hard_text, hostile_text, rod_text, speed_text
from .report import write_figure as write_grid_figure
from .report import write_speed_figure as write_figure
from .speed import ESTIMATOR, SpeedRow

RODS, HARD, RANDOM = {False: 2.0, True: 0.5}, 0.5, {False: 100, True: 50}
"""Frames of each population of rods, of each hard case, and random ones, per draw of a cell; two without and with
--quick."""
LEAST_RODS, LEAST_HARD = 6, 4
SPEED_FRAMES, SPEED_REPEATS = {False: 2000, True: 100}, {False: 5, True: 2}
"""Frames of a batch and timings of each, without and with --quick."""
MATCHED = "elastica"
"""The rung without error on the grid's straight, weightless antenna: the grid is to show noise, not the ladder."""


def measure(options: Options) -> Findings:
    """All parts, in proportion to the draws of a cell of the grid."""
    draws, seed, quick = options.draws, options.seed, options.quick
    grid = estimator_grid.run(draws, seed, model=MATCHED)
    lines = summary(grid)
    looked = estimator_rods.FIRST_LOOK if quick else estimator_rods.POPULATIONS
    rods = estimator_rods.run(max(int(RODS[quick] * draws), LEAST_RODS), seed, chosen=looked)
    speed = estimator_speed.run(SPEED_FRAMES[quick], seed, SPEED_REPEATS[quick])
    hard = estimator_hard.run(max(int(HARD * draws), LEAST_HARD), seed)
    random = estimator_hostile.hostile(RANDOM[quick] * draws, seed)
    texts = (grid_text(grid, lines), rod_text(rods), speed_text(speed), hard_text(hard), hostile_text(random))
    return Findings(
        "\n\n".join(texts),
        {
            "estimator.csv": grid,
            "estimator_rods.csv": rods,
            "estimator_speed.csv": speed,
            "estimator_hard.csv": hard,
            "estimator_random.csv": random,
        },
        {
            "estimator.png": lambda path, force: write_figure(path, speed, force),
            "estimator_grid.png": lambda path, force: write_grid_figure(path, grid, force),
        },
        {"grid": grid, "lines": lines, "rods": rods, "speed": speed, "hard": hard, "random": random},
        headline(lines, speed),
    )


def headline(lines: Sequence[SummaryRow], speed: Sequence[SpeedRow]) -> str:
    """The distance's error over its bound in all cells, how often it is covered, and the quickest batch."""
    told = {line.measure: line for line in lines if line.quantity == "l"}
    if not told:
        return "no kind of scene could be judged"
    fastest = max(1e6 / row.us_per_frame for row in speed if row.family == ESTIMATOR)
    return (
        f"distance: rms error {told['of_bound'].pooled:.2f} × the bound over {told['of_bound'].cells} kinds of scene, "
        f"{100 * told['covered'].pooled:.0f} % covered; up to {fastest:.0f} frames/s"
    )
