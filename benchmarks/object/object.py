"""`vbaa bench object`: objects estimated from strokes, against what is true of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.estimator.setup import drawn_truth
from benchmarks.figures import AMBER, GREEN, INK, RED, VIOLET, label, legend, panels
from benchmarks.harness import Findings, Options, column, mean_of, or_none, rms_known, table
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.core.console import progress

from . import onset as object_onset
from .cases import CASES, RIGID, SETUP, SOFT, SOFTER, Case
from .judge import Judged, covered, judge
from .onset import SPEEDS_M_S, AlarmRow
from .scenes import Recorded, play

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SURFACE_OF_POINTS_GOAL, _SURFACE_GOAL_M = 2.0, 1e-3
_NORMAL_GOAL_RAD, _FORCE_GOAL_RAD = np.radians(3.0), np.radians(2.0)
_MU_GOAL, _STIFFNESS_GOAL = 0.03, 0.10
_USUAL_FRICTION = 0.2
_RUBBED = ("cylinder", "sphere")
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
    slippery : whether the estimator knows that there is no friction.
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
    normal_deg, force_deg : rms angle to the true normal, of the estimated normals and of the forces; force_median_deg.
    mu_error : rms over the draws in which μ was told; mu_told : their share; mu_covered : share of all intervals.
    stiffness_error : rms, relative; stiffness_told, stiffness_covered likewise.
    compliance_error_std : rms error of the compliance in its own deviations, determined or not.
    estimate_s, feel_s : least time of a draw.
    """

    object: str = column("object")
    stiffness_N_m: float | None = column("k N/m", ".0f")
    friction: float = column("μ", ".1f")
    rig: str = column("rig")
    draws: int = column()
    contacts: float = column("touches", ".0f")
    imagined: float = column()
    surface_mm: float = column("surface mm", ".3f")
    worst_mm: float = column()
    surface_covered: float = column("cov", ".2f")
    touched_mm: float = column()
    point_mm: float = column("points mm", ".3f")
    point_std_mm: float = column("std", ".3f")
    point_covered: float = column("cov", ".2f")
    normal_deg: float = column("normal °", ".2f")
    normal_covered: float = column("cov", ".2f")
    force_deg: float = column("force °", ".2f")
    force_median_deg: float = column()
    mu_error: float | None = column("μ error", ".4f")
    mu_told: float = column("told", ".2f")
    mu_covered: float = column("cov", ".2f")
    stiffness_error: float | None = column("k error %", ".1f", 100)
    stiffness_told: float = column("told", ".2f")
    stiffness_covered: float = column("cov", ".2f")
    compliance_error_std: float = column()
    estimate_s: float = column("s", ".1f")
    feel_s: float = column("s object", ".1f")

    @property
    def misses(self) -> tuple[str, ...]:
        """The goals that this cell misses. Intervals are judged over all cells: in one the errors go together."""
        surface = (
            self.surface_mm > _SURFACE_OF_POINTS_GOAL * self.point_std_mm or self.surface_mm > 1e3 * _SURFACE_GOAL_M
        )
        found = {
            "surface": surface,
            "normals": self.normal_deg > np.degrees(_NORMAL_GOAL_RAD),
            "force": self.rig.endswith("slippery") and self.force_deg > np.degrees(_FORCE_GOAL_RAD),
            "friction": self.mu_error is None or self.mu_error > _MU_GOAL,
            "stiffness": self.stiffness_N_m is not None
            and (self.stiffness_error is None or self.stiffness_told < 1.0 or self.stiffness_error > _STIFFNESS_GOAL),
        }
        return tuple(name for name, missed in found.items() if missed)


def cells() -> list[Cell]:
    """Every object rigid and soft, some with other frictions; each with an exact rig and with one that is off."""
    shapes = [
        Cell(case, soft, _USUAL_FRICTION, exact) for case in CASES for soft in (RIGID, SOFT) for exact in (True, False)
    ]
    rubbed = [case for case in CASES if case.name in _RUBBED]
    rubs = [Cell(case, RIGID, mu, exact) for case in rubbed for mu in FRICTIONS for exact in (True, False)]
    slippery = [Cell(case, RIGID, 0.0, exact, True) for case in CASES for exact in (True, False)]
    softer = [Cell(case, SOFTER, _USUAL_FRICTION, exact) for case in CASES for exact in (True, False)]
    return shapes + rubs + slippery + softer


def _few_cells() -> list[Cell]:
    """For a first look: one object with an exact rig, with one that is off, and soft; another one."""
    one, other = (next(case for case in CASES if case.name == name) for name in FIRST_LOOK)
    rigid = [Cell(one, RIGID, _USUAL_FRICTION, exact) for exact in (True, False)]
    return [*rigid, Cell(one, SOFTER, _USUAL_FRICTION, True), Cell(other, RIGID, _USUAL_FRICTION, True)]


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
        judged = []
        for index in range(draws):
            rng = np.random.default_rng((seed, number, index))
            given = played[key].true if cell.exact else drawn_truth(replace(SETUP, exact=False).rig(), rng)
            judged.append(judge(played[key].noisy(rng, given), 0.0 if cell.slippery else FRICTION_RAD))
        yield cell, judged


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


def as_text(rows: Sequence[ObjectRow], draws: int) -> str:
    """The table for people, then all cells with an exact rig and all with one that is off."""
    title = (
        f"{draws} draws a cell; rms errors; cov: share of the 95 % regions that hold the truth; points along the "
        f"object's normal;\nμ and stiffness where they are determined, with the share of draws in which they are; "
        f"goals: surface {_SURFACE_OF_POINTS_GOAL:.0f} × the points' deviation and {1e3 * _SURFACE_GOAL_M:.0f} mm,\n"
        f"normals {np.degrees(_NORMAL_GOAL_RAD):.0f}°, forces of slippery objects {np.degrees(_FORCE_GOAL_RAD):.0f}°, "
        f"μ {_MU_GOAL}, stiffness {100 * _STIFFNESS_GOAL:.0f} %"
    )
    lines = [table(rows, title, more={"misses": lambda row: ", ".join(row.misses) or "none"})]
    for rig in ("exact", "off"):
        some = [row for row in rows if row.rig.startswith(rig)]
        if some:
            covered = ", ".join(f"{name} {mean_of(some, f'{field}_covered'):.2f}" for name, field in _REGIONS.items())
            met = sum(not row.misses for row in some)
            lines.append(
                f"rig {rig}: {met} of {len(some)} cells miss nothing; 95 % regions that hold the truth: {covered}"
            )
    return "\n".join(lines)


_REGIONS = {"surface": "surface", "points": "point", "normals": "normal", "μ": "mu", "stiffness": "stiffness"}
_STYLES = {"cylinder": (GREEN, "o"), "sphere": (AMBER, "o"), "box edge": (VIOLET, "o"), "free form": (RED, "o")}


def figure(rows: Sequence[ObjectRow]) -> Figure:
    """Surface, normals, friction and stiffness, each with its goal; squares are soft objects."""
    drawn, every = panels(4, 2, (6, 4))
    deviation = "deviation of the contact points, mm"
    shown = (
        ("point_std_mm", "surface_mm", 1.0, deviation, "surface, rms error, mm", np.nan),
        ("point_std_mm", "normal_deg", 1.0, deviation, "normals, rms error, °", np.degrees(_NORMAL_GOAL_RAD)),
        ("friction", "mu_error", 1.0, "coefficient of friction", "its rms error", _MU_GOAL),
        ("stiffness_N_m", "stiffness_error", 100.0, "stiffness, N/m", "its rms error, %", 100 * _STIFFNESS_GOAL),
    )
    for panel, (across, up, scale, x, y, goal) in zip(every, shown, strict=True):
        for row in (row for row in rows if getattr(row, up) is not None):
            colour = _STYLES[row.object][0] if row.object in _STYLES else INK
            mark = "o" if row.stiffness_N_m is None else "s"
            face = colour if row.rig.startswith("exact") else "none"
            at = getattr(row, across), max(scale * getattr(row, up), 1e-6)
            panel.plot(*at, mark, color=colour, markerfacecolor=face)
        panel.axhline(goal, color=INK, lw=1.2)
        label(panel, "", x, y)
        panel.set_yscale("log")
    span = np.array(sorted(row.point_std_mm for row in rows))
    every[0].plot(span, np.minimum(_SURFACE_OF_POINTS_GOAL * span, 1e3 * _SURFACE_GOAL_M), color=INK, lw=1.2)
    every[0].set_xscale("log")
    legend(drawn, _STYLES, "hollow: rig off; lines: goals; squares: soft objects")
    return drawn


_FREE_FRAMES_PER_DRAW = {False: 2_000, True: 600}
"""Frames without contact in which a first contact would be a false alarm, for each recording of a kind."""


def measure(options: Options) -> Findings:
    """Every cell, false alarms and first contacts; a draw is one recording of each."""
    draws, seed = options.draws, options.seed
    rows = run(draws, seed, _few_cells() if options.quick else cells())
    alarms = object_onset.alarms(_FREE_FRAMES_PER_DRAW[options.quick] * draws, seed)
    onsets = object_onset.onsets(draws, seed, SPEEDS_M_S[:: 3 if options.quick else 1])
    return Findings(
        f"{as_text(rows, draws)}\n\n{object_onset.as_text(alarms, onsets)}",
        {"object.csv": rows, "object_alarms.csv": alarms, "object_onsets.csv": onsets},
        {"object.png": lambda: figure(rows)},
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
