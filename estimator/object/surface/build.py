"""From touches to the object's surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE

from .equations import value_rows
from .fit import SETTLED, Fit, first_state, fit, make_patches
from .mesh import Piece, heights, piece_of
from .result import Compliance, Surface
from .solution import leave_one_out_residuals
from .touches import Touches, touches_of

_DEVIATIONS_95 = 1.96
_LEAST_VARIATION = 0.05
"""Below this relative spread of the normal forces nothing can be said."""


_MODEL_M, MODEL_SHARE = 1e-5, 0.015
"""What the model leaves out may move contacts by so much over the forces felt, and draws the compliance by this part:
noise along the antenna flattens what is bent. Rubbed at μ = 0.6, a rigid cylinder seems to yield by 0.25 mm/N
(`vbaa bench object`)."""


def _compliance_of(fit: Fit) -> Compliance:
    """What a fit with a compliance says."""
    solution, touches, compliance_m_N = fit.solution, fit.touches, fit.state.compliance_m_N
    press = np.sum(touches.force_N * fit.normals.normal, axis=1)
    pressed = press[press > 0]
    low_N, high_N = (float(np.min(pressed)), float(np.max(pressed))) if len(pressed) else (0.0, 0.0)
    own = float(np.sqrt(solution.own_variance))
    left_out = np.hypot(_MODEL_M / max(high_N - low_N, 1e-12), MODEL_SHARE * compliance_m_N)
    std = float(np.hypot(np.sqrt(solution.variance), left_out))
    lowest, highest = compliance_m_N - _DEVIATIONS_95 * std, compliance_m_N + _DEVIATIONS_95 * std
    nothing = np.full(2, np.nan)
    forces = f"normal forces from {1e3 * low_N:.3g} to {1e3 * high_N:.3g} mN"

    def untold(reason: str, interval: np.ndarray = nothing) -> Compliance:
        return Compliance(compliance_m_N, std, own, np.nan, interval, False, reason)

    if len(touches) < 3 or not high_N - low_N > _LEAST_VARIATION * high_N or not std > 0:
        return untold(f"the object's stiffness cannot be told: {len(touches)} contacts, {forces}")
    if abs(solution.compliance_m_N) > SETTLED * std:
        return untold("the object's stiffness cannot be told: shape and stiffness do not settle together")
    if highest <= 0:
        return untold(
            "the object's stiffness cannot be told: the harder it was pressed, the farther out it was found, by "
            f"{-1e3 * compliance_m_N:.3g} ± {1e3 * std:.2g} mm/N; check the rig's calibration"
        )
    if lowest > 0:
        interval = np.array([1 / highest, 1 / lowest])
        stiffness = 1 / compliance_m_N
        words = f"the object's stiffness is {stiffness:.4g} N/m, 95 % interval {interval[0]:.4g} to {interval[1]:.4g}"
        return Compliance(compliance_m_N, std, own, stiffness, interval, True, f"{words} ({forces})")
    extent = float(np.linalg.norm(np.ptp(touches.point_m, axis=0)))
    if highest * (high_N - low_N) > max(0.5 * extent, 1e-3):
        return untold(f"the object's stiffness cannot be told from these contacts: {forces} do not move it apart")
    return untold(
        f"the object is stiffer than {1 / highest:.3g} N/m (95 %); the surface is as it was under these forces",
        np.array([1 / highest, np.inf]),
    )


def _unknown_compliance(reason: str) -> Compliance:
    """Where there is nothing to judge by."""
    return Compliance(np.nan, np.nan, np.nan, np.nan, np.full(2, np.nan), False, reason)


_GUESSED_STD_M = 2e-4
"""For touches whose covariance is not given, to smooth them by; no deviation is reported then."""
_SCALE_TOLERATED = 1.5
"""Touches that scatter more than this about the surface have covariances that are too small: all are widened."""
_ENOUGH = 12
"""Fewer touches do not tell their own scatter."""


def reconstruct(touches: Touches | ContactTable, antenna_radius_m: float) -> Surface:
    """The surface of what was touched, with its uncertainty, and how far the object yields.

    Parameters
    ----------
    touches : of one object that did not move; a table stands for its touches without common errors.
    antenna_radius_m : the contact points lie on the antenna's centreline, one radius off the object.

    Raises
    ------
    InputError : a table in which no frame has a contact point with its force.
    """
    touches = touches_of(touches) if isinstance(touches, ContactTable) else touches
    touches, known, notes = _with_covariances(touches)
    patches, normal = make_patches(touches, antenna_radius_m)
    found = fit(touches, antenna_radius_m, patches, first_state(touches, patches, normal), True)
    scale = _scatter(found)
    if not known or scale > _SCALE_TOLERATED:
        touches = replace(touches, own_m2=scale**2 * touches.own_m2)
        found = fit(touches, antenna_radius_m, patches, found.state, True)
        if known:
            notes.append(f"the contacts scatter {scale:.2g} times as much as their covariances say: all were widened")
    compliance = _compliance_of(found)
    if not compliance.determined:
        found = fit(touches, antenna_radius_m, patches, found.state, False)
    return _surface(found, compliance, known, [*touches.notes, *notes])


def _scatter(fit: Fit) -> float:
    """How far the touches lie off what the others predict, in standard deviations of that; 1 where all is well."""
    residual = np.abs(leave_one_out_residuals(fit.solution))
    points = np.concatenate([f.equations.slack == 0 for f in fit.solution.patches])
    return float(np.median(residual[points])) / NORMAL_QUARTILE if len(fit.touches) >= _ENOUGH else 1.0


def _with_covariances(touches: Touches) -> tuple[Touches, bool, list[str]]:
    """Those without a covariance get the median one of the others; whether any has one; and what to note."""
    given = np.isfinite(touches.own_m2).all(axis=(1, 2))
    given &= np.trace(touches.own_m2, axis1=1, axis2=2) > 0.0
    if given.all():
        return touches, True, []
    if not given.any():
        own = np.tile(_GUESSED_STD_M**2 * np.eye(3), (len(touches), 1, 1))
        return replace(touches, own_m2=own), False, ["the contacts have no covariance: no standard deviation is given"]
    own = np.where(given[:, None, None], touches.own_m2, np.median(touches.own_m2[given], axis=0))
    note = f"{np.sum(~given)} contacts without a covariance were given that of the others"
    return replace(touches, own_m2=own), True, [note]


def _surface(found: Fit, compliance: Compliance, known: bool, notes: list[str]) -> Surface:
    touches, count = found.touches, len(found.touches)
    touched, touched_std = np.empty((count, 3)), np.empty(count)
    pieces: list[Piece] = []
    for index, patch in enumerate(found.patches):
        m = patch.members
        touched[m], touched_std[m] = _touches_on_surface(found, index)
        pieces.append(piece_of(found, index, touched_std[m]))
    sizes = [len(piece.points_m) for piece in pieces]
    starts = np.cumsum([0, *sizes[:-1]])
    label = np.empty(count, int)
    for index, patch in enumerate(found.patches):
        label[patch.members] = index
    left_out, vague = found.state.outlier, found.state.vague
    if vague.any():
        notes.append(f"{np.sum(vague)} contacts were not used: where along the antenna they lie is hardly known")
    if left_out.any():
        notes.append(f"{np.sum(left_out)} contacts were left out: they lie too far off what the others say")
    curves = [patch for patch in found.patches if not patch.wide]
    if curves:
        notes.append(
            f"{len(curves)} of {len(pieces)} patches ({sum(len(p.members) for p in curves)} of {count} contacts) are "
            "too narrow for a surface; drawn as lines"
        )
    told = 1.0 if known else np.nan
    return Surface(
        points_m=np.concatenate([piece.points_m for piece in pieces]),
        normals=np.concatenate([piece.normals for piece in pieces]),
        triangles=np.concatenate([piece.triangles + start for piece, start in zip(pieces, starts, strict=True)]),
        lines=np.concatenate([piece.lines + start for piece, start in zip(pieces, starts, strict=True)]),
        patch=np.repeat(np.arange(len(pieces)), sizes),
        std_m=told * np.concatenate([piece.std_m for piece in pieces]),
        std_across_m=told * np.concatenate([piece.std_across_m for piece in pieces]),
        touched_m=touched,
        touched_normal=found.normals.normal,
        touched_normal_covariance=found.normals.covariance,
        touched_normal_modes=found.normals.modes,
        touched_std_m=told * touched_std,
        touched_patch=label,
        touched_row=touches.row,
        touched_frame=touches.frame,
        touched_force_N=np.linalg.norm(touches.force_N, axis=1),
        outlier=left_out,
        compliance=compliance
        if known
        else _unknown_compliance("the contacts have no covariance: stiffness cannot be told"),
        notes=tuple(notes),
    )


def _touches_on_surface(fit: Fit, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a patch's touches lie on its shape (N, 3), world, and the deviations (N,) along the normal."""
    patch = fit.patches[index]
    local = (fit.point_m[patch.members] - patch.center_m) @ patch.frame.T
    if patch.wide:
        points, _, std = heights(fit, index, local[:, :2])
        return points, std
    rows = value_rows(patch, local[:, :1])
    across, joint = fit.solution.mean(index, rows).reshape(2, -1), fit.solution.joint([(index, rows)])
    pair = np.arange(len(local))[:, None] + [0, len(local)]
    normal = (fit.normals.normal[patch.members] @ patch.frame.T)[:, 1:]
    variance = np.einsum("ni,nij,nj->n", normal, joint[pair[:, :, None], pair[:, None, :]], normal)
    points = patch.center_m + np.column_stack([local[:, 0], *across]) @ patch.frame
    return points, np.sqrt(np.maximum(variance, 0.0))
