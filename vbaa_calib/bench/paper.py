"""`vbaa bench paper`: the paper's experiments redone with its antenna, in simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import paper_figure, paper_friction, paper_sensing, paper_yielding
from .averages import rms_known
from .figures import save
from .paper_friction import FrictionRow
from .paper_report import friction_text, sensing_text, yielding_text
from .paper_sensing import ALL_POINTS, SIGMAS_PX, SensingRow
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """Fig. 7, Fig. 5 with half as many draws of noise, and objects that give way; draws are shared among true rigs."""
    draws, seed = options.draws, options.seed
    sensing = paper_sensing.run(draws, seed)
    friction, path = paper_friction.run(max(draws // 2, 1), seed)
    yielding = paper_yielding.run(draws, seed)
    return Findings(
        "\n\n".join((sensing_text(sensing), friction_text(friction), yielding_text(yielding))),
        {
            "paper_sensing.csv": sensing,
            "paper_friction.csv": friction,
            "paper_path.csv": path,
            "paper_yielding.csv": yielding,
        },
        {
            "paper_fig7.png": lambda where, force: save(paper_figure.fig7(sensing), where, force),
            "paper_fig5.png": lambda where, force: save(paper_figure.fig5(path, friction), where, force),
            "paper_yielding.png": lambda where, force: save(paper_figure.yielding(yielding), where, force),
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
