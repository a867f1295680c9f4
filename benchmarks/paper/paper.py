"""`vbaa bench paper`: the paper's experiments redone with its antenna, in simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.figures import COLOURS, INK, SHADE, label, panels
from benchmarks.harness import Findings, Options, aligned, mean_of, rms_known, table
from benchmarks.paper.friction import NORMAL_DEG, SHOWN, FrictionRow, PathRow
from benchmarks.paper.friction import run as friction_run
from benchmarks.paper.rig import FELT
from benchmarks.paper.sensing import ALL_POINTS, SIGMAS_PX, TWO_POINTS, SensingRow
from benchmarks.paper.sensing import run as sensing_run
from benchmarks.paper.yielding import YieldingRow
from benchmarks.paper.yielding import run as yielding_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_FILLED = {ALL_POINTS: True, TWO_POINTS: False}
"""Whether a method's marks are filled."""
_GOAL_DEG, _GOAL_MU = 2.0, 0.03


def _fig7(rows: Sequence[SensingRow]) -> Figure:
    """(a) estimated over true distance, (b) force direction for three normals, and the errors of both below."""
    drawn, (distance, direction, off_mm, off_deg) = panels(4, 2, (6, 4), sharex=True)
    shown = [row for row in rows if row.sigma_px == SIGMAS_PX[0] and row.l_mean_mm is not None]
    for colour, normal in zip(COLOURS, dict.fromkeys(row.normal_deg for row in rows), strict=False):
        for method, filled in _FILLED.items():
            own = [row for row in shown if row.normal_deg == normal and row.method == method]
            at = _column(own, "l_true_mm") + (0.0 if filled else 2.0) + 0.5 * normal / 30.0
            face, name = colour if filled else "none", f"normal {normal:.0f}°, {method}"
            for what, unit, value, off in (("l", "mm", distance, off_mm), ("direction", "deg", direction, off_deg)):
                mean, std = (_column(own, f"{what}_{part}_{unit}") for part in ("mean", "std"))
                style: dict[str, Any] = {"color": colour, "markerfacecolor": face, "markersize": 5, "capsize": 2}
                value.errorbar(at, mean, std, fmt="o", lw=0.8, label=name, **style)
                off.errorbar(at, mean - _column(own, f"{what}_true_{unit}"), std, fmt="o", lw=0.8, **style)
        direction.axhline(normal, color=colour, lw=0.6)
    distance.plot([50, 230], [50, 230], color=INK, lw=0.6)
    off_deg.axhspan(-_GOAL_DEG, _GOAL_DEG, color=SHADE, lw=0, zorder=0)
    off_mm.axhline(0.0, color=INK, lw=0.6)
    label(distance, "(a) distance", y="estimated, mm")
    label(direction, "(b) force direction", y="from y in the yz plane, °")
    label(off_mm, "error of (a): mean and scatter", "true contact distance, mm", "mm")
    label(off_deg, "error of (b); grey: goal of 2°", "true contact distance, mm", "°")
    off_deg.set_ylim(-8, 8)
    drawn.legend(*distance.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return drawn


def _fig5(path: Sequence[PathRow], rows: Sequence[FrictionRow]) -> Figure:
    """Contact points joined with the directions of the force, and μ found over μ given."""
    drawn, (left, right) = panels(2, 2, (6, 5.5))
    _path(left, [row for row in path if row.method == ALL_POINTS])
    for colour, sigma in zip(COLOURS, SIGMAS_PX, strict=False):
        for place, (method, mark) in enumerate({TWO_POINTS: "o", ALL_POINTS: "s", FELT: "D"}.items()):
            own = [row for row in rows if row.method == method and row.sigma_px == sigma and row.mu_mean is not None]
            true, std = _column(own, "mu_true"), _column(own, "mu_std")
            at = true + 0.012 * place + 0.005 * (sigma > SIGMAS_PX[0])
            face = "none" if method == TWO_POINTS else colour
            style: dict[str, Any] = {"color": colour, "markerfacecolor": face, "markersize": 5, "capsize": 2}
            name = f"{method}, {sigma} px"
            right.errorbar(at, _column(own, "mu_mean") - true, std, fmt=mark, lw=0.8, label=name, **style)
    right.axhspan(-_GOAL_MU, _GOAL_MU, color=SHADE, lw=0, zorder=0)
    label(right, f"error of μ: mean and scatter; grey: goal of {_GOAL_MU}", "true μ", "found − true")
    right.legend(fontsize=8)
    return drawn


def _yielding(rows: Sequence[YieldingRow]) -> Figure:
    """Error of l over the object's stiffness, and the stiffness that the 2D-VBAA finds."""
    drawn, (left, right) = panels(2, 2, (6, 5), sharex=True)
    for colour, method in zip(COLOURS, dict.fromkeys(row.method for row in rows), strict=False):
        own = [row for row in rows if row.method == method and row.l_rms_mm is not None]
        left.loglog(_column(own, "stiffness_N_m"), _column(own, "l_rms_mm"), "o-", color=colour, lw=1, label=method)
        determined = [row for row in own if row.object_mean_N_m is not None]
        if determined:
            k, mark = _column(determined, "stiffness_N_m"), "o" if method == ALL_POINTS else "s"
            middle, off = _column(determined, "object_mean_N_m") / k, _column(determined, "object_rms")
            right.errorbar(k, middle, off, fmt=mark, capsize=2, lw=0.8, color=colour, label=method)
            for row, x, y in zip(determined, k, middle, strict=True):
                right.text(1.1 * x, y, f"{100 * row.object_answered:.0f} %", fontsize=8, color=colour)
    theory = [row for row in rows if row.l_expected_mm is not None]
    line = _column(theory, "stiffness_N_m"), _column(theory, "l_expected_mm")
    left.loglog(*line, color=INK, lw=0.8, ls="--", label="3EI/(k·l²)")
    left.set_ylim(bottom=0.1)
    label(left, "contact distance of 120 mm", "object's stiffness, N/m", "rms error, mm")
    right.axhline(1.0, color=INK, lw=0.6)
    right.axhspan(0.9, 1.1, color=SHADE, lw=0, zorder=0)
    right.set_ylim(0.4, 1.6)
    label(right, "object's stiffness: mean and rms error; share answered", "object's stiffness, N/m", "found / true")
    for panel in (left, right):
        panel.legend(fontsize=8)
    return drawn


def _path(panel: Axes, path: Sequence[PathRow]) -> None:
    """Contacts in the world across the antenna, the force on the object at each, and the cone about the normal."""
    if not path:
        return
    y, z = _column(path, "y_mm"), _column(path, "z_mm")
    psi = np.radians(_column(path, "direction_deg"))
    panel.plot(_column(path, "y_true_mm"), _column(path, "z_true_mm"), color=INK, lw=0.8, label="true contacts")
    for colour, part in zip(COLOURS, ("there", "back", "press"), strict=False):
        own = np.array([row.part == part for row in path])
        panel.plot(y[own], z[own], "o", ms=4, color=colour, label=part)
        ends = np.stack([y + 4.0 * np.cos(psi), z + 4.0 * np.sin(psi)])[:, own]
        panel.plot(np.stack([y[own], ends[0]]), np.stack([z[own], ends[1]]), color=colour, lw=0.8, alpha=0.7)
    middle = float(np.mean([y.min(), y.max()])), float(np.mean([z.min(), z.max()]))
    found, half = path[0].normal_deg, float(np.degrees(np.arctan(SHOWN)))
    for angle, style in ((found, "-"), (NORMAL_DEG + half, "--"), (NORMAL_DEG - half, "--")):
        end = 12.0 * np.cos(np.radians(angle)), 12.0 * np.sin(np.radians(angle))
        panel.plot([middle[0], middle[0] + end[0]], [middle[1], middle[1] + end[1]], style, color="#b91c1c", lw=1.2)
    title = f"μ = {SHOWN}: normal ν = {found:.1f}° from the points (true {NORMAL_DEG:.0f}°); dashed: true cone"
    label(panel, title, "y, mm", "z, mm")
    panel.set_aspect("equal")
    panel.legend(fontsize=8)


def _column(rows: Sequence[Any], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in rows], float)


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
    found: dict[str, Sequence[Any]] = {"sensing": sensing, "friction": friction, "path": path, "yielding": yielding}
    # all points at the smaller noise: distance, the force's direction, and μ from it
    distance, direction, mu = (
        rms_known(
            np.array([getattr(r, name) for r in rows if (r.method, r.sigma_px) == (ALL_POINTS, SIGMAS_PX[0])], float)
        )
        for rows, name in ((sensing, "l_rms_mm"), (sensing, "direction_rms_deg"), (friction, "mu_rms"))
    )
    return Findings(
        "\n\n".join((_sensing_text(sensing), table(friction, _FRICTION), table(yielding, _YIELDING))),
        {f"paper_{name}.csv": rows for name, rows in found.items()},
        {
            "paper_fig7.png": lambda: _fig7(sensing),
            "paper_fig5.png": lambda: _fig5(path, friction),
            "paper_yielding.png": lambda: _yielding(yielding),
        },
        found,
        f"all points, {SIGMAS_PX[0]} px: distance {distance:.1f} mm, direction {direction:.1f}°, μ {mu:.3f} rms",
    )
