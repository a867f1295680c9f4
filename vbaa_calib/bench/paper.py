"""`vbaa bench paper`: the paper's experiments redone with its antenna, in simulation."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from . import paper_friction, paper_sensing, paper_yielding
from .paper_friction import FrictionRow, PathRow
from .paper_sensing import SensingRow
from .paper_yielding import YieldingRow

PARTS = ("sensing", "friction", "path", "yielding")
"""Tables of `Found`, of which each becomes a CSV."""


@dataclass(frozen=True)
class Found:
    """Fig. 7, Fig. 5 with the path that it draws, and objects that give way."""

    sensing: list[SensingRow]
    friction: list[FrictionRow]
    path: list[PathRow]
    yielding: list[YieldingRow]

    def as_dict(self) -> dict[str, Any]:
        """For `--json`."""
        return {name: [asdict(row) for row in getattr(self, name)] for name in PARTS}


def measure(draws: int, seed: int) -> Found:
    """All experiments with so many draws of noise, Fig. 5 with half as many, shared among a few true rigs."""
    sensing = paper_sensing.run(draws, seed)
    friction, path = paper_friction.run(max(draws // 2, 1), seed)
    return Found(sensing, friction, path, paper_yielding.run(draws, seed))
