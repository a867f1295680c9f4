"""From touches to the object's surface, with its uncertainty, and how far the object yields."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE

from .fit import CONVERGED, Fit, begin, fit
from .mesh import deviations_along, piece_of
from .touches import Touches, touches_of

_DEVIATIONS_95 = 1.96
_LEAST_VARIATION = 0.05  # below this relative spread of the normal forces nothing can be said
# What the model leaves out may move contacts by so much over the forces felt, and draws the compliance by this part:
# noise along the antenna flattens what is bent. Rubbed at μ = 0.6, a rigid cylinder seems to yield by 0.25 mm/N
# (`vbaa bench object`).
_MODEL_M, MODEL_SHARE = 1e-5, 0.015
_GUESSED_STD_M = 2e-4  # for touches without covariance, to smooth them by; no deviation is reported then
# touches that scatter more than this about the surface have covariances that are too small: all are widened; fewer
# touches than that do not tell their own scatter
_SCATTER_TOLERATED, _ENOUGH = 1.5, 12


@dataclass(frozen=True, eq=False)
class Compliance:
    """How far the object yields under the normal force.

    Attributes
    ----------
    compliance_m_N, std_m_N : normal displacement per normal force, by the data alone, so that it may come out below
        zero; its standard deviation, calibration included.
    stiffness_N_m : 1 / compliance; NaN unless `determined`.
    interval_N_m : (2,) of 95 %, the upper end infinite where the object may be rigid; NaN where nothing can be said.
    determined : whether the data distinguish the object from a rigid one. Only then is the surface the unpressed one.
    reason : in words, what is known and what is not.
    """

    compliance_m_N: float = np.nan
    std_m_N: float = np.nan
    stiffness_N_m: float = np.nan
    interval_N_m: np.ndarray = field(default_factory=lambda: np.full(2, np.nan))
    determined: bool = False
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Surface:
    """The touched part of the object, world frame: V vertices of what to draw, and P touches on it.

    Attributes
    ----------
    points_m, normals : (V, 3), the normals unit, out of the object. patch : (V,) which patch a vertex belongs to.
    triangles : (T, 3) vertex indices, counter-clockwise seen from outside.
    lines : (E, 2) vertex indices, where the contacts follow an edge or span no area.
    std_m : (V,) along the normal, common errors included; NaN where the contacts' is unknown.
    std_across_m : (V,) of a line, in the surface, across the line; NaN where there is an area.
    touched_m, touched_std_m : (P, 3) where the contacts lie on the surface; (P,) as `std_m`.
    touched_normal, touched_normal_covariance : (P, 3), (P, 3, 3) rad², from shape and tangents, common errors included;
        in directions that these do not determine, the force's, with 1 rad².
    touched_normal_modes : (P, 3, K) what K independent common errors of unit deviation do to it.
    touched_patch, touched_row, touched_frame : (P,) patch, row of the table, frame.
    touched_force_N : (P,) size of the force. outlier : (P,) touches too far off the surface for their covariance.
    compliance : how far the object yields. notes : what a reader of the surface must know, in words.
    """

    points_m: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    lines: np.ndarray
    patch: np.ndarray
    std_m: np.ndarray
    std_across_m: np.ndarray
    touched_m: np.ndarray
    touched_normal: np.ndarray
    touched_normal_covariance: np.ndarray
    touched_normal_modes: np.ndarray
    touched_std_m: np.ndarray
    touched_patch: np.ndarray
    touched_row: np.ndarray
    touched_frame: np.ndarray
    touched_force_N: np.ndarray
    outlier: np.ndarray
    compliance: Compliance
    notes: tuple[str, ...]


def reconstruct(touches: Touches | ContactTable, antenna_radius_m: float) -> Surface:
    """The surface of what was touched, with its uncertainty, and how far the object yields.

    The touches are of one object that did not move; a table stands for its touches without common errors. Contact
    points lie on the antenna's centreline, one radius off the object. Raises InputError as `touches_of`.
    """
    touches = touches_of(touches) if isinstance(touches, ContactTable) else touches
    touches, known, notes = _with_covariances(touches)
    patches, state = begin(touches, antenna_radius_m)
    found = fit(touches, antenna_radius_m, patches, state, True)
    scale = _scatter(found)
    if not known or scale > _SCATTER_TOLERATED:
        touches = replace(touches, own_m2=scale**2 * touches.own_m2)
        found = fit(touches, antenna_radius_m, patches, found.state, True)
        if known:
            notes.append(f"the contacts scatter {scale:.2g} times as much as their covariances say: all were widened")
    compliance = _compliance_of(found)
    if not compliance.determined:
        found = fit(touches, antenna_radius_m, patches, found.state, False)
    if not known:
        reason = "the contacts have no covariance: stiffness cannot be told"
        compliance = Compliance(reason=reason)
    return _surface(found, compliance, known, [*touches.notes, *notes])


def _with_covariances(touches: Touches) -> tuple[Touches, bool, list[str]]:
    """Those without a covariance get the median one of the others; whether any has one; and what to note."""
    given = np.isfinite(touches.own_m2).all(axis=(1, 2))
    given &= np.trace(touches.own_m2, axis1=1, axis2=2) > 0.0
    if given.all():
        return touches, True, []
    usual, note = _GUESSED_STD_M**2 * np.eye(3), "the contacts have no covariance: no standard deviation is given"
    if given.any():
        usual = np.median(touches.own_m2[given], axis=0)
        note = f"{np.sum(~given)} contacts without a covariance were given that of the others"
    own = np.where(given[:, None, None], touches.own_m2, usual)
    return replace(touches, own_m2=own), bool(given.any()), [note]


def _scatter(fit: Fit) -> float:
    """How far the touches lie off what the others predict, in standard deviations of that; 1 where all is well."""
    residual = np.abs(fit.solution.leave_one_out_residuals)
    points = np.concatenate([f.equations.slack == 0 for f in fit.solution.patches])
    return float(np.median(residual[points])) / NORMAL_QUARTILE if len(fit.touches) >= _ENOUGH else 1.0


def _compliance_of(fit: Fit) -> Compliance:
    """What a fit with a compliance says."""
    solution, touches, compliance_m_N = fit.solution, fit.touches, fit.state.compliance_m_N
    press = np.sum(touches.force_N * fit.normals.normal, axis=1)
    pressed = press[press > 0]
    low_N, high_N = (float(np.min(pressed)), float(np.max(pressed))) if len(pressed) else (0.0, 0.0)
    left_out = np.hypot(_MODEL_M / max(high_N - low_N, 1e-12), MODEL_SHARE * compliance_m_N)
    std = float(np.hypot(np.sqrt(solution.variance), left_out))
    lowest, highest = compliance_m_N - _DEVIATIONS_95 * std, compliance_m_N + _DEVIATIONS_95 * std
    forces = f"normal forces from {1e3 * low_N:.3g} to {1e3 * high_N:.3g} mN"
    unknown = "the object's stiffness cannot be told"
    stiffness, interval = np.nan, np.full(2, np.nan)
    extent = float(np.linalg.norm(np.ptp(touches.point_m, axis=0)))
    if len(touches) < 3 or not high_N - low_N > _LEAST_VARIATION * high_N or not std > 0:
        reason = f"{unknown}: {len(touches)} contacts, {forces}"
    elif abs(solution.compliance_m_N) > CONVERGED * std:
        reason = f"{unknown}: shape and stiffness do not converge together"
    elif highest <= 0:
        shift = f"{-1e3 * compliance_m_N:.3g} ± {1e3 * std:.2g} mm/N"
        reason = f"{unknown}: the harder it was pressed, the farther out it was found, by {shift}"
        reason += "; check the rig's calibration"
    elif lowest > 0:
        stiffness, interval = 1 / compliance_m_N, np.array([1 / highest, 1 / lowest])
        between = f"95 % interval {interval[0]:.4g} to {interval[1]:.4g}"
        reason = f"the object's stiffness is {stiffness:.4g} N/m, {between} ({forces})"
    elif highest * (high_N - low_N) > max(0.5 * extent, 1e-3):
        reason = f"{unknown} from these contacts: {forces} do not move it apart"
    else:
        interval = np.array([1 / highest, np.inf])
        reason = f"the object is stiffer than {interval[0]:.3g} N/m (95 %); the surface is as it was under these forces"
    return Compliance(compliance_m_N, std, stiffness, interval, bool(np.isfinite(stiffness)), reason)


def _surface(found: Fit, compliance: Compliance, known: bool, notes: list[str]) -> Surface:
    touches, count = found.touches, len(found.touches)
    touched, touched_std, label = np.empty((count, 3)), np.empty(count), np.empty(count, int)
    pieces = []
    for index, patch in enumerate(found.patches):
        m = patch.members
        label[m], (touched[m], touched_std[m]) = index, _touches_on_surface(found, index)
        pieces.append(piece_of(found, index, touched_std[m]))
    sizes = [len(piece["points_m"]) for piece in pieces]
    vague, outlier = np.sum(found.state.vague), np.sum(found.state.outlier)
    if vague:
        notes.append(f"{vague} contacts were not used: where along the antenna they lie is hardly known")
    if outlier:
        notes.append(f"{outlier} contacts were left out: they lie too far off what the others say")
    curves = [len(patch.members) for patch in found.patches if not patch.wide]
    if curves:
        some = f"{len(curves)} of {len(pieces)} patches ({sum(curves)} of {count} contacts)"
        notes.append(f"{some} are too narrow for a surface; drawn as lines")
    for piece, start in zip(pieces, np.cumsum([0, *sizes[:-1]]), strict=True):
        piece["triangles"], piece["lines"] = piece["triangles"] + start, piece["lines"] + start
        if not known:
            piece["std_m"], piece["std_across_m"] = np.nan * piece["std_m"], np.nan * piece["std_m"]
    return Surface(
        **{name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]},
        patch=np.repeat(np.arange(len(pieces)), sizes),
        touched_m=touched,
        touched_normal=found.normals.normal,
        touched_normal_covariance=found.normals.covariance,
        touched_normal_modes=found.normals.modes,
        touched_std_m=(1.0 if known else np.nan) * touched_std,
        touched_patch=label,
        touched_row=touches.row,
        touched_frame=touches.frame,
        touched_force_N=np.linalg.norm(touches.force_N, axis=1),
        outlier=found.state.outlier,
        compliance=compliance,
        notes=tuple(notes),
    )


def _touches_on_surface(fit: Fit, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a patch's touches lie on its shape (N, 3), world, and the deviations (N,) along the normal."""
    patch = fit.patches[index]
    local = fit.local(patch)
    if patch.wide:
        points, _, std = fit.heights(index, local[:, :2])
        return points, std
    points, covariance = fit.along_curve(index, local[:, 0])
    return points, deviations_along((fit.normals.normal[patch.members] @ patch.frame.T)[:, 1:], covariance)
