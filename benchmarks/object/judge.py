"""One recording of a stroked object against its truth."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from estimator.object.estimate import ObjectEstimate, estimate_object
from estimator.table.contacts import FRICTION_RAD

from .scenes import Recorded, contacts

_REGION = 0.95
_WIDE = float(norm.isf((1.0 - _REGION) / 2.0))
_LEAST_VARIANCE = 1e-12
_LEAST_FORCE_N = 0.01
"""Directions of smaller forces are not judged."""


@dataclass(frozen=True, eq=False)
class Judged:
    """One draw against the truth; errors are estimated less true.

    Attributes
    ----------
    contacts, imagined : number of touches on the surface, and of located contacts of a free antenna.
    surface_m, surface_std_m : (V,) distance of the drawn vertices from the object, and their deviations; NaN for these
        where they are not known. touched_m : (P,) distance of the touches on the surface.
    point_m, point_std_m : (P,) errors of the contact points along the object's normal, and their deviations.
    normal_rad, normal_inside : (P,) angle to the true normal, and whether that lies in the 95 % region.
    force_rad : (K,) angle of the forces above `_LEAST_FORCE_N` to the true normal.
    mu, mu_inside, stiffness_N_m, stiffness_inside : NaN and False where they are undetermined.
    estimate_s, feel_s : time taken, s.
    """

    contacts: int
    imagined: int
    surface_m: np.ndarray
    surface_std_m: np.ndarray
    touched_m: np.ndarray
    point_m: np.ndarray
    point_std_m: np.ndarray
    normal_rad: np.ndarray
    normal_inside: np.ndarray
    force_rad: np.ndarray
    mu: float
    mu_told: bool
    mu_inside: bool
    compliance_m_N: float
    compliance_std_m_N: float
    stiffness_N_m: float
    stiffness_told: bool
    stiffness_inside: bool
    estimate_s: float
    feel_s: float


def judge(recorded: Recorded, friction_rad: float = FRICTION_RAD) -> Judged:
    """Estimate a recording's contacts and object, and compare them with the truth.

    `friction_rad` is the deviation of the friction angle that the estimator is given.
    """
    begin = time.perf_counter()
    table = contacts(recorded, friction=friction_rad)
    estimated = time.perf_counter()
    felt = estimate_object(table, recorded.given, friction_rad)
    done = time.perf_counter()
    truth, obj, surface = recorded.truth, recorded.object, felt.surface
    rows = surface.touched_row
    right = truth.in_contact[rows]
    normal = truth.normal_world[rows]
    forces = table.located & truth.in_contact & (np.linalg.norm(table.force_world_N, axis=1) > _LEAST_FORCE_N)
    away = table.point_world_m[rows] - truth.point_world_m[rows]
    turned, inside = _normals(felt, normal)
    rub, soft = felt.friction, felt.compliance
    return Judged(
        contacts=len(rows),
        imagined=int((table.located & ~truth.in_contact).sum()),
        surface_m=obj.signed_distance(surface.points_m)[0],
        surface_std_m=surface.std_m,
        touched_m=obj.signed_distance(surface.touched_m)[0],
        point_m=(away * normal).sum(axis=1)[right],
        point_std_m=np.sqrt(np.einsum("pi,pij,pj->p", normal, table.covariance_world_m2[rows], normal))[right],
        normal_rad=turned[right],
        normal_inside=inside[right],
        force_rad=_angle(table.force_world_N[forces], truth.normal_world[forces]),
        mu=rub.mu,
        mu_told=rub.determined,
        mu_inside=bool(rub.interval[0] <= obj.friction <= rub.interval[1]),
        compliance_m_N=soft.compliance_m_N,
        compliance_std_m_N=soft.std_m_N,
        stiffness_N_m=soft.stiffness_N_m,
        stiffness_told=soft.determined,
        stiffness_inside=bool(soft.interval_N_m[0] <= obj.stiffness_N_m <= soft.interval_N_m[1]),
        estimate_s=estimated - begin,
        feel_s=done - estimated,
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


def covered(errors: np.ndarray, std: np.ndarray) -> float:
    """Share of the 95 % intervals, where there are any, that hold the truth."""
    known = np.isfinite(std) & np.isfinite(errors)
    return float((np.abs(errors[known]) <= _WIDE * std[known]).mean()) if known.any() else np.nan
