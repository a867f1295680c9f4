"""Touches to a solved shape: shapes, surface points, normals and compliance by turns, until they agree."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .equations import IGNORED, LocalTouches, Patch, equations, slope_rows
from .kernel import Prior
from .normals import Normals, estimate_normals
from .patches import facing, group, tangent_frame
from .solution import PatchModel, Solution, learn_prior, leave_one_out_residuals, solve
from .touches import Touches

_ROUNDS, _LEARNING, _MOST_ROUNDS = 3, 2, 15
"""Turns of a fit at least, those in which smoothness is learned anew, and turns at most."""
SETTLED, _STILL = 0.1, 1e-3
"""In standard deviations: a compliance that moves by less than the second is done, one that still moves by more than
the first after all turns has not settled."""
_TOO_FAR = 5.0
"""A touch this many standard deviations off what the others predict is left out ..."""
_MOST_LEFT_OUT = 0.1
"""... as long as they are no more than this part of all: otherwise the covariances are at fault."""
_VAGUE_M, _VAGUE_FACTOR = 1e-3, 3.0
"""A touch that is known along the surface worse than both this, and so many times worse than most, is not used."""
_STEEPEST = 3.0
"""A slope that is larger is not believed on the way."""
_SHARPEST_M = 3e-4
"""A surface does not bend more sharply than with this radius, on the way."""


@dataclass(frozen=True, eq=False)
class FitState:
    """Where the turns have come to.

    Attributes
    ----------
    normal : (P, 3) best guess of the object's outward normals. compliance_m_N : taken into the surface points.
    slope : (P, 2). bend_per_m : (P, 2, 2). priors : of each patch, with the tangents' slack; None before the first.
    widened : (P,) factor on each touch's own covariance. vague : (P,) not used: hardly known along the surface.
    """

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
    state: FitState
    point_m: np.ndarray
    normals: Normals


def make_patches(touches: Touches, antenna_radius_m: float) -> tuple[tuple[Patch, ...], np.ndarray]:
    """The patches, and a first guess (P, 3) of the normals."""
    normal = facing(touches.force_N, touches.tangent, touches.point_m)
    points = touches.point_m - antenna_radius_m * normal
    label, vague = group(points, normal), _poorly_located(touches, normal)
    patches = []
    for index in range(label.max() + 1):
        members = np.flatnonzero(label == index)
        clear = members[~vague[members]] if not vague[members].all() else members
        center, frame, wide = tangent_frame(points[clear], normal[clear], touches.own_m2[clear])
        patches.append(Patch(members, center, frame, wide))
    return tuple(patches), normal


def _poorly_located(touches: Touches, normal: np.ndarray) -> np.ndarray:
    """(P,) whose place along the surface is so uncertain that the shape between there and here is anyone's guess."""
    whole = np.trace(touches.own_m2, axis1=1, axis2=2)
    across = np.einsum("pi,pij,pj->p", normal, touches.own_m2, normal)
    along = np.sqrt(np.maximum(whole - across, 0.0))
    return along > max(_VAGUE_FACTOR * float(np.median(along)), _VAGUE_M)


def first_state(touches: Touches, patches: tuple[Patch, ...], normal: np.ndarray) -> FitState:
    """Slopes from the forces' directions, a rigid object, nothing left out."""
    count = len(touches)
    slope = np.zeros((count, 2))
    for patch in patches:
        if patch.wide:
            along, across, up = (normal[patch.members] @ patch.frame.T).T
            slope[patch.members] = np.clip(-np.stack([along, across], axis=1) / np.maximum(up, 0.3)[:, None], -2, 2)
    vague = _poorly_located(touches, normal)
    widened = np.where(vague, IGNORED, 1.0)
    return FitState(normal, 0.0, slope, np.zeros((count, 2, 2)), (None,) * len(patches), widened, vague)


def fit(touches: Touches, antenna_radius_m: float, patches: tuple[Patch, ...], state: FitState, yielding: bool) -> Fit:
    """`_ROUNDS` turns from a state on; `yielding`: with a compliance."""
    if not yielding:
        state = replace(state, compliance_m_N=0.0)
    for turn in range(_MOST_ROUNDS):
        points, seen = _surface_points(touches, antenna_radius_m, patches, state)
        fitted, priors = [], []
        for patch, given, prior in zip(patches, seen, state.priors, strict=True):
            stated = equations(given, patch.wide)
            if prior is None or turn < _LEARNING:
                extent = float(np.linalg.norm(np.ptp(given.point_m[:, : patch.dimensions], axis=0)))
                largest = extent / max(float(np.abs(stated.force_N).max()), 1e-12)
                prior = learn_prior(stated, extent, prior, largest if yielding else 0.0)
            priors.append(prior)
            fitted.append(PatchModel(stated, *prior))
        solution = solve(tuple(fitted), yielding)
        normals = estimate_normals(touches, patches, solution, seen)
        widened, state = state.widened, replace(state, priors=tuple(priors))
        state = _next_state(patches, seen, solution, normals, state, touches, 0 < turn < _MOST_ROUNDS - 1)
        same = (widened == state.widened).all()  # what is left out now was left out of the solution
        if turn >= _ROUNDS - 1 and same and abs(solution.compliance_m_N) <= _STILL * np.sqrt(solution.variance):
            break
    normals = estimate_normals(touches, patches, solution, seen, common=True)
    return Fit(touches, patches, solution, state, points, normals)


def _surface_points(
    touches: Touches, antenna_radius_m: float, patches: tuple[Patch, ...], state: FitState
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
        seen.append(
            LocalTouches(
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
        )
    return points, seen


def _next_state(
    patches: tuple[Patch, ...],
    seen: list[LocalTouches],
    solution: Solution,
    normals: Normals,
    state: FitState,
    touches: Touches,
    judged: bool,
) -> FitState:
    """What a solve says of slopes, bends, normals and compliance; `judged`: and of touches that do not belong."""
    slope, bend, far = state.slope.copy(), state.bend_per_m.copy(), np.zeros(len(touches))
    residual = np.abs(leave_one_out_residuals(solution))
    for index, (patch, given) in enumerate(zip(patches, seen, strict=True)):
        m, count = patch.members, len(patch.members)
        x = given.point_m[:, : patch.dimensions]
        at = solution.mean(index, slope_rows(patch, x)).reshape(2, count).T
        slope[m] = np.clip(at, -_STEEPEST, _STEEPEST)
        step = 0.05 * solution.patches[index].prior.length_m
        for axis in range(patch.dimensions):
            beside = solution.mean(index, slope_rows(patch, x + step * np.eye(patch.dimensions)[axis]))
            changed = (beside.reshape(2, count).T - at) / step
            bend[m, :, axis] = np.clip(changed, -1 / _SHARPEST_M, 1 / _SHARPEST_M)
        if patch.wide:
            bend[m] = (bend[m] + np.swapaxes(bend[m], 1, 2)) / 2
        start = solution.start[index]
        far[m] = residual[start : start + count]
        if not patch.wide:
            far[m] = np.maximum(far[m], residual[start + count : start + 2 * count])
    wrong = (far > _TOO_FAR) | state.outlier
    widened = state.widened
    if judged and wrong.any() and np.sum(wrong) <= _MOST_LEFT_OUT * len(touches):
        widened = np.where(wrong, IGNORED, widened)
    return replace(
        state,
        normal=normals.best(touches),
        compliance_m_N=state.compliance_m_N + solution.compliance_m_N,
        slope=slope,
        bend_per_m=bend,
        widened=widened,
    )
