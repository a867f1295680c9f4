"""The paper's experiments as figures: Fig. 7, Fig. 5, and objects that give way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.harness import new_figure

from .friction import NORMAL_DEG, SHOWN, FrictionRow, PathRow
from .rig import FELT
from .sensing import ALL_POINTS, SIGMAS_PX, TWO_POINTS, SensingRow
from .yielding import YieldingRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0f766e", "#b45309", "#6d28d9", "#64748b")
FACES = {ALL_POINTS: True, TWO_POINTS: False}
"""Whether a method's marks are filled."""
GOAL_DEG, GOAL_MU = 2.0, 0.03
_GREY = "#e2e8f0"


def fig7(rows: Sequence[SensingRow]) -> Figure:
    """(a) estimated over true distance, (b) force direction for three normals, and the errors of both below."""
    figure = new_figure(12, 8)
    panels = figure.subplots(2, 2, sharex=True)
    shown = [row for row in rows if row.sigma_px == SIGMAS_PX[0] and row.l_mean_mm is not None]
    for colour, normal in zip(COLOURS, dict.fromkeys(row.normal_deg for row in rows), strict=False):
        for method, filled in FACES.items():
            own = [row for row in shown if row.normal_deg == normal and row.method == method]
            at = _column(own, "l_true_mm") + (0.0 if filled else 2.0) + 0.5 * normal / 30.0
            values = (
                _column(own, "l_mean_mm"),
                _column(own, "direction_mean_deg"),
                _column(own, "l_mean_mm") - _column(own, "l_true_mm"),
                _column(own, "direction_mean_deg") - _column(own, "direction_true_deg"),
            )
            spread = ("l_std_mm", "direction_std_deg", "l_std_mm", "direction_std_deg")
            for panel, value, name in zip(panels.ravel(), values, spread, strict=True):
                marks = {
                    "color": colour,
                    "markerfacecolor": colour if filled else "none",
                    "markersize": 5,
                    "capsize": 2,
                }
                label = f"normal {normal:.0f}°, {method}"
                panel.errorbar(at, value, _column(own, name), fmt="o", lw=0.8, label=label, **marks)
        panels[0, 1].axhline(normal, color=colour, lw=0.6)
    panels[0, 0].plot([50, 230], [50, 230], color="#334155", lw=0.6)
    panels[1, 1].axhspan(-GOAL_DEG, GOAL_DEG, color=_GREY, lw=0, zorder=0)
    panels[1, 0].axhline(0.0, color="#334155", lw=0.6)
    titles = ("(a) distance", "(b) force direction", "error of (a): mean and scatter", "error of (b); grey: goal of 2°")
    units = ("estimated, mm", "from y in the yz plane, °", "mm", "°")
    for panel, title, unit in zip(panels.ravel(), titles, units, strict=True):
        _dress(panel, title, "", unit)
    for panel in panels[1]:
        panel.set_xlabel("true contact distance, mm")
    panels[1, 1].set_ylim(-8, 8)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    return figure


def fig5(path: Sequence[PathRow], rows: Sequence[FrictionRow]) -> Figure:
    """Contact points joined with the directions of the force, and μ found over μ given."""
    figure = new_figure(12, 5.5)
    left, right = figure.subplots(1, 2)
    _path(left, [row for row in path if row.method == ALL_POINTS])
    for colour, sigma in zip(COLOURS, SIGMAS_PX, strict=False):
        for place, (method, mark) in enumerate({TWO_POINTS: "o", ALL_POINTS: "s", FELT: "D"}.items()):
            own = [row for row in rows if row.method == method and row.sigma_px == sigma and row.mu_mean is not None]
            off = _column(own, "mu_mean") - _column(own, "mu_true")
            at = _column(own, "mu_true") + 0.012 * place + 0.005 * (sigma > SIGMAS_PX[0])
            face = "none" if method == TWO_POINTS else colour
            right.errorbar(
                at,
                off,
                _column(own, "mu_std"),
                fmt=mark,
                lw=0.8,
                capsize=2,
                markersize=5,
                color=colour,
                markerfacecolor=face,
                label=f"{method}, {sigma} px",
            )
    right.axhspan(-GOAL_MU, GOAL_MU, color=_GREY, lw=0, zorder=0)
    _dress(right, f"error of μ: mean and scatter; grey: goal of {GOAL_MU}", "true μ", "found − true")
    right.legend(fontsize=8)
    return figure


def yielding(rows: Sequence[YieldingRow]) -> Figure:
    """Error of l over the object's stiffness, and the stiffness that the 2D-VBAA finds."""
    figure = new_figure(12, 5)
    left, right = figure.subplots(1, 2, sharex=True)
    methods = dict.fromkeys(row.method for row in rows)
    for colour, method in zip(COLOURS[1:] + COLOURS[:1], methods, strict=True):
        own = [row for row in rows if row.method == method and row.l_rms_mm is not None]
        left.loglog(_column(own, "stiffness_N_m"), _column(own, "l_rms_mm"), "o-", color=colour, lw=1, label=method)
        told = [row for row in own if row.object_mean_N_m is not None]
        if told:
            k, mark = _column(told, "stiffness_N_m"), "o" if method == ALL_POINTS else "s"
            middle, off = _column(told, "object_mean_N_m") / k, _column(told, "object_rms")
            right.errorbar(k, middle, off, fmt=mark, capsize=2, lw=0.8, color=colour, label=method)
            for row in told:
                right.annotate(
                    f"{100 * row.object_answered:.0f} %",
                    (row.stiffness_N_m, (row.object_mean_N_m or 0.0) / row.stiffness_N_m),
                    xytext=(6, -12 if method == ALL_POINTS else 8),
                    textcoords="offset points",
                    fontsize=8,
                )
    theory = [row for row in rows if row.l_expected_mm is not None]
    line = _column(theory, "stiffness_N_m"), _column(theory, "l_expected_mm")
    left.loglog(*line, color="#334155", lw=0.8, ls="--", label="3EI/(k·l²)")
    left.set_ylim(bottom=0.1)
    _dress(left, "contact distance of 120 mm", "object's stiffness, N/m", "rms error, mm")
    left.legend(fontsize=8)
    right.axhline(1.0, color="#334155", lw=0.6)
    right.axhspan(0.9, 1.1, color=_GREY, lw=0, zorder=0)
    right.legend(fontsize=8)
    right.set_ylim(0.4, 1.6)
    _dress(right, "object's stiffness: mean and rms error; share answered", "object's stiffness, N/m", "found / true")
    return figure


def _path(panel: Axes, path: Sequence[PathRow]) -> None:
    """Contacts in the world across the antenna, the force on the object at each, and the cone about the normal."""
    if not path:
        return
    y, z = _column(path, "y_mm"), _column(path, "z_mm")
    psi = np.radians(_column(path, "direction_deg"))
    panel.plot(_column(path, "y_true_mm"), _column(path, "z_true_mm"), color="#334155", lw=0.8, label="true contacts")
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
    _dress(panel, title, "y, mm", "z, mm")
    panel.set_aspect("equal")
    panel.legend(fontsize=8)


def _dress(panel: Axes, title: str, x: str, y: str) -> None:
    panel.set_title(title, fontsize=10)
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    panel.grid(alpha=0.3)


def _column(rows: Sequence[Any], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in rows], float)
