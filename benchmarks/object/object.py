"""`vbaa bench object`: objects felt by stroking them, against what is true of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.estimator.setup import drawn_truth
from benchmarks.harness import new_figure, or_none, rms_known, save
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.core.console import progress

from .cases import CASES, RIGID, SETUP, SOFT, SOFTER, Case
from .judge import Judged, covered, judge
from .scenes import Recorded, play

if TYPE_CHECKING:
    from matplotlib.axes import Axes
from benchmarks.harness import Findings, Options

from . import onset as object_onset
from .onset import SPEEDS_M_S, AlarmRow

SURFACE_OF_POINTS_GOAL, SURFACE_GOAL_M = 2.0, 1e-3
NORMAL_GOAL_RAD, FORCE_GOAL_RAD = np.radians(3.0), np.radians(2.0)
MU_GOAL, STIFFNESS_GOAL = 0.03, 0.10
USUAL_FRICTION = 0.2
RUBBED = ("cylinder", "sphere")
"""Objects on which the other coefficients of friction are tried."""
FIRST_LOOK = ("cylinder", "sphere")
FRICTIONS = (0.0, 0.1, 0.4, 0.6)


@dataclass(frozen=True)
class Cell:
    """One object under one condition.

    Attributes
    ----------
    stiffness_N_m : infinite for a rigid object. friction : Coulomb's μ.
    exact : whether the rig is known exactly; otherwise as well as a calibration says.
    slippery : whether the estimator is told that nothing rubs.
    """

    case: Case
    stiffness_N_m: float
    friction: float
    exact: bool
    slippery: bool = False


@dataclass(frozen=True)
class ObjectRow:
    """One cell, over its draws; None where a number does not exist.

    Attributes
    ----------
    stiffness_N_m : None for a rigid object.
    contacts : touches on the surface, imagined : located contacts of a free antenna; both per draw.
    surface_mm : rms distance of the drawn surface's vertices from the object; touched_mm : of the touches on it.
    worst_mm : largest distance of a vertex in any draw.
    point_mm, point_std_mm : rms error of the contact points along the normal, and rms of their deviations.
    surface_covered, point_covered, normal_covered : shares of the 95 % regions that hold the truth.
    normal_deg, force_deg : rms angle to the true normal, of the felt normals and of the forces; force_median_deg.
    mu_error : rms over the draws in which μ was told; mu_told : their share; mu_covered : share of all intervals.
    stiffness_error : rms, relative; stiffness_told, stiffness_covered likewise.
    compliance_error_std : rms error of the compliance in its own deviations, told or not.
    estimate_s, feel_s : least time of a draw.
    """

    object: str
    stiffness_N_m: float | None
    friction: float
    rig: str
    draws: int
    contacts: float
    imagined: float
    surface_mm: float
    worst_mm: float
    surface_covered: float
    touched_mm: float
    point_mm: float
    point_std_mm: float
    point_covered: float
    normal_deg: float
    normal_covered: float
    force_deg: float
    force_median_deg: float
    mu_error: float | None
    mu_told: float
    mu_covered: float
    stiffness_error: float | None
    stiffness_told: float
    stiffness_covered: float
    compliance_error_std: float
    estimate_s: float
    feel_s: float

    @property
    def misses(self) -> tuple[str, ...]:
        """The goals that this cell misses. Intervals are judged over all cells: in one the errors go together."""
        surface = self.surface_mm > SURFACE_OF_POINTS_GOAL * self.point_std_mm or self.surface_mm > 1e3 * SURFACE_GOAL_M
        found = {
            "surface": surface,
            "normals": self.normal_deg > np.degrees(NORMAL_GOAL_RAD),
            "force": self.rig.endswith("slippery") and self.force_deg > np.degrees(FORCE_GOAL_RAD),
            "friction": self.mu_error is None or self.mu_error > MU_GOAL,
            "stiffness": self.stiffness_N_m is not None
            and (self.stiffness_error is None or self.stiffness_told < 1.0 or self.stiffness_error > STIFFNESS_GOAL),
        }
        return tuple(name for name, missed in found.items() if missed)


def cells() -> list[Cell]:
    """Every object rigid and soft, some with other frictions; each with an exact rig and with one that is off."""
    shapes = [
        Cell(case, soft, USUAL_FRICTION, exact) for case in CASES for soft in (RIGID, SOFT) for exact in (True, False)
    ]
    rubbed = [case for case in CASES if case.name in RUBBED]
    rubs = [Cell(case, RIGID, mu, exact) for case in rubbed for mu in FRICTIONS for exact in (True, False)]
    slippery = [Cell(case, RIGID, 0.0, exact, True) for case in CASES for exact in (True, False)]
    softer = [Cell(case, SOFTER, USUAL_FRICTION, exact) for case in CASES for exact in (True, False)]
    return shapes + rubs + slippery + softer


def few_cells() -> list[Cell]:
    """For a first look: one object with an exact rig, with one that is off, and soft; another one."""
    one, other = (next(case for case in CASES if case.name == name) for name in FIRST_LOOK)
    rigid = [Cell(one, RIGID, USUAL_FRICTION, exact) for exact in (True, False)]
    return [*rigid, Cell(one, SOFTER, USUAL_FRICTION, True), Cell(other, RIGID, USUAL_FRICTION, True)]


def run(draws: int, seed: int, chosen: Sequence[Cell] | None = None) -> list[ObjectRow]:
    """All cells, or those chosen, with so many draws each."""
    wanted = cells() if chosen is None else list(chosen)
    return [_row(cell, judged) for cell, judged in progress(_judged(wanted, draws, seed), "objects", len(wanted))]


def _judged(wanted: Sequence[Cell], draws: int, seed: int) -> Iterator[tuple[Cell, list[Judged]]]:
    played: dict[tuple[str, float, float], Recorded] = {}
    for number, cell in enumerate(wanted):
        key = (cell.case.name, cell.stiffness_N_m, cell.friction)
        if key not in played:
            played[key] = play(SETUP.rig(), cell.case.make(cell.stiffness_N_m, cell.friction), cell.case.strokes)
        yield cell, [_draw(cell, played[key], np.random.default_rng((seed, number, i))) for i in range(draws)]


def _draw(cell: Cell, played: Recorded, rng: np.random.Generator) -> Judged:
    given = played.true if cell.exact else drawn_truth(replace(SETUP, exact=False).rig(), rng)
    return judge(played.noisy(rng, given), 0.0 if cell.slippery else FRICTION_RAD)


def _row(cell: Cell, judged: Sequence[Judged]) -> ObjectRow:
    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in judged])

    def each(name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in judged], float)

    rigid = not np.isfinite(cell.stiffness_N_m)
    compliance = 1.0 / cell.stiffness_N_m
    return ObjectRow(
        object=cell.case.name,
        stiffness_N_m=None if rigid else cell.stiffness_N_m,
        friction=cell.friction,
        rig=("exact" if cell.exact else "off") + (", slippery" if cell.slippery else ""),
        draws=len(judged),
        contacts=float(each("contacts").mean()),
        imagined=float(each("imagined").mean()),
        surface_mm=1e3 * rms_known(joined("surface_m")),
        worst_mm=1e3 * float(np.abs(joined("surface_m")).max()),
        surface_covered=covered(joined("surface_m"), joined("surface_std_m")),
        touched_mm=1e3 * rms_known(joined("touched_m")),
        point_mm=1e3 * rms_known(joined("point_m")),
        point_std_mm=1e3 * rms_known(joined("point_std_m")),
        point_covered=covered(joined("point_m"), joined("point_std_m")),
        normal_deg=float(np.degrees(rms_known(joined("normal_rad")))),
        normal_covered=float(joined("normal_inside").mean()),
        force_deg=float(np.degrees(rms_known(joined("force_rad")))),
        force_median_deg=float(np.degrees(np.median(joined("force_rad")))),
        mu_error=or_none(rms_known(each("mu") - cell.friction)),
        mu_told=float(each("mu_told").mean()),
        mu_covered=float(each("mu_inside").mean()),
        stiffness_error=None if rigid else or_none(rms_known(each("stiffness_N_m") / cell.stiffness_N_m - 1.0)),
        stiffness_told=float(each("stiffness_told").mean()),
        stiffness_covered=float(each("stiffness_inside").mean()),
        compliance_error_std=rms_known((each("compliance_m_N") - compliance) / each("compliance_std_m_N")),
        estimate_s=float(each("estimate_s").min()),
        feel_s=float(each("feel_s").min()),
    )


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


FREE_FRAMES_PER_DRAW = {False: 2_000, True: 600}
"""Frames without contact in which a first contact would be a false alarm, for each recording of a kind."""


def measure(options: Options) -> Findings:
    """Every cell, false alarms and first contacts; a draw is one recording of each."""
    draws, seed = options.draws, options.seed
    rows = run(draws, seed, few_cells() if options.quick else cells())
    alarms = object_onset.alarms(FREE_FRAMES_PER_DRAW[options.quick] * draws, seed)
    onsets = object_onset.onsets(draws, seed, SPEEDS_M_S[:: 3 if options.quick else 1])
    return Findings(
        f"{as_text(rows, draws)}\n\n{object_onset.as_text(alarms, onsets)}",
        {"object.csv": rows, "object_alarms.csv": alarms, "object_onsets.csv": onsets},
        {"object.png": lambda path, force: write_figure(path, rows, force)},
        {"rows": rows, "alarms": alarms, "onsets": onsets},
        headline(rows, alarms),
    )


def headline(rows: Sequence[ObjectRow], alarms: Sequence[AlarmRow]) -> str:
    """Cells that meet every goal, the worst surface, first contacts imagined."""
    met, worst = sum(not row.misses for row in rows), max(row.surface_mm for row in rows)
    imagined, frames = sum(row.alarms for row in alarms), sum(row.frames for row in alarms)
    return (
        f"{met} of {len(rows)} cells meet every goal; surface within {worst:.2f} mm rms; "
        f"{imagined} first contacts imagined in {frames} free frames"
    )
