"""`vbaa bench estimator`: contacts against the Cramér–Rao bound, speed against error, hard cases, random scenes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from . import estimator_grid, estimator_hard, estimator_hostile, estimator_rods, estimator_speed
from .estimator_figure import hard_text, hostile_text, speed_text
from .estimator_grid import CellRow
from .estimator_grid_report import grid_text, rod_text
from .estimator_hard import HardRow
from .estimator_hostile import HostileRow
from .estimator_rods import RodRow
from .estimator_speed import SpeedRow
from .estimator_summary import SummaryRow, summary

RODS, HARD, RANDOM = 2.0, 0.5, 100
"""Frames of each population of rods, of each hard case, and random ones, per draw of a cell."""
SPEED_FRAMES, SPEED_REPEATS = (300, 2000), (2, 5)
MATCHED = "elastica"
"""The rung without error on the grid's straight, weightless antenna: the grid is to show noise, not the ladder."""


@dataclass(frozen=True)
class Found:
    """All tables of the benchmark."""

    grid: list[CellRow]
    lines: list[SummaryRow]
    rods: list[RodRow]
    speed: list[SpeedRow]
    hard: list[HardRow]
    random: list[HostileRow]

    @property
    def text(self) -> str:
        """The tables as they are printed."""
        parts = (
            grid_text(self.grid, self.lines),
            rod_text(self.rods),
            speed_text(self.speed),
            hard_text(self.hard),
            hostile_text(self.random),
        )
        return "\n\n".join(parts)

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {name: [asdict(row) for row in getattr(self, name)] for name in self.__dataclass_fields__}


def measure(draws: int, seed: int) -> Found:
    """Run all parts, in proportion to the draws of a cell of the grid."""
    many = draws >= 100
    grid = estimator_grid.run(draws, seed, model=MATCHED)
    return Found(
        grid,
        summary(grid),
        estimator_rods.run(int(RODS * draws), seed),
        estimator_speed.run(SPEED_FRAMES[many], seed, SPEED_REPEATS[many]),
        estimator_hard.run(max(int(HARD * draws), 4), seed),
        estimator_hostile.hostile(RANDOM * draws, seed),
    )
