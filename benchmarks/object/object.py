"""`vbaa bench object`: objects estimated from strokes, against what is true of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from scipy.stats import chi2

from benchmarks.estimator.setup import drawn_truth
from benchmarks.harness import Draws, Findings, Options, column, covered, mean, rms_known, row_of, table
from benchmarks.object.scenes import CASES, RIGID, SETUP, SOFT, SOFTER, Case, Recorded, contacts, played
from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.core.console import progress

_REGION = 0.95
_LEAST_VARIANCE = 1e-12
_LEAST_FORCE_N = 0.01
"""Directions of smaller forces are not judged."""


def judge(recorded: Recorded, friction_rad: float = FRICTION_RAD) -> SimpleNamespace:
    """Estimate a recording's contacts and object, and compare them with the truth, as `ObjectRow` takes it.

    Errors are estimated less true: of the surface's vertices (V,), of the contact points (P,) along the object's normal
    and of the normals (P,), of forces (K,) above `_LEAST_FORCE_N`. friction_rad : what the estimator knows of friction.
    """
    table = contacts(recorded, friction=friction_rad)
    felt = estimate_object(table, recorded.given, friction_rad)
    truth, obj, surface = recorded.truth, recorded.object, felt.surface
    rows = surface.touched_row
    right = truth.in_contact[rows]
    normal = truth.normal_world[rows]
    forces = table.located & truth.in_contact & (np.linalg.norm(table.force_world_N, axis=1) > _LEAST_FORCE_N)
    away = table.point_world_m[rows] - truth.point_world_m[rows]
    turned, inside = _normals(felt, normal)
    rub, soft = felt.friction, felt.compliance
    return SimpleNamespace(
        contacts=len(rows),
        surface_m=obj.signed_distance(surface.points_m)[0],
        surface_std_m=surface.std_m,
        point_m=(away * normal).sum(axis=1)[right],
        point_std_m=np.sqrt(np.einsum("pi,pij,pj->p", normal, table.covariance_world_m2[rows], normal))[right],
        normal_rad=turned[right],
        normal_inside=inside[right],
        force_rad=_angle(table.force_world_N[forces], truth.normal_world[forces]),
        true_mu=obj.friction,
        mu=rub.mu,
        mu_determined=rub.determined,
        mu_inside=bool(rub.interval[0] <= obj.friction <= rub.interval[1]),
        true_stiffness_N_m=obj.stiffness_N_m,
        stiffness_N_m=soft.stiffness_N_m,
        stiffness_determined=soft.determined,
        stiffness_inside=bool(soft.interval_N_m[0] <= obj.stiffness_N_m <= soft.interval_N_m[1]),
    )


def _angle(vectors: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(K,) between vectors, rad; exact for small ones too."""
    across = np.linalg.norm(np.cross(vectors, others), axis=1)
    return np.arctan2(across, (vectors * others).sum(axis=1))


def _normals(felt: ObjectEstimate, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (P,) of the estimated normals to the true ones, and whether these lie in their 95 % regions.

    The turn is judged in those directions across the normal in which the covariance is not zero.
    """
    found, covariance = felt.normals.normal, felt.normals.covariance
    miss = true - (true * found).sum(axis=1, keepdims=True) * found
    values, axes = np.linalg.eigh(np.nan_to_num(covariance))
    along = np.einsum("pij,pi->pj", axes, miss)
    known = values > _LEAST_VARIANCE
    square = np.where(known, along**2 / np.where(known, values, 1.0), 0.0).sum(axis=1)
    limit = chi2.ppf(_REGION, np.maximum(known.sum(axis=1), 1))
    return _angle(found, true), square <= limit


_SURFACE_OF_POINTS_GOAL, _SURFACE_GOAL_M = 2.0, 1e-3
_NORMAL_GOAL_RAD, _FORCE_GOAL_RAD = np.radians(3.0), np.radians(2.0)
_MU_GOAL, _STIFFNESS_GOAL = 0.03, 0.10
_USUAL_FRICTION = 0.2
FIRST_LOOK = ("cylinder", "sphere")
"""Objects on which the other coefficients of friction are tried, and those of a first look."""
FRICTIONS = (0.0, 0.1, 0.4, 0.6)


@dataclass(frozen=True)
class Cell:
    """One object under one condition.

    stiffness_N_m : infinite for a rigid object. friction : Coulomb's μ.
    exact : whether the rig is known exactly; otherwise as well as a calibration says.
    slippery : whether the estimator knows that there is no friction.
    """

    case: Case
    stiffness_N_m: float
    friction: float
    exact: bool
    slippery: bool = False


def _finite(value: float) -> float:
    """The stiffness; NaN of a rigid object."""
    return value if np.isfinite(value) else np.nan


def _stiffness_error(draws: Draws) -> float:
    true = draws.true_stiffness_N_m[0]
    return rms_known(draws.stiffness_N_m / true - 1.0) if np.isfinite(true) else np.nan


@dataclass(frozen=True)
class ObjectRow:
    """One cell, over its draws; NaN where a number does not exist. Errors are root mean squares.

    stiffness_N_m : NaN for a rigid object. contacts : touches of a draw. surface_mm : of the drawn surface's vertices.
    point_mm : of the contact points along the normal, whose own deviations are point_std_mm.
    normal_deg, force_deg : angle of the estimated normals and of the forces to the true normal.
    mu_error, stiffness_error (relative) : over the draws in which they are determined. *_determined : share of these
        draws. *_covered : shares of 95 % regions that contain the truth.
    """

    object: str = column("object")
    stiffness_N_m: float = column("k N/m", ".0f")
    friction: float = column("μ", ".1f")
    rig: str = column("rig")
    draws: int = column(of=len)
    contacts: float = column("touches", ".0f", of=lambda d: float(d.contacts.mean()))
    surface_mm: float = column("surface mm", ".3f", of=lambda d: 1e3 * rms_known(d.surface_m))
    surface_covered: float = column("cov", ".2f", of=lambda d: covered(d.surface_m, d.surface_std_m))
    point_mm: float = column("points mm", ".3f", of=lambda d: 1e3 * rms_known(d.point_m))
    point_std_mm: float = column("std", ".3f", of=lambda d: 1e3 * rms_known(d.point_std_m))
    point_covered: float = column("cov", ".2f", of=lambda d: covered(d.point_m, d.point_std_m))
    normal_deg: float = column("normal °", ".2f", of=lambda d: float(np.degrees(rms_known(d.normal_rad))))
    normal_covered: float = column("cov", ".2f", of=lambda d: float(d.normal_inside.mean()))
    force_deg: float = column("force °", ".2f", of=lambda d: float(np.degrees(rms_known(d.force_rad))))
    mu_error: float = column("μ error", ".4f", of=lambda d: rms_known(d.mu - d.true_mu))
    mu_determined: float = column("determined", ".2f", of=lambda d: float(d.mu_determined.mean()))
    mu_covered: float = column("cov", ".2f", of=lambda d: float(d.mu_inside.mean()))
    stiffness_error: float = column("k error %", ".1f", 100, of=_stiffness_error)
    stiffness_determined: float = column("determined", ".2f", of=lambda d: float(d.stiffness_determined.mean()))
    stiffness_covered: float = column("cov", ".2f", of=lambda d: float(d.stiffness_inside.mean()))

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
            "friction": not self.mu_error <= _MU_GOAL,
            "stiffness": np.isfinite(self.stiffness_N_m)
            and not (self.stiffness_error <= _STIFFNESS_GOAL and self.stiffness_determined == 1.0),
        }
        return tuple(name for name, missed in found.items() if missed)


def cells() -> list[Cell]:
    """Every object rigid and soft, some with other frictions; each with an exact rig and with one that is off."""
    rubbed = [case for case in CASES if case.name in FIRST_LOOK]
    kinds = [
        *((case, stiffness, _USUAL_FRICTION, False) for case in CASES for stiffness in (RIGID, SOFT)),
        *((case, RIGID, mu, False) for case in rubbed for mu in FRICTIONS),
        *((case, RIGID, 0.0, True) for case in CASES),
        *((case, SOFTER, _USUAL_FRICTION, False) for case in CASES),
    ]
    return [Cell(case, k, mu, exact, slippery) for case, k, mu, slippery in kinds for exact in (True, False)]


def _few_cells() -> list[Cell]:
    """For a first look: one object with an exact rig, with one that is off, and soft; another one."""
    one, other = (next(case for case in CASES if case.name == name) for name in FIRST_LOOK)
    rigid = [Cell(one, RIGID, _USUAL_FRICTION, exact) for exact in (True, False)]
    return [*rigid, Cell(one, SOFTER, _USUAL_FRICTION, True), Cell(other, RIGID, _USUAL_FRICTION, True)]


def run(draws: int, seed: int, chosen: Sequence[Cell] | None = None) -> list[ObjectRow]:
    """All cells, or those chosen, with so many draws each."""
    wanted = cells() if chosen is None else list(chosen)
    rows = []
    for number, cell in enumerate(progress(wanted, "objects", len(wanted))):
        recorded = played(cell.case.name, cell.stiffness_N_m, cell.friction)
        judged = []
        for index in range(draws):
            rng = np.random.default_rng((seed, number, index))
            given = recorded.true if cell.exact else drawn_truth(replace(SETUP, exact=False).rig(), rng)
            judged.append(judge(recorded.noisy(rng, given), 0.0 if cell.slippery else FRICTION_RAD))
        rig = ("exact" if cell.exact else "off") + (", slippery" if cell.slippery else "")
        what = cell.case.name, _finite(cell.stiffness_N_m), cell.friction, rig
        rows.append(row_of(ObjectRow, Draws(judged), *what))
    return rows


def _as_text(rows: Sequence[ObjectRow], draws: int) -> str:
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
            covered = ", ".join(
                f"{name} {mean(getattr(Draws(some), f'{field}_covered')):.2f}" for name, field in _REGIONS.items()
            )
            met = sum(not row.misses for row in some)
            lines.append(
                f"rig {rig}: {met} of {len(some)} cells miss nothing; 95 % regions that hold the truth: {covered}"
            )
    return "\n".join(lines)


_REGIONS = {"surface": "surface", "points": "point", "normals": "normal", "μ": "mu", "stiffness": "stiffness"}


def measure(options: Options) -> Findings:
    """Every cell; a draw is one recording of each."""
    draws, seed = options.draws, options.seed
    rows = run(draws, seed, _few_cells() if options.quick else cells())
    met, worst = sum(not row.misses for row in rows), max(row.surface_mm for row in rows)
    return Findings(
        _as_text(rows, draws),
        {"object.csv": rows},
        numbers={"rows": rows},
        headline=f"{met} of {len(rows)} cells meet every goal; surface within {worst:.2f} mm rms",
    )
