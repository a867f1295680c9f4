"""Fits the shape to the touches: shapes, surface points, normals and compliance in alternation until they converge.

The normals come from the shape and from the antenna's tangents: n ⟂ shape, n ⟂ tangent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.object.surface.patches import LocalTouches, Patch, curve, facing, group, height_field
from estimator.object.surface.settings import SurfaceSettings
from estimator.object.surface.solution import ShapeSolution, SmoothnessPrior, learn_prior, solve
from estimator.object.surface.touches import Touches
from vbaa_calib.geometry.covariance import largest_std, variance_along

_Turned = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Normals (N, 3) of a patch's touches in its frame, (N, 3, 2) how slopes turn them, own covariance (N, 3, 3)."""


@dataclass(frozen=True, eq=False)
class _FitState:
    """State of the alternation between shapes, surface points, normals and compliance."""

    normal: np.ndarray  # (P, 3)
    compliance_m_N: float  # in the points
    slope: np.ndarray  # (P, 2) as `LocalTouches`'
    bend_per_m: np.ndarray  # (P, 2, 2)
    priors: tuple[SmoothnessPrior | None, ...]  # each patch's
    widened: np.ndarray  # (P,) factor on each touch's own covariance
    vague: np.ndarray  # (P,) touches that are not used

    @property
    def outlier(self) -> np.ndarray:
        """(P,) mask of the touches that contradict the others."""
        return (self.widened >= SurfaceSettings.ignored) & ~self.vague


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """The object's patches, their joint solution, and the normals."""

    touches: Touches
    patches: tuple[Patch, ...]
    solution: ShapeSolution
    state: _FitState
    point_m: np.ndarray  # (P, 3) taken for the surface's
    seen: list[LocalTouches]  # of each patch
    normals: Normals

    def local(self, patch: Patch) -> np.ndarray:
        """(N, 3) a patch's points in its frame."""
        return (self.point_m[patch.members] - patch.center_m) @ patch.frame.T

    def heights(self, index: int, flat_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points and normals (V, 3) of an area patch at places (V, 2), world frame, and standard deviations (V,)
        along the normals."""
        patch, solution = self.patches[index], self.solution
        height, std = (ask(index, patch.value_rows(flat_m)) for ask in (solution.mean, solution.spread))
        slope = solution.mean(index, patch.slope_rows(flat_m)).reshape(2, len(flat_m)).T
        raw = np.column_stack([-slope, np.ones(len(slope))])
        length = np.linalg.norm(raw, axis=1)
        points = patch.center_m + np.column_stack([flat_m, height]) @ patch.frame
        return points, (raw / length[:, None]) @ patch.frame, std / length

    def std_along(self, index: int, local_m: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(N,) standard deviations of a patch's surface under places (N, 3) in its frame, along normals (N, 3),
        world frame."""
        patch = self.patches[index]
        if patch.wide:
            return self.heights(index, local_m[:, :2])[2]
        side = (normal @ patch.frame.T)[:, 1:]
        return np.sqrt(np.maximum(variance_along(self.along_curve(index, local_m[:, 0])[1], side), 0.0))

    def along_curve(self, index: int, over_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (V, 3) of a curve over places (V,), world, and covariances (V, 2, 2) across it in its frame."""
        patch = self.patches[index]
        rows = patch.value_rows(over_m[:, None])
        across, covariance = self.solution.in_place(index, rows)
        points = patch.center_m + np.column_stack([over_m, *across.reshape(2, -1)]) @ patch.frame
        return points, covariance

    def normals_with_common_errors(self) -> Normals:
        """The normals with the part of their errors that the touches share."""
        return _estimate_normals(self.touches, self.patches, self.solution, self.seen, common=True)[0]


def begin(touches: Touches, antenna_radius_m: np.ndarray | float) -> tuple[tuple[Patch, ...], _FitState]:
    """The patches, and the initial state: slopes from the forces' directions, a rigid object, no outliers."""
    count, normal = len(touches), facing(touches.force_N, touches.tangent, touches.point_m)
    points = touches.point_m - np.broadcast_to(antenna_radius_m, count)[:, None] * normal
    across = variance_along(touches.own_m2, normal)
    along = np.sqrt(np.maximum(np.trace(touches.own_m2, axis1=1, axis2=2) - across, 0.0))
    # so uncertain in place that the shape between there and here is anyone's guess
    vague = along > max(SurfaceSettings.vague_factor * float(np.median(along)), SurfaceSettings.vague_m)
    slope, patches = np.zeros((count, 2)), []
    for members in group(points, normal):
        clear = members[~vague[members]] if not vague[members].all() else members
        patch = Patch(members, *_tangent_frame(points[clear], normal[clear], touches.own_m2[clear]))
        patches.append(patch)
        if patch.wide:
            local = normal[members] @ patch.frame.T
            slope[members] = np.clip(-local[:, :2] / np.maximum(local[:, 2:], 0.3), -2, 2)
    nothing = (None,) * len(patches)
    widened = np.where(vague, SurfaceSettings.ignored, 1.0)
    return tuple(patches), _FitState(normal, 0.0, slope, np.zeros((count, 2, 2)), nothing, widened, vague)


def fit(
    touches: Touches, antenna_radius_m: np.ndarray | float, patches: tuple[Patch, ...], state: _FitState, yielding: bool
) -> SurfaceFit:
    """Alternates from a state until the compliance converges or clearly does not. yielding : whether with one."""
    if not yielding:
        state = replace(state, compliance_m_N=0.0)
    least, unchanged = np.inf, 0  # step of the compliance; rounds with the same touches
    for turn in range(SurfaceSettings.most_rounds):
        points, seen = _surface_points(touches, antenna_radius_m, patches, state)
        equations, priors = [], []
        for patch, local, prior in zip(patches, seen, state.priors, strict=True):
            stated = height_field(local) if patch.wide else curve(local)
            if prior is None or turn < SurfaceSettings.learning_rounds:
                extent = float(np.linalg.norm(np.ptp(local.point_m[:, : patch.dimensions], axis=0)))
                largest = extent / max(float(np.abs(stated.force_N).max()), 1e-12)
                roughly = turn < SurfaceSettings.learning_rounds - 1  # the shape is far off yet
                prior = learn_prior(stated, extent, prior, largest if yielding else 0.0, roughly)
            priors.append(prior)
            equations.append(stated)
        solution = solve(tuple(equations), tuple(priors), yielding)
        normals, slope = _estimate_normals(touches, patches, solution, seen)
        before = widened = state.widened
        if 0 < turn < SurfaceSettings.most_rounds - 1:  # those that do not belong
            far, residual = np.zeros(len(before)), np.abs(solution.leave_one_out_residuals)
            for patch, start in zip(patches, solution.start, strict=True):
                sides, count = 1 if patch.wide else 2, len(patch.members)  # of a curve both its coordinates count
                far[patch.members] = residual[start : start + sides * count].reshape(sides, count).max(axis=0)
            wrong = (far > SurfaceSettings.outlier_std) | state.outlier
            few = wrong.any() and np.sum(wrong) <= SurfaceSettings.most_outliers * len(far)
            widened = np.where(wrong, SurfaceSettings.ignored, before) if few else before
        state = replace(
            _next_shape(patches, seen, solution, slope, state),
            normal=normals.best(touches),
            priors=tuple(priors),
            widened=widened,
        )
        # what is left out now was left out of the solution
        unchanged = unchanged + 1 if (before == state.widened).all() else 0
        step, std = abs(solution.compliance_m_N), np.sqrt(solution.variance)
        if turn >= SurfaceSettings.fewest_rounds - 1:
            grows = step > max(SurfaceSettings.growing * least, SurfaceSettings.not_converged_std * std)
            if (unchanged and step <= SurfaceSettings.converged_std * std) or (unchanged > 1 and grows):
                break
            least = min(least, step)
    return SurfaceFit(touches, patches, solution, state, points, seen, normals)


def _surface_points(
    touches: Touches, antenna_radius_m: np.ndarray | float, patches: tuple[Patch, ...], state: _FitState
) -> tuple[np.ndarray, list[LocalTouches]]:
    """(P, 3) points of the unpressed surface, world, and the touches of each patch in its frame."""
    normal, compliance = state.normal, state.compliance_m_N
    press = np.sum(touches.force_N * normal, axis=1)
    points = touches.point_m + (compliance * press - antenna_radius_m)[:, None] * normal
    own = touches.own_m2 * state.widened[:, None, None]
    # the picture sees force · distance² best: an error of the distance brings one of the force with it
    tangent = np.where(np.isfinite(touches.tangent), touches.tangent, 0.0)
    share = np.where(touches.distance_m > 0, 2 * compliance * press / np.maximum(touches.distance_m, 1e-6), 0.0)
    lever = np.eye(3) - share[:, None, None] * normal[:, :, None] * tangent[:, None, :]
    own = lever @ own @ np.swapaxes(lever, 1, 2)
    pressed = np.einsum("pi,pis->ps", normal, touches.force_modes_N)
    modes = touches.modes_m + compliance * normal[:, :, None] * pressed[:, None, :]
    seen = []
    for patch in patches:
        m, frame = patch.members, patch.frame
        local = LocalTouches(
            point_m=(points[m] - patch.center_m) @ frame.T,
            tangent=touches.tangent[m] @ frame.T,
            own_m2=frame @ own[m] @ frame.T,
            modes_m=frame @ modes[m],
            tangent_modes=frame @ touches.tangent_modes[m],
            yield_N=-press[m, None] * normal[m] @ frame.T,
            slope=state.slope[m],
            bend_per_m=state.bend_per_m[m],
            normal=normal[m] @ frame.T,
            ignored=state.widened[m] >= SurfaceSettings.ignored,
        )
        seen.append(local)
    return points, seen


def _next_shape(
    patches: tuple[Patch, ...], seen: list[LocalTouches], solution: ShapeSolution, slope: np.ndarray, state: _FitState
) -> _FitState:
    """Slopes, bounded, curvatures and compliance from a solution and its slopes (P, 2) at the touches."""
    bend = state.bend_per_m.copy()
    for index, (patch, local) in enumerate(zip(patches, seen, strict=True)):
        m, x = patch.members, local.point_m[:, : patch.dimensions]
        step = 0.05 * solution.priors[index].length_m
        for axis in range(patch.dimensions):
            shifted = solution.mean(index, patch.slope_rows(x + step * np.eye(patch.dimensions)[axis]))
            bend[m, :, axis] = np.clip(
                (shifted.reshape(2, len(m)).T - slope[m]) / step,
                -1 / SurfaceSettings.sharpest_m,
                1 / SurfaceSettings.sharpest_m,
            )
        if patch.wide:
            bend[m] = (bend[m] + np.swapaxes(bend[m], 1, 2)) / 2
    compliance = state.compliance_m_N + solution.compliance_m_N
    bounded = np.clip(slope, -SurfaceSettings.steepest, SurfaceSettings.steepest)
    return replace(state, slope=bounded, bend_per_m=bend, compliance_m_N=compliance)


@dataclass(frozen=True, eq=False)
class Normals:
    """Normals at P touches, world frame: unit, outward (P, 3); covariance (P, 3, 3), rad²; modes (P, 3, K), its
    shared part."""

    normal: np.ndarray
    covariance: np.ndarray
    modes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 0)))

    @property
    def std_rad(self) -> np.ndarray:
        """(P,) the larger of the standard deviations in the two directions in which a normal can turn."""
        return largest_std(self.covariance)

    def best(self, touches: Touches) -> np.ndarray:
        """(P, 3) normals, replaced by the force's direction where the shape is less certain than that."""
        force = touches.force_N / np.linalg.norm(touches.force_N, axis=1, keepdims=True)
        trust = 1.0 / (1.0 + (self.std_rad / SurfaceSettings.force_std_rad) ** 4)
        mixed = trust[:, None] * self.normal + (1 - trust)[:, None] * force
        return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)


def _estimate_normals(
    touches: Touches,
    patches: tuple[Patch, ...],
    solution: ShapeSolution,
    seen: list[LocalTouches],
    *,
    common: bool = False,
) -> tuple[Normals, np.ndarray]:
    """The normals, and the slopes (P, 2) of the shape there, as `Patch.slope_rows`. common : whether with the part of
    the normals' errors that the touches share."""
    count = len(touches)
    normal, own, by_slope = np.empty((count, 3)), np.empty((count, 3, 3)), np.zeros((count, 3, 2))
    slopes = np.empty((count, 2))
    views, in_place = [], np.empty((count, 2, 2))
    for index, (patch, local_touches) in enumerate(zip(patches, seen, strict=True)):
        m, size, frame = patch.members, len(patch.members), patch.frame
        # what is left out of the shape is known as well as it was: to where its normal belongs
        own_m2 = np.where(
            local_touches.ignored[:, None, None], local_touches.own_m2 / SurfaceSettings.ignored, local_touches.own_m2
        )
        local = replace(local_touches, own_m2=own_m2)
        rows = patch.slope_rows(local.point_m[:, : patch.dimensions])
        views.append((index, rows))
        if common:
            slope = solution.mean(index, rows)
        else:
            slope, in_place[m] = solution.in_place(index, rows)
        slopes[m] = slope = slope.reshape(2, size).T
        if patch.wide:
            found, turns, left = _of_field(local, slope, solution.priors[index].slack_rad)
        else:
            found, turns, left = _of_curve(local, slope, touches.force_N[m] @ frame.T)
        normal[m], by_slope[m], own[m] = found @ frame, frame.T[None] @ turns, frame.T @ left @ frame
    if common:
        sizes = [len(patch.members) for patch in patches]
        starts = np.cumsum([0, *(2 * size for size in sizes)])
        pair = np.empty((count, 2), int)
        for patch, start, size in zip(patches, starts, sizes, strict=False):
            pair[patch.members] = start + np.arange(size)[:, None] + [0, size]
        joint = solution.joint(views)
        in_place = joint[pair[:, :, None], pair[:, None, :]]
    shape = by_slope @ in_place @ np.swapaxes(by_slope, 1, 2)
    values, axes = np.linalg.eigh(shape + own)
    believed = np.minimum(1.0, SurfaceSettings.unknown_rad / np.sqrt(np.maximum(values, 1e-30)))
    # an unknown direction must not take the others along
    projection = (axes * believed[:, None]) @ np.swapaxes(axes, 1, 2)
    covariance = projection @ (shape + own) @ projection
    modes = np.zeros((count, 3, 0))
    if common:  # the largest principal parts of the joint covariance of the turns that the shape brings
        by_slope, kept = projection @ by_slope, min(SurfaceSettings.modes, 3 * count)
        ordered = joint[np.ix_(pair.ravel(), pair.ravel())]

        def turned(vectors: np.ndarray) -> np.ndarray:
            along = np.swapaxes(by_slope, 1, 2) @ vectors.reshape(count, 3, -1)
            moved = (ordered @ along.reshape(2 * count, -1)).reshape(count, 2, -1)
            return (by_slope @ moved).reshape(3 * count, -1)

        variance, axes = _largest(turned, 3 * count, kept)
        modes = (axes * np.sqrt(np.maximum(variance, 0.0))).reshape(count, 3, kept)
    return Normals(normal, covariance, modes), slopes


def _largest(times: Callable[[np.ndarray], np.ndarray], size: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The largest variances (K,) of an (N, N) covariance and their axes (N, K), from its products with vectors
    (N, K); for many touches by a block Krylov space."""
    if size < 10 * count:
        values, axes = np.linalg.eigh(times(np.eye(size)))
        return values[-count:], axes[:, -count:]
    block = basis = np.linalg.qr(np.random.default_rng(0).normal(size=(size, count)))[0]
    images = np.empty((size, 0))
    while True:
        images = np.hstack([images, times(block)])
        values, axes = (each[..., -count:] for each in np.linalg.eigh(basis.T @ images))
        wrong = np.linalg.norm(images @ axes - (basis @ axes) * values, axis=0)
        if wrong.max() <= SurfaceSettings.modes_end * values[-1] or basis.shape[1] + count > size:
            return values, basis @ axes
        block = images[:, -count:]
        for _ in range(2):  # the second time takes out what rounding left
            block = np.linalg.qr(block - basis @ (basis.T @ block))[0]
        basis = np.hstack([basis, block])


def _of_field(seen: LocalTouches, slope: np.ndarray, slack_rad: float) -> _Turned:
    """The height field's normals, made orthogonal to the antenna's tangent where that is known; the remaining
    rotation about the tangent has the variance of the slopes and of the touch's own error."""
    raw = np.column_stack([-slope, np.ones(len(slope))])
    length = np.linalg.norm(raw, axis=1)
    normal = raw / length[:, None]
    projection = np.isfinite(seen.tangent).all(axis=1)
    tangent = np.where(projection[:, None], seen.tangent, 0.0)
    normal = normal - np.sum(normal * tangent, axis=1, keepdims=True) * tangent
    size = np.linalg.norm(normal, axis=1)
    projection &= size > 0.2
    tangent = np.where(projection[:, None], tangent, 0.0)
    normal = np.where(projection[:, None], normal / np.maximum(size, 0.2)[:, None], raw / length[:, None])
    # turns across the normal, and across the tangent where there is one
    free = np.eye(3) - normal[:, :, None] * normal[:, None, :] - tangent[:, :, None] * tangent[:, None, :]
    by_slope = -free[:, :, :2] / length[:, None, None]
    moved = by_slope @ seen.bend_per_m
    own = moved @ seen.own_m2[:, :2, :2] @ np.swapaxes(moved, 1, 2)
    own = own + slack_rad**2 * by_slope @ np.swapaxes(by_slope, 1, 2)
    known = _tangent_variance(seen, normal)
    return normal, by_slope, own + known[:, None, None] * tangent[:, :, None] * tangent[:, None, :]


def _of_curve(seen: LocalTouches, slope: np.ndarray, force: np.ndarray) -> _Turned:
    """Normals orthogonal to the curve and the antenna's tangent; without a tangent orthogonal to the curve, towards
    the force."""
    along = np.column_stack([np.ones(len(slope)), slope])
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    projection = np.isfinite(seen.tangent).all(axis=1)
    tangent = np.where(projection[:, None], seen.tangent, 0.0)
    crossed = np.cross(along, tangent)
    sine = np.linalg.norm(crossed, axis=1)
    projection &= sine > 1e-3
    towards = force - np.sum(force * along, axis=1, keepdims=True) * along
    fallback = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    weak = np.linalg.norm(towards, axis=1) < 1e-3 * np.linalg.norm(force, axis=1)
    normal = np.where(projection[:, None], crossed, np.where(weak[:, None], fallback, towards))
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.where(np.sum(normal * force, axis=1, keepdims=True) < 0, -normal, normal)
    shifted = np.cross(normal, np.where(projection[:, None], tangent, along))
    sine = np.where(projection, np.sum(along * shifted, axis=1), 1.0)
    cosine = np.sum(along * tangent, axis=1)
    rise = -normal[:, 1:] / length[:, None]
    by_slope = np.where(projection[:, None], shifted / sine[:, None], along)[:, :, None] * rise[:, None, :]
    open_turn = np.where(
        projection[:, None], (cosine / sine)[:, None] * shifted - tangent, SurfaceSettings.unknown_rad * shifted
    )
    variance = np.where(projection, _tangent_variance(seen, normal), 1.0)
    own = variance[:, None, None] * open_turn[:, :, None] * open_turn[:, None, :]
    # a touch's own error along the curve takes it to where that has another direction
    turned = np.einsum("nij,nj->ni", by_slope, seen.bend_per_m[:, :, 0])
    moved = np.sqrt(np.maximum(seen.own_m2[:, :1, 0], 0.0)) * turned
    return normal, by_slope, own + moved[:, :, None] * moved[:, None, :]


def _tangent_variance(seen: LocalTouches, normal: np.ndarray) -> np.ndarray:
    """(N,) rad² variance of the tangent's rotation towards the normal."""
    common = np.einsum("ni,nis->ns", normal, seen.tangent_modes)
    return SurfaceSettings.tangent_std_rad**2 + np.sum(common**2, axis=1)


def _tangent_frame(
    points_m: np.ndarray, normals: np.ndarray, own_m2: np.ndarray
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Centre (3,) of a patch; (3, 3) rows: its long direction, its short one, its mean normal; whether it is an
    area. Points (N, 3) are weighted by their own covariances (N, 3, 3), which are subtracted."""
    up = normals.sum(axis=0)
    up = up / np.linalg.norm(up)
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first = first / np.linalg.norm(first)
    plane = np.stack([first, np.cross(up, first)])
    own = plane @ own_m2 @ plane.T
    variance = np.trace(own, axis1=1, axis2=2)
    weight = 1.0 / (variance + max(float(np.median(variance)), 1e-16))
    weight = weight / weight.sum()
    center = weight @ points_m
    flat = (points_m - center) @ plane.T
    spread, noise = np.einsum("n,ni,nj->ij", weight, flat, flat), np.einsum("n,nij->ij", weight, own)
    axes = np.linalg.eigh(spread - noise)[1].T[::-1]
    (length, width), scatter = np.einsum("ai,ij,aj->a", axes, spread, axes), float(axes[1] @ noise @ axes[1])
    wide = (
        width > max(SurfaceSettings.resolved**2 * scatter, SurfaceSettings.narrow**2 * length, 1e-18)
        and len(points_m) >= SurfaceSettings.fewest_touches
    )
    along = axes[0] @ plane
    return center, np.stack([along, np.cross(up, along), up]), bool(wide)
