"""`vbaa bench object`: objects felt by stroking them, against what is true of them.

Every cell is one object with one stiffness, friction and knowledge of the rig. Its strokes are simulated once; a draw
is fresh noise on pixels and readings and, where the rig is off, another given rig, off by a draw of its covariance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..console import progress
from .averages import or_none, rms_known
from .estimator_setup import drawn_truth
from .object_cases import CASES, RIGID, SETUP, SOFT, SOFTER, Case
from .object_judge import Judged, covered, judge
from .object_scenes import FRICTION_RAD, Recorded, play

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
