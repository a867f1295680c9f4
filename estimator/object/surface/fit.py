"""Touches to a solved shape: shapes, surface points, normals and compliance by turns, until they agree."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .equations import IGNORED, LocalTouches, Patch, curve, height_field
from .kernel import Prior
from .normals import Normals, estimate_normals
from .patches import facing, group, tangent_frame
from .solution import PatchModel, Solution, learn_prior, solve
from .touches import Touches

_ROUNDS, _LEARNING, _MOST_ROUNDS = 3, 2, 15  # turns at least, those in which smoothness is learned anew, turns at most
# in deviations: a compliance that moves by less than the second is done; one that still moves by more than the first
# after all turns has not converged
CONVERGED, _STILL = 0.1, 1e-3
# a touch this many deviations off what the others predict is left out, as long as all of them are no more than this
# part: otherwise the covariances are at fault
_TOO_FAR, _MOST_LEFT_OUT = 5.0, 0.1
# a touch that is known along the surface worse than both this, and so many times worse than most, is not used
_VAGUE_M, _VAGUE_FACTOR = 1e-3, 3.0
_STEEPEST, _SHARPEST_M = 3.0, 3e-4  # on the way no larger slope is believed, nor a bend with a smaller radius


@dataclass(frozen=True, eq=False)
class _FitState:
    """Where the turns have come to: normals (P, 3), the compliance in the points, slopes and bends as `LocalTouches`',
    each patch's prior and slack, and the factor on each touch's own covariance; `vague` touches are not used."""

    normal: np.ndarray
    compliance_m_N: float
    slope: np.ndarray
    bend_per_m: np.ndarray
    priors: tuple[tuple[Prior, float] | None, ...]
    widened: np.ndarray
    vague: np.ndarray

    @property
    def outlier(self) -> np.ndarray:
        """(P,) touches that lie too far off what the others say."""
        return (self.widened >= IGNORED) & ~self.vague


@dataclass(frozen=True, eq=False)
class Fit:
    """The object's patches, their joint solution, the points (P, 3) taken for the surface's in it, and the normals."""

    touches: Touches
    patches: tuple[Patch, ...]
    solution: Solution
    state: _FitState
    point_m: np.ndarray
    normals: Normals

    def local(self, patch: Patch) -> np.ndarray:
        """(N, 3) a patch's points in its frame."""
        return (self.point_m[patch.members] - patch.center_m) @ patch.frame.T

    def heights(self, index: int, flat_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points and normals (V, 3) of a wide patch over places (V, 2), world, and deviations (V,) along these."""
        patch, solution = self.patches[index], self.solution
        height, std = (ask(index, patch.value_rows(flat_m)) for ask in (solution.mean, solution.spread))
        slope = solution.mean(index, patch.slope_rows(flat_m)).reshape(2, len(flat_m)).T
        raw = np.column_stack([-slope, np.ones(len(slope))])
        length = np.linalg.norm(raw, axis=1)
        points = patch.center_m + np.column_stack([flat_m, height]) @ patch.frame
        return points, (raw / length[:, None]) @ patch.frame, std / length

    def along_curve(self, index: int, over_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (V, 3) of a curve over places (V,), world, and covariances (V, 2, 2) across it in its frame."""
        patch = self.patches[index]
        rows = patch.value_rows(over_m[:, None])
        across, joint = self.solution.mean(index, rows).reshape(2, -1), self.solution.joint([(index, rows)])
        pair = np.arange(len(over_m))[:, None] + [0, len(over_m)]
        points = patch.center_m + np.column_stack([over_m, *across]) @ patch.frame
        return points, joint[pair[:, :, None], pair[:, None, :]]


def begin(touches: Touches, antenna_radius_m: float) -> tuple[tuple[Patch, ...], _FitState]:
    """The patches, and where to begin: slopes from the forces' directions, a rigid object, nothing left out."""
    count, normal = len(touches), facing(touches.force_N, touches.tangent, touches.point_m)
    points = touches.point_m - antenna_radius_m * normal
    vague, slope, patches = _poorly_located(touches, normal), np.zeros((count, 2)), []
    for members in group(points, normal):
        clear = members[~vague[members]] if not vague[members].all() else members
        patch = Patch(members, *tangent_frame(points[clear], normal[clear], touches.own_m2[clear]))
        patches.append(patch)
        if patch.wide:
            along, across, up = (normal[members] @ patch.frame.T).T
            slope[members] = np.clip(-np.stack([along, across], axis=1) / np.maximum(up, 0.3)[:, None], -2, 2)
    nothing = (None,) * len(patches)
    widened = np.where(vague, IGNORED, 1.0)
    return tuple(patches), _FitState(normal, 0.0, slope, np.zeros((count, 2, 2)), nothing, widened, vague)


def _poorly_located(touches: Touches, normal: np.ndarray) -> np.ndarray:
    """(P,) whose place along the surface is so uncertain that the shape between there and here is anyone's guess."""
    whole = np.trace(touches.own_m2, axis1=1, axis2=2)
    across = np.einsum("pi,pij,pj->p", normal, touches.own_m2, normal)
    along = np.sqrt(np.maximum(whole - across, 0.0))
    return along > max(_VAGUE_FACTOR * float(np.median(along)), _VAGUE_M)


def fit(touches: Touches, antenna_radius_m: float, patches: tuple[Patch, ...], state: _FitState, yielding: bool) -> Fit:
    """Turns from a state on; `yielding`: with a compliance."""
    if not yielding:
        state = replace(state, compliance_m_N=0.0)
    for turn in range(_MOST_ROUNDS):
        points, seen = _surface_points(touches, antenna_radius_m, patches, state)
        fitted, priors = [], []
        for patch, given, prior in zip(patches, seen, state.priors, strict=True):
            stated = height_field(given) if patch.wide else curve(given)
            if prior is None or turn < _LEARNING:
                extent = float(np.linalg.norm(np.ptp(given.point_m[:, : patch.dimensions], axis=0)))
                largest = extent / max(float(np.abs(stated.force_N).max()), 1e-12)
                prior = learn_prior(stated, extent, prior, largest if yielding else 0.0)
            priors.append(prior)
            fitted.append(PatchModel(stated, *prior))
        solution = solve(tuple(fitted), yielding)
        normals = estimate_normals(touches, patches, solution, seen)
        before = state.widened
        state = replace(
            _next_shape(patches, seen, solution, state),
            normal=normals.best(touches),
            priors=tuple(priors),
            widened=_widened(patches, solution, state) if 0 < turn < _MOST_ROUNDS - 1 else before,
        )
        same = (before == state.widened).all()  # what is left out now was left out of the solution
        if turn >= _ROUNDS - 1 and same and abs(solution.compliance_m_N) <= _STILL * np.sqrt(solution.variance):
            break
    normals = estimate_normals(touches, patches, solution, seen, common=True)
    return Fit(touches, patches, solution, state, points, normals)


def _surface_points(
    touches: Touches, antenna_radius_m: float, patches: tuple[Patch, ...], state: _FitState
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
            ignored=state.widened[m] >= IGNORED,
        )
        seen.append(local)
    return points, seen


def _next_shape(
    patches: tuple[Patch, ...], seen: list[LocalTouches], solution: Solution, state: _FitState
) -> _FitState:
    """What a solve says of slopes, bends and compliance."""
    slope, bend = state.slope.copy(), state.bend_per_m.copy()
    for index, (patch, given) in enumerate(zip(patches, seen, strict=True)):
        m, x = patch.members, given.point_m[:, : patch.dimensions]
        at = solution.mean(index, patch.slope_rows(x)).reshape(2, len(m)).T
        slope[m] = np.clip(at, -_STEEPEST, _STEEPEST)
        step = 0.05 * solution.patches[index].prior.length_m
        for axis in range(patch.dimensions):
            beside = solution.mean(index, patch.slope_rows(x + step * np.eye(patch.dimensions)[axis]))
            bend[m, :, axis] = np.clip((beside.reshape(2, len(m)).T - at) / step, -1 / _SHARPEST_M, 1 / _SHARPEST_M)
        if patch.wide:
            bend[m] = (bend[m] + np.swapaxes(bend[m], 1, 2)) / 2
    compliance = state.compliance_m_N + solution.compliance_m_N
    return replace(state, slope=slope, bend_per_m=bend, compliance_m_N=compliance)


def _widened(patches: tuple[Patch, ...], solution: Solution, state: _FitState) -> np.ndarray:
    """(P,) the factors on the touches' covariances, after those that do not belong were found."""
    far, residual = np.zeros(len(state.widened)), np.abs(solution.leave_one_out_residuals)
    for patch, start in zip(patches, solution.start, strict=True):
        sides = 1 if patch.wide else 2  # of a curve both its coordinates count
        count = len(patch.members)
        far[patch.members] = residual[start : start + sides * count].reshape(sides, count).max(axis=0)
    wrong = (far > _TOO_FAR) | state.outlier
    few = wrong.any() and np.sum(wrong) <= _MOST_LEFT_OUT * len(far)
    return np.where(wrong, IGNORED, state.widened) if few else state.widened
