"""`vbaa bench paper`: the paper's experiments redone with its antenna, in simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.harness import Findings, Options, aligned, mean_of, rms_known, table

from . import figure
from .friction import FrictionRow
from .friction import run as friction_run
from .sensing import ALL_POINTS, SIGMAS_PX, SensingRow
from .sensing import run as sensing_run
from .yielding import run as yielding_run

_FRICTION = (
    "Fig. 5: dragged to and fro over an edge; normal: from the contact points; μ = tan α: from the directions of f"
)
_YIELDING = (
    "objects that give way, touched at 120 mm; expected: 3EI/(k·l²), too long by the Active Antenna's formula; k: "
    "the object's stiffness"
)


def _sensing_text(rows: Sequence[SensingRow]) -> str:
    """Fig. 7, over the distances of each object."""
    title = (
        "Fig. 7: slippery knife edges; l: rms over all distances and draws, the worst distance, what is stated; "
        "direction: of f in the yz plane from\nthe object's normal, rms and the worst distance; lean: of f in space "
        "from the normal"
    )
    head = "method,px,normal °,answered %,l mm,worst,stated,covered %,direction °,worst,lean °"
    lines = [head.split(",")]
    for key in dict.fromkeys((row.method, row.sigma_px, row.normal_deg) for row in rows):
        some = [row for row in rows if (row.method, row.sigma_px, row.normal_deg) == key]
        l_mm, stated, direction, lean = (_over_draws(some, f"{name}_{unit}", 2) ** 0.5 for name, unit in _POOLED)
        worst = [max([getattr(row, name) or 0.0 for row in some]) for name in ("l_rms_mm", "direction_rms_deg")]
        numbers = (100 * mean_of(some, "answered"), l_mm, worst[0], stated, 100 * _over_draws(some, "covered", 1))
        cells = [f"{number:.2f}" for number in (*numbers, direction, worst[1], lean)]
        lines.append([key[0], f"{key[1]}", f"{key[2]:.0f}", *cells])
    return aligned(lines, [True] + [False] * 10, title)


_POOLED = (("l_rms", "mm"), ("l_stated", "mm"), ("direction_rms", "deg"), ("lean_rms", "deg"))


def _over_draws(rows: Sequence[SensingRow], name: str, power: int) -> float:
    """Mean of a column's power over all answered draws; NaN without any."""
    known = [row for row in rows if getattr(row, name) is not None]
    counts = np.array([row.answered * row.draws for row in known])
    values = np.array([getattr(row, name) ** power for row in known])
    return float((counts * values).sum() / counts.sum()) if counts.any() else np.nan


def measure(options: Options) -> Findings:
    """Fig. 7, Fig. 5 with half as many draws of noise, and objects that give way; draws are shared among true rigs."""
    draws, seed = options.draws, options.seed
    sensing, yielding = sensing_run(draws, seed), yielding_run(draws, seed)
    friction, path = friction_run(max(draws // 2, 1), seed)
    return Findings(
        "\n\n".join((_sensing_text(sensing), table(friction, _FRICTION), table(yielding, _YIELDING))),
        {
            "paper_sensing.csv": sensing,
            "paper_friction.csv": friction,
            "paper_path.csv": path,
            "paper_yielding.csv": yielding,
        },
        {
            "paper_fig7.png": lambda: figure.fig7(sensing),
            "paper_fig5.png": lambda: figure.fig5(path, friction),
            "paper_yielding.png": lambda: figure.yielding(yielding),
        },
        {"sensing": sensing, "friction": friction, "path": path, "yielding": yielding},
        headline(sensing, friction),
    )


def headline(sensing: Sequence[SensingRow], friction: Sequence[FrictionRow]) -> str:
    """All points at the smaller noise: distance, the force's direction, and μ from it."""
    touched = [row for row in sensing if row.method == ALL_POINTS and row.sigma_px == SIGMAS_PX[0]]
    rubbed = [row for row in friction if row.method == ALL_POINTS and row.sigma_px == SIGMAS_PX[0]]
    distance, direction = (_pooled(touched, name) for name in ("l_rms_mm", "direction_rms_deg"))
    mu = _pooled(rubbed, "mu_rms")
    return f"all points, {SIGMAS_PX[0]} px: distance {distance:.1f} mm, direction {direction:.1f}°, μ {mu:.3f} rms"


def _pooled(rows: Sequence[SensingRow] | Sequence[FrictionRow], name: str) -> float:
    return rms_known(np.array([getattr(row, name) for row in rows], float))
