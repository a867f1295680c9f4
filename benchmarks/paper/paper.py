"""`vbaa bench paper`: the paper's experiments redone with its antenna, in simulation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.harness import Findings, Options, cell, rms_known, save

from . import figure as paper_figure
from . import friction as paper_friction
from . import sensing as paper_sensing
from . import yielding as paper_yielding
from .friction import FrictionRow
from .sensing import ALL_POINTS, SIGMAS_PX, SensingRow
from .yielding import YieldingRow


def sensing_text(rows: Sequence[SensingRow]) -> str:
    """Fig. 7, over the distances of each object."""
    lines = [
        "Fig. 7: slippery knife edges; l: rms over all distances and draws, the worst distance, what is stated; "
        "direction: of f in the yz plane from\nthe object's normal, rms and the worst distance; lean: of f in space "
        "from the normal",
        f"{'method':<26}{'px':>5}{'normal °':>10}{'answered %':>12}{'l mm':>8}{'worst':>8}{'stated':>8}"
        f"{'covered %':>11}{'direction °':>13}{'worst':>8}{'lean °':>8}",
    ]
    for key in dict.fromkeys((row.method, row.sigma_px, row.normal_deg) for row in rows):
        some = [row for row in rows if (row.method, row.sigma_px, row.normal_deg) == key]
        covered = _weighted(some, [row.covered for row in some])
        share = np.mean([row.answered for row in some])
        lines.append(
            f"{key[0]:<26}{key[1]:>5}{key[2]:>10.0f}{100 * share:>12.1f}{_rms(some, 'l_rms_mm')}"
            f"{_largest(some, 'l_rms_mm')}{_rms(some, 'l_stated_mm')}{cell(covered, 11, 1, 100)}"
            f"{_rms(some, 'direction_rms_deg', 13)}{_largest(some, 'direction_rms_deg')}{_rms(some, 'lean_rms_deg')}"
        )
    return "\n".join(lines)


def friction_text(rows: Sequence[FrictionRow]) -> str:
    """Fig. 5."""
    lines = [
        "Fig. 5: dragged to and fro over an edge; normal: from the contact points; μ = tan α: from the directions of f",
        f"{'method':<26}{'px':>5}{'μ':>6}{'answered %':>12}{'normal rms °':>14}{'μ mean':>9}{'scatter':>9}{'rms':>8}"
        f"{'stated':>9}{'covered %':>11}",
    ]
    lines += [
        f"{row.method:<26}{row.sigma_px:>5}{row.mu_true:>6}{100 * row.answered:>12.1f}"
        f"{cell(row.normal_rms_deg, 14, 2)}{cell(row.mu_mean, 9, 4)}{cell(row.mu_std, 9, 4)}"
        f"{cell(row.mu_rms, 8, 4)}{cell(row.mu_stated, 9, 4)}{cell(row.mu_covered, 11, 1, 100)}"
        for row in rows
    ]
    return "\n".join(lines)


def yielding_text(rows: Sequence[YieldingRow]) -> str:
    """Objects that give way."""
    lines = [
        "objects that give way, touched at 120 mm; expected: 3EI/(k·l²), too long by the Active Antenna's formula",
        f"{'k N/m':>9}  {'method':<26}{'answered %':>12}{'l error mm':>12}{'expected':>10}{'rms':>8}{'stated':>8}"
        f"{'k answered %':>14}{'k mean':>9}{'rms %':>8}{'covered %':>11}",
    ]
    lines += [
        f"{row.stiffness_N_m:>9.4g}  {row.method:<26}{100 * row.answered:>12.1f}{cell(row.l_error_mm, 12, 2)}"
        f"{cell(row.l_expected_mm, 10, 2)}{cell(row.l_rms_mm, 8, 2)}{cell(row.l_stated_mm, 8, 2)}"
        f"{100 * row.object_answered:>14.1f}{cell(row.object_mean_N_m, 9, 1)}{cell(row.object_rms, 8, 1, 100)}"
        f"{cell(row.object_covered, 11, 1, 100)}"
        for row in rows
    ]
    return "\n".join(lines)


def _weighted(rows: Sequence[SensingRow], values: Sequence[float | None]) -> float | None:
    """Mean over all answered draws."""
    counts = [0.0 if value is None else row.answered * row.draws for row, value in zip(rows, values, strict=True)]
    total = sum(counts)
    return sum(n * v for n, v in zip(counts, values, strict=True) if v is not None) / total if total else None


def _rms(rows: Sequence[SensingRow], name: str, width: int = 8) -> str:
    """Over all answered draws."""
    mean = _weighted(rows, [None if (v := getattr(row, name)) is None else v**2 for row in rows])
    return cell(None if mean is None else mean**0.5, width, 2)


def _largest(rows: Sequence[SensingRow], name: str) -> str:
    given = [value for row in rows if (value := getattr(row, name)) is not None]
    return cell(max(given) if given else None, 8, 2)


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
