"""Patches: connected contacts with similar normals; and the equations of a patch's touches for its shape,
linearised: y = views of the shape + compliance + errors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from estimator.object.surface.settings import SurfaceSettings
from estimator.object.surface.solution import Functionals, ShapeEquations, values_at
from vbaa_calib.geometry.covariance import variance_along


def facing(force_N: np.ndarray, tangent: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """(P, 3) unit vectors roughly out of the object: the forces' components across the antenna (the forces
    themselves where its tangent is NaN), averaged over neighbours, which cancels friction of strokes in both
    directions."""
    along = np.where(np.isfinite(tangent), tangent, 0.0)
    across = force_N - np.sum(force_N * along, axis=1, keepdims=True) * along
    size, whole = np.linalg.norm(across, axis=1, keepdims=True), np.linalg.norm(force_N, axis=1, keepdims=True)
    single = np.where(size > 0.1 * whole, across / np.maximum(size, 1e-300), force_N / whole)
    near = np.argsort(_distances(points_m), axis=1, kind="stable")[:, : SurfaceSettings.neighbours]
    alike = np.einsum("ni,nki->nk", single, single[near]) > np.cos(SurfaceSettings.alike_rad)
    mean = np.einsum("nk,nki->ni", alike.astype(float), single[near])
    return mean / np.linalg.norm(mean, axis=1, keepdims=True)


def group(points_m: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Indices of connected points (P, 3) with similar normals (P, 3), for each group."""
    alike = normals @ normals.T > np.cos(SurfaceSettings.link_normals_rad)
    order, gaps_m = nearest_first(np.where(alike, _distances(points_m), np.inf))
    gap_m = bridged_gap(gaps_m[np.isfinite(gaps_m)], float(np.linalg.norm(np.ptp(points_m, axis=0))))
    joined = [np.sort(part) for part in np.split(order, np.flatnonzero(gaps_m > gap_m) + 1)]
    return [part for members in sorted(joined, key=lambda each: each[0]) for part in _facing_alike(members, normals)]


def _distances(points_m: np.ndarray) -> np.ndarray:
    """(P, P) m, of points (P, 3) from each other."""
    return np.linalg.norm(points_m[:, None] - points_m, axis=-1)


def nearest_first(distance_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order (P,) of points in which each is the nearest to those before it, and the gaps (P − 1,) between: the lengths
    of the edges of the minimum spanning tree (Prim's method; infinite where no edge leads on). Points that gaps of up
    to some width connect follow one another. distance_m : (P, P), infinite without an edge."""
    order, gaps_m, away_m = [0], [], distance_m[0].copy()
    unordered = np.ones(len(distance_m), bool)
    unordered[0] = False
    while len(order) < len(unordered):
        rest = np.flatnonzero(unordered)
        nearest = rest[np.argmin(away_m[rest])]
        order.append(nearest)
        gaps_m.append(away_m[nearest])
        unordered[nearest] = False
        np.minimum(away_m, distance_m[nearest], out=away_m)
    return np.array(order), np.array(gaps_m)


def bridged_gap(gaps_m: np.ndarray, extent_m: float) -> float:
    """The widest gap that is bridged, from the finite gaps of `nearest_first` and the points' extent."""
    usual = float(np.percentile(gaps_m, 90)) if len(gaps_m) else 0.0
    return max(SurfaceSettings.link_factor * usual, SurfaceSettings.link_extent * extent_m)


def _facing_alike(members: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Split groups until no normal deviates too far from its patch's mean."""
    mean = normals[members].sum(axis=0)
    cosine = normals[members] @ mean / max(np.linalg.norm(mean), 1e-12)
    if len(members) < 2 or cosine.min() > np.cos(SurfaceSettings.patch_normals_rad):
        return [members]
    first = normals[members[np.argmin(cosine)]]
    second = normals[members[np.argmin(normals[members] @ first)]]
    from scipy.cluster.vq import kmeans2  # slow to load

    _, half = kmeans2(normals[members], np.stack([first, second]), minit="matrix")
    if half.min() == half.max():
        return [members]
    return [part for side in (0, 1) for part in _facing_alike(members[half == side], normals)]


@dataclass(frozen=True, eq=False)
class Patch:
    """Connected touches, as a height field or a curve."""

    members: np.ndarray  # (N,) indices
    center_m: np.ndarray  # (3,)
    frame: np.ndarray  # (3, 3) rows along, across, up
    wide: bool  # a height field over along and across; any other is a curve over along

    @property
    def dimensions(self) -> int:
        """Number of coordinates of which the shape is a function."""
        return 2 if self.wide else 1

    def slope_rows(self, x: np.ndarray) -> Functionals:
        """Functionals of the slopes at places (N, D): ∂h/∂u of all, then ∂h/∂v; for a curve dv/du, then dh/du."""
        sides = np.eye(2)[:, None] if self.wide else np.eye(2)[:, :, None]
        return Functionals.joined([_slopes_at(x, side) for side in sides])

    def value_rows(self, x: np.ndarray) -> Functionals:
        """Functionals of the shape's values at places: heights over (N, 2), or v and then h of a curve over (N, 1)."""
        return Functionals.joined([values_at(x, side) for side in (np.ones((1, 1)) if self.wide else np.eye(2))])


@dataclass(frozen=True, eq=False)
class LocalTouches:
    """The N touches of a patch at the present state, in the patch's frame."""

    point_m: np.ndarray  # (N, 3) on the object
    tangent: np.ndarray  # (N, 3)
    own_m2: np.ndarray  # (N, 3, 3) covariance of a point's own error
    modes_m: np.ndarray  # (N, 3, S) effect of common errors
    tangent_modes: np.ndarray  # (N, 3, S)
    yield_N: np.ndarray  # (N, 3) how the point moves with the compliance: the normal force along −normal
    slope: np.ndarray  # (N, 2) as `Patch.slope_rows`
    bend_per_m: np.ndarray  # (N, 2, 2) how it changes over the coordinates
    normal: np.ndarray  # (N, 3)
    ignored: np.ndarray  # (N,) touches, with their tangents, that are not used


def height_field(seen: LocalTouches) -> ShapeEquations:
    """Equations of heights over (u, v), and of the antenna's tangent t lying in the surface: ∇h · t_uv = t_h. Only
    the component of a point's error across the surface is an error of height; along it, the tangent is compared with
    another slope."""
    count, directed = len(seen.point_m), np.flatnonzero(np.isfinite(seen.tangent).all(axis=1))
    up = np.column_stack([-seen.slope, np.ones(count)])
    tangent, tilt = seen.tangent[directed], up[directed]
    # to second order: an error along a surface that bends takes a point off it
    bent = seen.bend_per_m @ seen.own_m2[:, :2, :2]
    off = np.clip(0.5 * np.trace(bent, axis1=1, axis2=2), -SurfaceSettings.most_off_m, SurfaceSettings.most_off_m)
    scales = [
        0.5 * np.trace(bent @ bent, axis1=1, axis2=2),
        np.where(seen.ignored[directed], SurfaceSettings.unbelieved_rad**2, 0.0),
    ]
    turn = np.zeros((len(directed), 3))
    turn[:, :2] = -np.einsum("ni,nij->nj", tangent[:, :2], seen.bend_per_m[directed])
    tangents_own = _project(tilt, seen.tangent_modes[directed])
    points, slopes = seen.point_m[:, :2], _slopes_at(seen.point_m[directed, :2], tangent[:, None, :2])
    noise = _noise(
        [up, turn],
        [np.arange(count), directed],
        seen.own_m2,
        [SurfaceSettings.least_std_m, SurfaceSettings.least_std_rad],
    )
    return ShapeEquations(
        rows=Functionals.joined([values_at(points, np.ones(1)), slopes]),
        y=np.concatenate([seen.point_m[:, 2] + off, tangent[:, 2]]),
        noise=noise + np.diag(np.concatenate(scales)),
        modes=np.concatenate([_project(up, seen.modes_m), _project(turn, seen.modes_m[directed]) + tangents_own]),
        force_N=np.concatenate([np.sum(up * seen.yield_N, axis=1), np.sum(turn * seen.yield_N[directed], axis=1)]),
        slack=np.concatenate([np.zeros(count), np.linalg.norm(tilt, axis=1)]),
    )


def curve(seen: LocalTouches) -> ShapeEquations:
    """Equations of the coordinates (v, h) across the curve over u, each a function of its own, along the normal and
    across it.

    The antenna touches a round body next to the curve, so that what is seen along the surface must say nothing of the
    errors across it. Two more common errors: how the object bends across the curve is not seen, but takes points with
    an error along the antenna off it; and if it is round, the normal turns as the contact rolls over it.
    """
    count = len(seen.point_m)
    outward, scales = across_curve(seen.normal)
    sides = [np.column_stack([-np.sum(each * seen.slope, axis=1), each]) for each in (outward, scales)]
    along = _project(sides[1], seen.modes_m)
    tangent = np.where(np.isfinite(seen.tangent), seen.tangent, 0.0)
    off = 0.5 * SurfaceSettings.unseen_bend_per_m * variance_along(seen.own_m2, tangent)
    off = np.minimum(off, SurfaceSettings.most_off_m)
    angle, over = np.arctan2(outward[:, 0], outward[:, 1]), seen.point_m[:, :1]
    line = np.column_stack([np.ones(count), over])
    turned = angle - line @ np.linalg.lstsq(line, angle, rcond=None)[0]
    rolled = SurfaceSettings.round_m * np.concatenate([1.0 - np.cos(turned), -np.sin(turned)])
    noises = [_noise([side], [np.arange(count)], seen.own_m2, [SurfaceSettings.least_std_m]) for side in sides]
    across = noises[0] + np.outer(off, off) + np.diag(2.0 * off**2)
    apart = np.zeros((count, count))
    return ShapeEquations(
        rows=Functionals.joined([values_at(over, outward), values_at(over, scales)]),
        y=np.concatenate([np.sum(each * seen.point_m[:, 1:], axis=1) for each in (outward, scales)]),
        noise=np.block([[across, apart], [apart, noises[1] + along @ along.T]]) + np.outer(rolled, rolled),
        modes=np.concatenate([_project(sides[0], seen.modes_m), np.zeros(along.shape)]),
        force_N=np.concatenate([np.sum(sides[0] * seen.yield_N, axis=1), np.zeros(count)]),
        slack=np.concatenate([np.zeros(count), np.full(count, SurfaceSettings.slack_m)]),
    )


def across_curve(normal: np.ndarray, least: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Directions (N, 2) each, across a curve in its patch's frame: along normals (N, 3), and perpendicular to them."""
    outward = normal[:, 1:] / np.maximum(np.linalg.norm(normal[:, 1:], axis=1, keepdims=True), least)
    return outward, np.column_stack([-outward[:, 1], outward[:, 0]])


def _project(side: np.ndarray, modes: np.ndarray) -> np.ndarray:
    return np.einsum("ni,nis->ns", side, modes)


def _noise(sides: list[np.ndarray], owners: list[np.ndarray], own_m2: np.ndarray, least: list[float]) -> np.ndarray:
    """(M, M) covariance along sides (N, 3) of their owners' errors; errors of different touches are independent."""
    starts = np.cumsum([0, *map(len, owners)])
    result = np.diag(np.repeat(np.square(least), np.diff(starts)))
    for a, b in combinations_with_replacement(range(len(sides)), 2):
        both, here, there = np.intersect1d(owners[a], owners[b], return_indices=True)
        own = np.einsum("ni,nij,nj->n", sides[a][here], own_m2[both], sides[b][there])
        result[starts[a] + here, starts[b] + there] += own
        if a != b:
            result[starts[b] + there, starts[a] + here] += own
    return result


def _slopes_at(x: np.ndarray, slope: np.ndarray) -> Functionals:
    """Sums of the functions' slopes at places (N, D) along directions (N, C, D), which need not have length 1."""
    slope = np.ascontiguousarray(np.broadcast_to(slope, (len(x), *np.shape(slope)[-2:])))
    return Functionals(np.ascontiguousarray(x), np.zeros(slope.shape[:2]), slope)
