"""The object's surface from touches: uncertainty, compliance, and a mesh between the touches, not beyond them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from estimator.object.surface.settings import SurfaceSettings
from estimator.table.contacts import ContactTable
from vbaa_calib.core.robust import NORMAL_QUARTILE
from vbaa_calib.geometry.covariance import variance_along

from .fit import SurfaceFit, begin, fit
from .patches import across_curve, bridged_gap, nearest_first
from .touches import Touches, touches_of

_Piece = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Compliance:
    """Compliance of the object under the normal force.

    Attributes
    ----------
    compliance_m_N, std_m_N : normal displacement per normal force, by the data alone, so that it may come out below
        zero; its standard deviation, calibration included.
    stiffness_N_m : 1 / compliance; NaN unless `determined`.
    interval_N_m : (2,) of 95 %, the upper end infinite where the object may be rigid; NaN where nothing is known.
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


def reconstruct(touches: Touches | ContactTable, antenna_radius_m: np.ndarray | float) -> Surface:
    """The touched part of the surface, with its uncertainty, and the object's compliance.

    The touches are of one object that did not move; a table stands for its touches without common errors. Contact
    points lie on the antenna's centreline, one radius, () or (P,), off the object. Raises InputError as `touches_of`.
    """
    return _surface(*fitted(touches_of(touches) if isinstance(touches, ContactTable) else touches, antenna_radius_m))


def fitted(touches: Touches, antenna_radius_m: np.ndarray | float) -> tuple[SurfaceFit, Compliance, bool, list[str]]:
    """The solved shape of `reconstruct`, the compliance, whether covariances are known, and notes."""
    measured = np.isfinite(touches.own_m2).all(axis=(1, 2))
    measured &= np.trace(touches.own_m2, axis1=1, axis2=2) > 0.0
    known, notes = bool(measured.any()), []
    if not measured.all():  # those without a covariance get the median one of the others
        usual, note = (
            SurfaceSettings.guessed_std_m**2 * np.eye(3),
            "the contacts have no covariance: no standard deviation is given",
        )
        if known:
            usual = np.median(touches.own_m2[measured], axis=0)
            note = f"{np.sum(~measured)} contacts without a covariance were given that of the others"
        touches, notes = replace(touches, own_m2=np.where(measured[:, None, None], touches.own_m2, usual)), [note]
    patches, state = begin(touches, antenna_radius_m)
    found = fit(touches, antenna_radius_m, patches, state, True)
    scale = 1.0
    if (
        len(touches) >= SurfaceSettings.fewest_scattered
    ):  # how far they lie off what the others predict, in deviations of that
        points = np.concatenate([each.slack == 0 for each in found.solution.equations])
        scale = float(np.median(np.abs(found.solution.leave_one_out_residuals)[points])) / NORMAL_QUARTILE
    if not known or scale > SurfaceSettings.tolerated_scatter:
        touches = replace(touches, own_m2=scale**2 * touches.own_m2)
        found = fit(touches, antenna_radius_m, patches, found.state, True)
        if known:
            notes.append(f"the contacts scatter {scale:.2g} times as much as their covariances say: all were widened")
    compliance = _compliance_of(found)
    if not compliance.determined:
        found = fit(touches, antenna_radius_m, patches, found.state, False)
    if not known:
        reason = "the contacts have no covariance: stiffness is undetermined"
        compliance = Compliance(reason=reason)
    return found, compliance, known, [*touches.notes, *notes]


def _compliance_of(fit: SurfaceFit) -> Compliance:
    """The compliance from a fit that includes one."""
    solution, touches, compliance_m_N = fit.solution, fit.touches, fit.state.compliance_m_N
    press = np.sum(touches.force_N * fit.normals.normal, axis=1)
    pressed = press[press > 0]
    low_N, high_N = (float(np.min(pressed)), float(np.max(pressed))) if len(pressed) else (0.0, 0.0)
    left_out = np.hypot(
        SurfaceSettings.model_m / max(high_N - low_N, 1e-12), SurfaceSettings.model_share * compliance_m_N
    )
    std = float(np.hypot(np.sqrt(solution.variance), left_out))
    lowest, highest = (
        compliance_m_N - SurfaceSettings.interval_std * std,
        compliance_m_N + SurfaceSettings.interval_std * std,
    )
    forces = f"normal forces from {1e3 * low_N:.3g} to {1e3 * high_N:.3g} mN"
    unknown = "the object's stiffness is undetermined"
    stiffness, interval = np.nan, np.full(2, np.nan)
    extent = float(np.linalg.norm(np.ptp(touches.point_m, axis=0)))
    if len(touches) < 3 or not high_N - low_N > SurfaceSettings.least_variation * high_N or not std > 0:
        reason = f"{unknown}: {len(touches)} contacts, {forces}"
    elif abs(solution.compliance_m_N) > SurfaceSettings.not_converged_std * std:
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


def _surface(found: SurfaceFit, compliance: Compliance, known: bool, notes: list[str]) -> Surface:
    """The surface to draw from a solved shape, with its numbers at the touches. known : whether covariances are."""
    touches, count, normals = found.touches, len(found.touches), found.normals_with_common_errors()
    touched, touched_std, label = np.empty((count, 3)), np.empty(count), np.empty(count, int)
    pieces = []
    for index, patch in enumerate(found.patches):
        m = patch.members
        label[m], local = index, found.local(patch)
        if patch.wide:
            touched[m], _, touched_std[m] = found.heights(index, local[:, :2])
        else:
            touched[m] = found.along_curve(index, local[:, 0])[0]
            touched_std[m] = found.std_along(index, local, found.normals.normal[m])
        pieces.append(_piece_of(found, index, touched_std[m]))
    sizes = [len(piece["points_m"]) for piece in pieces]
    vague, outlier = np.sum(found.state.vague), np.sum(found.state.outlier)
    if vague:
        notes.append(f"{vague} contact{'s' * int(vague != 1)} not used: the place along the antenna is hardly known")
    if outlier:
        notes.append(f"{outlier} contacts were left out: they lie too far off what the others say")
    curves = [len(patch.members) for patch in found.patches if not patch.wide]
    if curves:
        some = f"{len(curves)} of {len(pieces)} patches ({sum(curves)} of {count} contacts)"
        notes.append(f"too narrow for a surface, and drawn as lines: {some}")
    for piece, start in zip(pieces, np.cumsum([0, *sizes[:-1]]), strict=True):
        piece["triangles"], piece["lines"] = piece["triangles"] + start, piece["lines"] + start
        if not known:
            piece["std_m"], piece["std_across_m"] = np.nan * piece["std_m"], np.nan * piece["std_m"]
    return Surface(
        **{name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]},
        patch=np.repeat(np.arange(len(pieces)), sizes),
        touched_m=touched,
        touched_normal=normals.normal,
        touched_normal_covariance=normals.covariance,
        touched_normal_modes=normals.modes,
        touched_std_m=(1.0 if known else np.nan) * touched_std,
        touched_patch=label,
        touched_row=touches.row,
        touched_frame=touches.frame,
        touched_force_N=np.linalg.norm(touches.force_N, axis=1),
        outlier=found.state.outlier,
        compliance=compliance,
        notes=tuple(notes),
    )


def _piece(points: np.ndarray, normals: np.ndarray, std: np.ndarray, across: np.ndarray, **cells: np.ndarray) -> _Piece:
    none = {"triangles": np.empty((0, 3), int), "lines": np.empty((0, 2), int)}
    return {"points_m": points, "normals": normals, "std_m": std, "std_across_m": across} | none | cells


def _drawn_m(touched_std_m: np.ndarray) -> float:
    """Standard deviation above which a surface is not drawn, from the standard deviations at its touches."""
    return max(SurfaceSettings.drawn_factor * float(np.percentile(touched_std_m, 90)), SurfaceSettings.drawn_m)


def surely_known_m(fit: SurfaceFit, index: int) -> float:
    """Standard deviation above which the surface of a patch is not drawn."""
    patch = fit.patches[index]
    return _drawn_m(fit.std_along(index, fit.local(patch), fit.normals.normal[patch.members]))


def _piece_of(fit: SurfaceFit, index: int, touched_std_m: np.ndarray) -> _Piece:
    """The mesh of an area patch, or the line of a curve. touched_std_m : (N,) standard deviations at its touches."""
    patch = fit.patches[index]
    # who may say how far the patch reaches: not left out, and as well known along it as most
    own = patch.frame[:2] @ fit.touches.own_m2[patch.members] @ patch.frame[:2].T
    std = np.sqrt(np.trace(own, axis1=1, axis2=2))
    sound = (std <= SurfaceSettings.vague_touches * np.median(std)) & (
        fit.state.widened[patch.members] < SurfaceSettings.ignored
    )
    sound = sound if sound.sum() > 1 else np.ones(len(std), bool)  # one place has no footprint
    local = fit.local(patch)[sound]
    if patch.wide:
        places, grid = _footprint(local[:, :2])
        points, normals, std = fit.heights(index, places)
        bound_m = _drawn_m(touched_std_m)
        drawn = std <= max(bound_m, std.min())
        number = np.where(grid >= 0, np.append(np.where(drawn, np.cumsum(drawn) - 1, -1), -1)[grid], -1)
        nowhere = np.full(int(drawn.sum()), np.nan)
        return _piece(points[drawn], normals[drawn], std[drawn], nowhere, triangles=_triangles(number))
    return _line(fit, index, local[:, 0], patch.members[sound])


def _footprint(flat_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (V, 2) of a regular grid between touches (N, 2), and the grid (I, J) of their indices, −1 elsewhere: a
    morphological closing by a disc as wide as a bridged gap."""
    low, high = flat_m.min(axis=0), flat_m.max(axis=0)
    extent = float(np.linalg.norm(high - low))
    gaps = nearest_first(np.linalg.norm(flat_m[:, None] - flat_m, axis=-1))[1]
    radius = SurfaceSettings.closing * bridged_gap(gaps, extent)
    width = float(np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(flat_m.T))[0], 0.0)))
    margin = min(max(SurfaceSettings.margin * extent, float(np.median(gaps)) / 2), radius / 2, width)
    step = max(float((high - low).max()) / SurfaceSettings.cells, margin / 2)
    axes = [np.arange(a - radius - 2 * step, b + radius + 3 * step, step) for a, b in zip(low, high, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    away = np.linalg.norm(place[:, :, None] - flat_m, axis=-1).min(axis=-1)
    # in steps, to the nearest place that no touch is near
    free = cv2.distanceTransform((away <= radius).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # 0.71 of a step away from any place there is one of the grid
    inside = (free * step >= radius - margin) | (away <= max(margin, 0.71 * step))
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    return place[inside], number


def _triangles(number: np.ndarray) -> np.ndarray:
    """(T, 3) triangles of a grid of vertex indices (I, J): two for each full cell, one where three corners exist."""
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]).reshape(4, -1)
    missing = corners < 0
    full = corners[:, ~missing.any(axis=0)]
    parts = [full[[0, 1, 2]], full[[0, 2, 3]]]
    for lost in range(4):
        parts.append(np.delete(corners, lost, axis=0)[:, missing[lost] & (missing.sum(axis=0) == 1)])
    return np.concatenate(parts, axis=1).T


def _line(fit: SurfaceFit, index: int, touched_m: np.ndarray, members: np.ndarray) -> _Piece:
    """A curve on an even grid, interrupted at gaps; touches (N,) that do not spread along it are one point."""
    patch, over = fit.patches[index], np.sort(touched_m)
    extent = float(over[-1] - over[0])
    own = patch.frame[0] @ fit.touches.own_m2[members] @ patch.frame[0]
    places, lines = np.array([float(np.mean(over))]), np.empty((0, 2), int)
    if len(over) > 1 and extent > 4 * float(np.sqrt(np.nanmedian(own))):
        places = np.linspace(over[0], over[-1], SurfaceSettings.cells + 1)
        gap = max(
            SurfaceSettings.link_factor * float(np.percentile(np.diff(over), 90)), SurfaceSettings.line_gap * extent
        )
        places = places[np.abs(places[:, None] - over[None]).min(axis=1) <= gap / 2]
        steps = np.arange(len(places) - 1)
        lines = np.stack([steps, steps + 1], axis=1)[np.diff(places) < 1.5 * extent / SurfaceSettings.cells]
    points, covariance = fit.along_curve(index, places)
    # an edge has no one normal: the middle one of those that were felt nearby
    near = np.abs(places[:, None] - touched_m[None])
    near = np.exp(-0.5 * ((near - near.min(axis=1, keepdims=True)) / max(SurfaceSettings.nearby * extent, 1e-6)) ** 2)
    normals = near @ fit.normals.normal[members]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    local = normals @ patch.frame.T
    sides = local[:, 1:], across_curve(local, 1e-9)[1]
    std, std_across = (np.sqrt(np.maximum(variance_along(covariance, side), 0.0)) for side in sides)
    # to second order: beside where it was touched, the object bends away from under the line
    std = np.hypot(std, np.sqrt(0.75) * SurfaceSettings.unseen_bend_per_m * std_across**2)
    if len(fit.patches) > len(places) == 1 and max(std[0], std_across[0]) > SurfaceSettings.lone_drawn_m:
        return _piece(points[:0], normals[:0], std[:0], std_across[:0])
    return _piece(points, normals, std, std_across, lines=lines)
