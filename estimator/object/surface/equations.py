"""What the touches of one patch say of its shape, linearised: y = views of the shape + compliance + errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from .kernel import Functionals, concatenate, slopes_at, values_at

_LEAST_STD_M = 1e-7
"""Added to every deviation of a point, so that the equations can be solved where points are given as exact."""
_LEAST_STD_RAD = 3e-4
"""The same for the antenna's tangent."""
UNSEEN_BEND_PER_M = 50.0
"""Standard deviation of an object's curvature across a curve, before the data."""
_ROUND_M = 0.03
"""The same of its radius: how far an axis is off about which it may be round."""
IGNORED = 1e8
"""The covariance of a touch that is left out is taken as so many times as large."""
_MOST_OFF_M = 1e-3
"""What it takes a point off at most: contacts worse than that are left out anyway."""
_BESIDE_M = 0.05
"""What a slack of 1 rad is for a curve: how far touches lie beside it for other reasons than its shape; the path of the
contacts zigzags with the force, and is no function over its long direction."""
_UNBELIEVED_RAD = 10.0
"""Deviation of a tangent that is not to be believed."""


@dataclass(frozen=True, eq=False)
class Patch:
    """Touches that hang together.

    Attributes
    ----------
    members : (N,) indices of the touches. center_m : (3,). frame : (3, 3) rows along, across, up (world).
    wide : whether it is a height field over the plane through along and across; otherwise it is a curve over along.
    """

    members: np.ndarray
    center_m: np.ndarray
    frame: np.ndarray
    wide: bool

    @property
    def dimensions(self) -> int:
        """Of the coordinates over which the shape is a function."""
        return 2 if self.wide else 1


def slope_rows(patch: Patch, x: np.ndarray) -> Functionals:
    """Views of the slopes at places (N, D): of a field both, of a curve dv/du and dh/du; the first of all, then the
    second."""
    if patch.wide:
        return concatenate(slopes_at(x, np.array([[1.0, 0.0]])), slopes_at(x, np.array([[0.0, 1.0]])))
    return concatenate(slopes_at(x, np.array([[1.0], [0.0]])), slopes_at(x, np.array([[0.0], [1.0]])))


def value_rows(patch: Patch, x: np.ndarray) -> Functionals:
    """Views of the heights over (N, 2), or of v and then h of a curve over (N, 1)."""
    return (
        values_at(x, np.ones(1)) if patch.wide else concatenate(values_at(x, np.eye(2)[0]), values_at(x, np.eye(2)[1]))
    )


@dataclass(frozen=True, eq=False)
class LocalTouches:
    """The N touches of a patch as they are seen now: surface points and what moves them, in the patch's frame.

    Attributes
    ----------
    point_m : (N, 3) on the object. tangent : (N, 3) of the antenna, may be NaN.
    own_m2 : (N, 3, 3) covariance of a point's own error. modes_m, tangent_modes : (N, 3, S) effect of common errors.
    yield_N : (N, 3) how the point moves with the compliance: the normal force along −normal.
    slope : (N, 2) of the shape at the touch: ∇h of a field, (dv/du, dh/du) of a curve.
    bend_per_m : (N, 2, 2) how the slopes change over the coordinates; for a curve in the first column.
    normal : (N, 3) best guess. ignored : (N,) touches that are not to be believed, nor their tangents.
    """

    point_m: np.ndarray
    tangent: np.ndarray
    own_m2: np.ndarray
    modes_m: np.ndarray
    tangent_modes: np.ndarray
    yield_N: np.ndarray
    slope: np.ndarray
    bend_per_m: np.ndarray
    normal: np.ndarray
    ignored: np.ndarray


@dataclass(frozen=True, eq=False)
class Equations:
    """M linear equations; the first N, or twice N for a curve, are of the points, the others of tangents.

    Attributes
    ----------
    rows : what of the shape each sees. y : (M,) what was measured.
    noise : (M, M) covariance of the touches' own errors. modes : (M, S) effect of the common ones.
    force_N : (M,) effect of the compliance.
    slack : (M,) how an error of the tangent of 1 rad enters; zero for equations without tangent.
    """

    rows: Functionals
    y: np.ndarray
    noise: np.ndarray
    modes: np.ndarray
    force_N: np.ndarray
    slack: np.ndarray

    def __len__(self) -> int:
        return len(self.y)


def equations(seen: LocalTouches, wide: bool) -> Equations:
    """Of a height field if `wide`, else of a curve."""
    return _height_field(seen) if wide else _curve(seen)


def _height_field(seen: LocalTouches) -> Equations:
    """Heights over (u, v), and that the surface holds the antenna's tangent t: ∇h · t_uv = t_h.

    An error of a point along the surface moves it over ground that rises: only what is left across it counts as an
    error of height. The same error takes the tangent to where the surface has another slope.
    """
    count, held = len(seen.point_m), np.flatnonzero(np.isfinite(seen.tangent).all(axis=1))
    up = np.column_stack([-seen.slope, np.ones(count)])
    tangent, tilt = seen.tangent[held], up[held]
    # to second order: an error along a surface that bends takes a point off it
    bent = seen.bend_per_m @ seen.own_m2[:, :2, :2]
    off = np.clip(0.5 * np.trace(bent, axis1=1, axis2=2), -_MOST_OFF_M, _MOST_OFF_M)
    beside = [0.5 * np.trace(bent @ bent, axis1=1, axis2=2), np.where(seen.ignored[held], _UNBELIEVED_RAD**2, 0.0)]
    turn = np.zeros((len(held), 3))
    turn[:, :2] = -np.einsum("ni,nij->nj", tangent[:, :2], seen.bend_per_m[held])
    tangents_own = np.einsum("ni,nis->ns", tilt, seen.tangent_modes[held])
    return Equations(
        rows=concatenate(
            values_at(seen.point_m[:, :2], np.ones(1)), slopes_at(seen.point_m[held, :2], tangent[:, None, :2])
        ),
        y=np.concatenate([seen.point_m[:, 2] + off, tangent[:, 2]]),
        noise=_noise([up, turn], [np.arange(count), held], seen.own_m2, [_LEAST_STD_M, _LEAST_STD_RAD])
        + np.diag(np.concatenate(beside)),
        modes=np.concatenate([_project(up, seen.modes_m), _project(turn, seen.modes_m[held]) + tangents_own]),
        force_N=np.concatenate([np.sum(up * seen.yield_N, axis=1), np.sum(turn * seen.yield_N[held], axis=1)]),
        slack=np.concatenate([np.zeros(count), np.linalg.norm(tilt, axis=1)]),
    )


def _curve(seen: LocalTouches) -> Equations:
    """The coordinates (v, h) across the curve over u, each a function of its own: along the normal, and beside it.

    The antenna touches a round body now here, now there beside the curve. What is seen along the surface must therefore
    say nothing of the errors across it: errors of the two directions are taken as independent.
    How the object bends across the curve is not seen, but takes points with an error along the antenna off it, all to
    the same side; and if it is round, the normal turns as the contact rolls over it, at one distance from an axis
    instead of one point: two more common errors.
    """
    count = len(seen.point_m)
    outward = seen.normal[:, 1:] / np.maximum(np.linalg.norm(seen.normal[:, 1:], axis=1, keepdims=True), 0.1)
    beside = np.column_stack([-outward[:, 1], outward[:, 0]])
    sides = [np.column_stack([-np.sum(each * seen.slope, axis=1), each]) for each in (outward, beside)]
    along = _project(sides[1], seen.modes_m)
    tangent = np.where(np.isfinite(seen.tangent), seen.tangent, 0.0)
    off = 0.5 * UNSEEN_BEND_PER_M * np.einsum("ni,nij,nj->n", tangent, seen.own_m2, tangent)
    off = np.minimum(off, _MOST_OFF_M)
    angle = np.arctan2(outward[:, 0], outward[:, 1])
    over = seen.point_m[:, :1]
    line = np.column_stack([np.ones(count), over])
    turned = angle - line @ np.linalg.lstsq(line, angle, rcond=None)[0]
    rolled = _ROUND_M * np.concatenate([1.0 - np.cos(turned), -np.sin(turned)])
    every = np.arange(count)
    across = _noise(sides[:1], [every], seen.own_m2, [_LEAST_STD_M]) + np.outer(off, off) + np.diag(2.0 * off**2)
    noise = block_diag(across, _noise(sides[1:], [every], seen.own_m2, [_LEAST_STD_M]) + along @ along.T)
    return Equations(
        rows=concatenate(values_at(over, outward), values_at(over, beside)),
        y=np.concatenate([np.sum(each * seen.point_m[:, 1:], axis=1) for each in (outward, beside)]),
        noise=noise + np.outer(rolled, rolled),
        modes=np.concatenate([_project(sides[0], seen.modes_m), np.zeros(along.shape)]),
        force_N=np.concatenate([np.sum(sides[0] * seen.yield_N, axis=1), np.zeros(count)]),
        slack=np.concatenate([np.zeros(count), np.full(count, _BESIDE_M)]),
    )


def _project(side: np.ndarray, modes: np.ndarray) -> np.ndarray:
    return np.einsum("ni,nis->ns", side, modes)


def _noise(sides: list[np.ndarray], owners: list[np.ndarray], own_m2: np.ndarray, least: list[float]) -> np.ndarray:
    """(M, M) covariance of sides (N, 3) of the errors of their owners; errors of different touches are independent."""
    side, owner = np.concatenate(sides), np.concatenate(owners)
    result = np.einsum("ai,aij,bj->ab", side, own_m2[owner], side) * (owner[:, None] == owner[None])
    return result + np.diag(np.concatenate([np.full(len(o), std**2) for o, std in zip(owners, least, strict=True)]))
