"""Felt objects against the truth: a table for the terminal, a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .figures import new_figure, save
from .object_run import (
    FORCE_GOAL_RAD,
    MU_GOAL,
    NORMAL_GOAL_RAD,
    STIFFNESS_GOAL,
    SURFACE_GOAL_M,
    SURFACE_OF_POINTS_GOAL,
    ObjectRow,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"cylinder": "#0f766e", "sphere": "#b45309", "box edge": "#6d28d9", "free form": "#be123c"}


def as_text(rows: Sequence[ObjectRow], draws: int) -> str:
    """The table for people."""
    title = (
        f"{draws} draws a cell; rms errors; cov: share of the 95 % regions that hold the truth; points along the "
        f"object's normal;\nμ and stiffness where they were told, with the share of draws in which they were; goals: "
        f"surface {SURFACE_OF_POINTS_GOAL:.0f} × the points' deviation and {1e3 * SURFACE_GOAL_M:.0f} mm,\nnormals "
        f"{np.degrees(NORMAL_GOAL_RAD):.0f}°, forces of slippery objects {np.degrees(FORCE_GOAL_RAD):.0f}°, "
        f"μ {MU_GOAL}, stiffness {100 * STIFFNESS_GOAL:.0f} %"
    )
    head = (
        f"{'object':<10}{'k N/m':>7}{'μ':>5} {'rig':<16}{'touches':>8}{'surface mm':>11}{'cov':>6}{'points mm':>10}"
        f"{'std':>7}{'cov':>6}{'normal °':>9}{'cov':>6}{'force °':>8}{'μ error':>9}{'told':>6}{'cov':>6}"
        f"{'k error %':>10}{'told':>6}{'cov':>6}{'s':>6}  misses"
    )
    return "\n".join([title, head, *(_line(row) for row in rows), *_pooled(rows)])


def _pooled(rows: Sequence[ObjectRow]) -> list[str]:
    """Of all cells with an exact rig, and of all with one that is off: do the intervals hold, are the goals met?"""
    lines = []
    for rig in ("exact", "off"):
        some = [row for row in rows if row.rig.startswith(rig)]
        if some:
            shares = ", ".join(
                f"{name} {np.mean([getattr(row, field) for row in some]):.2f}"
                for name, field in (
                    ("surface", "surface_covered"),
                    ("points", "point_covered"),
                    ("normals", "normal_covered"),
                    ("μ", "mu_covered"),
                    ("stiffness", "stiffness_covered"),
                )
            )
            met = sum(not row.misses for row in some)
            lines.append(
                f"rig {rig}: {met} of {len(some)} cells miss nothing; 95 % regions that hold the truth: {shares}"
            )
    return lines


def _line(row: ObjectRow) -> str:
    stiffness = "rigid" if row.stiffness_N_m is None else f"{row.stiffness_N_m:.0f}"
    mu = "–" if row.mu_error is None else f"{row.mu_error:.4f}"
    soft = "–" if row.stiffness_error is None else f"{100 * row.stiffness_error:.1f}"
    return (
        f"{row.object:<10}{stiffness:>7}{row.friction:>5.1f} {row.rig:<16}{row.contacts:>8.0f}{row.surface_mm:>11.3f}"
        f"{row.surface_covered:>6.2f}{row.point_mm:>10.3f}{row.point_std_mm:>7.3f}{row.point_covered:>6.2f}"
        f"{row.normal_deg:>9.2f}{row.normal_covered:>6.2f}{row.force_deg:>8.2f}{mu:>9}{row.mu_told:>6.2f}"
        f"{row.mu_covered:>6.2f}{soft:>10}{row.stiffness_told:>6.2f}{row.stiffness_covered:>6.2f}"
        f"{row.estimate_s + row.feel_s:>6.1f}  {', '.join(row.misses) or 'none'}"
    )


def write_figure(path: Path, rows: Sequence[ObjectRow], force: bool) -> None:
    """Surface, normals, friction and stiffness, each with its goal; filled marks are exact rigs."""
    from matplotlib.lines import Line2D

    figure = new_figure(12, 8)
    surface, normals, friction, stiffness = figure.subplots(2, 2).ravel()
    told = [row for row in rows if row.mu_error is not None]
    soft = [row for row in rows if row.stiffness_error is not None]
    _points(surface, rows, [row.point_std_mm for row in rows], [row.surface_mm for row in rows])
    _points(normals, rows, [row.point_std_mm for row in rows], [row.normal_deg for row in rows])
    _points(friction, told, [row.friction for row in told], [row.mu_error or 0.0 for row in told])
    _points(
        stiffness,
        soft,
        [row.stiffness_N_m or 0.0 for row in soft],
        [100 * (row.stiffness_error or 0.0) for row in soft],
    )
    deviations = [row.point_std_mm for row in rows]
    span = np.array([min(deviations), max(deviations)])
    surface.plot(span, np.minimum(SURFACE_OF_POINTS_GOAL * span, 1e3 * SURFACE_GOAL_M), color="#334155", lw=1.2)
    goals = ((normals, np.degrees(NORMAL_GOAL_RAD)), (friction, MU_GOAL), (stiffness, 100 * STIFFNESS_GOAL))
    for panel, goal in goals:
        panel.axhline(goal, color="#334155", lw=1.2)
    labels = (
        (surface, "deviation of the contact points, mm", "surface, rms error, mm"),
        (normals, "deviation of the contact points, mm", "normals, rms error, °"),
        (friction, "coefficient of friction", "its rms error"),
        (stiffness, "stiffness, N/m", "its rms error, %"),
    )
    for panel, across, up in labels:
        panel.set_xlabel(across)
        panel.set_ylabel(up)
        panel.set_yscale("log")
        panel.grid(alpha=0.3)
    surface.set_xscale("log")
    marks = [Line2D([], [], ls="", marker="o", color=colour, label=name) for name, colour in COLOURS.items()]
    marks.append(Line2D([], [], ls="", marker="o", color="#334155", markerfacecolor="none", label="rig off"))
    marks.append(Line2D([], [], color="#334155", label="goal"))
    figure.legend(handles=marks, loc="outside lower center", ncols=6, fontsize=8)
    save(figure, path, force)


def _points(panel: Axes, rows: Sequence[ObjectRow], across: Sequence[float], up: Sequence[float]) -> None:
    for row, x, y in zip(rows, across, up, strict=True):
        colour = COLOURS.get(row.object, "#334155")
        face = colour if row.rig.startswith("exact") else "none"
        panel.plot(x, max(y, 1e-6), "o" if row.stiffness_N_m is None else "s", color=colour, markerfacecolor=face)
