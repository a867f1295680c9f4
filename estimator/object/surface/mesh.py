"""A mesh over the part of a patch that was touched: what lies between touches, and nothing beyond them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import KDTree

from .equations import IGNORED, UNSEEN_BEND_PER_M, across_curve
from .fit import Fit
from .patches import LINK_FACTOR, bridged_gap, tree_gaps

_CELLS = 44  # along the longer side of a patch; a curve has as many pieces
_CLOSING = 0.6  # what lies within this many bridged gaps of touches on all sides belongs to the footprint
# the footprint ends this part of the patch's extent, or half a usual gap, beyond the outermost touches; and no farther
# than the standard deviation of the patch's width
_MARGIN = 0.03
_LINE_GAP = 0.1  # a line runs on across gaps up to this part of its length, or a few times as wide as the usual ones
_NEARBY = 0.05  # contacts this part of a line's length away still have a say in its normals
_VAGUE = 3.0  # touches known along the surface this many times worse than most do not widen the footprint
_LONE_SHOWN_M = 2e-3  # a patch of one place is drawn where it is known to this
# no surface where its deviation is larger than both so many times that at nine tenths of the patch's touches, and this
_STD_FACTOR, _STD_SHOWN_M = 2.5, 3e-4


_Piece = dict[str, np.ndarray]


def _piece(points: np.ndarray, normals: np.ndarray, std: np.ndarray, across: np.ndarray, **cells: np.ndarray) -> _Piece:
    none = {"triangles": np.empty((0, 3), int), "lines": np.empty((0, 2), int)}
    return {"points_m": points, "normals": normals, "std_m": std, "std_across_m": across} | none | cells


def deviations_along(side: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(N,) of vectors with covariances (N, D, D), along directions (N, D)."""
    return np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", side, covariance, side), 0.0))


def piece_of(fit: Fit, index: int, touched_std_m: np.ndarray) -> _Piece:
    """The mesh of a wide patch, or the line of a curve; touched_std_m (N,) are the deviations at its touches."""
    patch = fit.patches[index]
    # who may say how far the patch reaches: not left out, and as well known along it as most
    own = patch.frame[:2] @ fit.touches.own_m2[patch.members] @ patch.frame[:2].T
    std = np.sqrt(np.trace(own, axis1=1, axis2=2))
    sound = (std <= _VAGUE * np.median(std)) & (fit.state.widened[patch.members] < IGNORED)
    sound = sound if sound.any() else np.ones(len(std), bool)
    local = fit.local(patch)[sound]
    if patch.wide:
        bound_m = max(_STD_FACTOR * float(np.percentile(touched_std_m, 90)), _STD_SHOWN_M)
        return _mesh(fit, index, local[:, :2], bound_m)
    return _line(fit, index, local[:, 0], patch.members[sound])


def _mesh(fit: Fit, index: int, flat_m: np.ndarray, bound_m: float) -> _Piece:
    places, grid = _footprint(flat_m)
    points, normals, std = fit.heights(index, places)
    shown = std <= max(bound_m, std.min())
    number = np.where(grid >= 0, np.append(np.where(shown, np.cumsum(shown) - 1, -1), -1)[grid], -1)
    nowhere = np.full(int(shown.sum()), np.nan)
    return _piece(points[shown], normals[shown], std[shown], nowhere, triangles=_triangles(number))


def _footprint(flat_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (V, 2) of a regular grid between touches (N, 2), and the grid (I, J) of their numbers, −1 elsewhere.

    A closing: what no disc as wide as a bridged gap reaches without holding a touch.
    """
    low, high = flat_m.min(axis=0), flat_m.max(axis=0)
    extent, gaps = float(np.linalg.norm(high - low)), tree_gaps(flat_m)
    radius = _CLOSING * bridged_gap(gaps, extent)
    width = float(np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(flat_m.T))[0], 0.0)))
    margin = min(max(_MARGIN * extent, float(np.median(gaps)) / 2), radius / 2, width)
    step = max(float((high - low).max()) / _CELLS, margin / 2)
    axes = [np.arange(a - radius - 2 * step, b + radius + 3 * step, step) for a, b in zip(low, high, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    away = KDTree(flat_m).query(place)[0]
    # 0.71 of a step away from any place there is one of the grid
    inside = (distance_transform_edt(away <= radius) * step >= radius - margin) | (away <= max(margin, 0.71 * step))
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    return place[inside], number


def _triangles(number: np.ndarray) -> np.ndarray:
    """(T, 3) two for each full cell of a grid of vertex numbers (I, J), one where three corners are there."""
    corners = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]]).reshape(4, -1)
    missing = corners < 0
    full = corners[:, ~missing.any(axis=0)]
    parts = [full[[0, 1, 2]], full[[0, 2, 3]]]
    for lost in range(4):
        parts.append(np.delete(corners, lost, axis=0)[:, missing[lost] & (missing.sum(axis=0) == 1)])
    return np.concatenate(parts, axis=1).T


def _line(fit: Fit, index: int, touched_m: np.ndarray, members: np.ndarray) -> _Piece:
    """A curve on an even grid, not across gaps; touches (N,) that do not spread along it are one point."""
    patch, over = fit.patches[index], np.sort(touched_m)
    extent = float(over[-1] - over[0])
    own = patch.frame[0] @ fit.touches.own_m2[members] @ patch.frame[0]
    places, lines = np.array([float(np.mean(over))]), np.empty((0, 2), int)
    if len(over) > 1 and extent > 4 * float(np.sqrt(np.nanmedian(own))):
        places = np.linspace(over[0], over[-1], _CELLS + 1)
        gap = max(LINK_FACTOR * float(np.percentile(np.diff(over), 90)), _LINE_GAP * extent)
        places = places[np.abs(places[:, None] - over[None]).min(axis=1) <= gap / 2]
        steps = np.arange(len(places) - 1)
        lines = np.stack([steps, steps + 1], axis=1)[np.diff(places) < 1.5 * extent / _CELLS]
    points, covariance = fit.along_curve(index, places)
    # an edge has no one normal: the middle one of those that were felt nearby
    near = np.abs(places[:, None] - touched_m[None])
    near = np.exp(-0.5 * ((near - near.min(axis=1, keepdims=True)) / max(_NEARBY * extent, 1e-6)) ** 2)
    normals = near @ fit.normals.normal[members]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    local = normals @ patch.frame.T
    sides = local[:, 1:], across_curve(local, 1e-9)[1]
    std, std_across = (deviations_along(side, covariance) for side in sides)
    # to second order: beside where it was touched, the object bends away from under the line
    std = np.hypot(std, np.sqrt(0.75) * UNSEEN_BEND_PER_M * std_across**2)
    if len(fit.patches) > len(places) == 1 and max(std[0], std_across[0]) > _LONE_SHOWN_M:
        return _piece(points[:0], normals[:0], std[:0], std_across[:0])
    return _piece(points, normals, std, std_across, lines=lines)
