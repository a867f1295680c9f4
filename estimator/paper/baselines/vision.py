"""The vision-based ones: 2D-VBAA (ξ = 0, vision alone) and 3D-VBAA with the paper's camera A and camera B.

Each takes two points of the last frame's centreline, as the paper does, and the formulas in `two_point` and `inclined`.
The paper advises points close to the tip, where the straight part is; which case they are, the formulas find out.
Deviations are those of the two points' and the moment's noise, carried through by differences of one deviation.
All assume small deflections of a straight weightless beam.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, two_point_contact

from .press import Answer, Press

_SHARES = (0.6, 0.97)  # where the two points are taken, in antenna lengths
_UNCERTAIN = 0.1  # distances less certain than this share of the length are not given out
_STEEP = 0.5  # slopes of the straight part beyond this are not the small deflections of Assumption 1
_FEWEST_FRAMES = 3  # needed for an object's stiffness
_KNOWN = 0.2  # frames whose force is less certain than this share of itself are left out: the formulas are not linear
STANDS_OUT = 3.0  # the compliance must be so many of its deviations

_Formula = Callable[[np.ndarray], np.ndarray]  # from M inputs (M, K) to results (M, Q)


def vbaa_2d(press: Press) -> Answer:
    """l and f_y from vision alone, seen square on. Where the object bends the antenna out of C, f_z is missed."""
    return _upright(press, np.nan)


def vbaa_3d_camera_a(press: Press) -> Answer:
    """l and f_y from vision, f_z = τ_y/l from the moment sensor; the camera is square on plane C, its rays parallel."""
    return _upright(press, float(np.asarray(press.moment_Nm)[-1, 1]))


def vbaa_3d_camera_b(press: Press) -> Answer:
    """l, f_y and f_z from two points and the moment together, exactly; parallel rays, inclined by ϕ to the clamp."""

    def solve(given: np.ndarray) -> np.ndarray:
        found = inclined_two_point_contact(
            given[:, 0:2], given[:, 2:4], given[:, 4], given[:, 5], press.camera_tilt_rad, press.wire.length_m
        )
        alone = np.where(found.solutions > 1, np.nan, found.contact_m)
        return np.stack([alone, found.force_y_N, found.force_z_N], axis=1)

    return _answer(press, solve, _two_points(press, -1), float(np.asarray(press.moment_Nm)[-1, 1]))


def vbaa_2d_pushing(press: Press) -> Answer:
    """`vbaa_2d` of the last frame, and the object's stiffness from all of them.

    Assumes, besides: a turn within plane C against an object whose normal is along y, a linear spring, no friction. At
    least three frames of different force. Frames whose two points no contact explains are left out. What the beam's
    second order leaves, some 0.1 % of the antenna's own compliance l³/3EI at slopes of 3°, 0.3 % at 7°, is a bias.
    """
    last = vbaa_2d(press)
    frames = [_yield_at(press, *frame) for frame in enumerate(np.asarray(press.turn_rad)[:, 0])]
    kept = [frame for frame in frames if frame is not None and np.isfinite(frame[0]).all()]
    prefix = f"{last.reason}; object's stiffness:" if last.reason else "object's stiffness:"
    if len(kept) < _FEWEST_FRAMES:
        return replace(last, reason=f"{prefix} {len(kept)} frames with a contact, {_FEWEST_FRAMES} are needed")
    compliance, std = compliance_of(*map(np.array, zip(*kept, strict=True)))
    if np.isfinite(std) and not compliance > STANDS_OUT * std:
        least = 1.0 / (max(compliance, 0.0) + 2.0 * std)
        words = f"{prefix} gives way by no more than the noise; probably stiffer than {least:.3g} N/m"
        return replace(last, reason=words)
    if not compliance > 0.0:
        return replace(last, reason=f"{prefix} it does not give way under the force")
    return replace(last, object_stiffness_N_m=1.0 / compliance, object_stiffness_std_N_m=std / compliance**2)


def _two_points(press: Press, frame: int) -> np.ndarray | None:
    """(2, 2) the points of a frame that are seen nearest to `_SHARES` of the length; None without two of them."""
    points = np.asarray(press.points_m)[frame]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return None
    first, second = np.argmin(np.abs(points[:, 0] - np.array(_SHARES)[:, None] * press.wire.length_m), axis=1)
    return points[[first, second]] if first != second else None


def _propagate(solve: _Formula, given: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Results (Q,) of one input (K,), and what independent noise of these deviations (K,) moves them by, (Q, K): half
    the difference over ± one deviation; NaN where that reaches out of what has a solution."""
    values = solve(given + np.concatenate([np.zeros((1, len(given))), np.diag(std), -np.diag(std)]))
    up, down = np.split(values[1:], 2)
    return values[0], 0.5 * (up - down).T


def _upright(press: Press, moment_Nm: float) -> Answer:
    def solve(given: np.ndarray) -> np.ndarray:
        found = two_point_contact(given[:, 0:2], given[:, 2:4], given[:, 5], press.wire.length_m)
        return np.stack([found.contact_m, found.force_y_N, force_z(given[:, 4], found.contact_m)], axis=1)

    points = _two_points(press, -1)
    if points is not None and abs(np.diff(points[:, 1])) > _STEEP * abs(np.diff(points[:, 0])):
        return Answer(reason=f"bent beyond small deflections: a slope of more than {_STEEP:g}")
    return _answer(press, solve, points, moment_Nm)


def _answer(press: Press, solve: _Formula, points: np.ndarray | None, moment_Nm: float) -> Answer:
    """The reading of a formula over (x1, x2, y1, y2, τ_y, EI); a moment of NaN is none."""
    if points is None:
        return Answer(reason="fewer than two points of the antenna are seen apart from each other")
    wire, noise, blind = press.wire, press.noise, bool(np.isnan(moment_Nm))
    moment, moment_std = (0.0, 0.0) if blind else (moment_Nm, noise.moment_Nm)
    std = np.array([0.0, 0.0, noise.point_m, noise.point_m, moment_std, wire.stiffness_std_Nm2])
    values, moved = _propagate(
        solve, np.array([*points[:, 0], *points[:, 1], moment, wire.stiffness_Nm2]), np.nan_to_num(std)
    )
    if np.isnan(values[0]):
        return Answer(reason="no contact explains the two points, or more than one: too little bent for their noise")
    deviations = np.full(3, np.nan) if np.isnan(std).any() else np.sqrt((moved**2).sum(axis=1))
    if not (np.isnan(std).any() or deviations[0] < _UNCERTAIN * wire.length_m):
        reason = "bent too little: the two points' noise leaves the contact's place open"
        return Answer(candidates_m=values[:1], reason=reason)
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    seen = slice(1, 2 if blind else 3)
    force[seen], force_std[seen] = values[seen], deviations[seen]
    return Answer(float(values[0]), float(deviations[0]), force, force_std)


def compliance_of(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """1/k in m/N and its deviation from −f and u (n, 2), with covariances (n, 2, 2): a line with both in error.

    Least is Σ (u − u₀ − slope·(−f))²/variance of that, which depends on the slope, since the errors of f and u go
    together. The deviation grows with the scatter where that is more than the noise, or where no noise is known.
    """
    force, given = values.T
    if len(values) < _FEWEST_FRAMES or not np.ptp(force) > 0.0:
        return np.nan, np.nan
    noisy = bool(np.isfinite(covariance).all() and (covariance[:, 1, 1] > 0.0).all())
    noise = covariance if noisy else np.broadcast_to(np.diag([0.0, 1.0]), (len(values), 2, 2))

    def cost(slope: float) -> float:
        weight = 1.0 / np.einsum("i,nij,j->n", [-slope, 1.0], noise, [-slope, 1.0])
        residual = given - slope * force
        return float(weight @ (residual - (weight @ residual) / weight.sum()) ** 2)

    rough, step = np.polyfit(force, given, 1)[0], float(np.ptp(given) + 1e-9 * np.ptp(force)) / float(np.ptp(force))
    best = float(minimize_scalar(cost, bracket=(rough - 0.1 * step, rough + 0.1 * step)).x)
    step = 1e-3 * step
    curvature = (cost(best + step) - 2.0 * cost(best) + cost(best - step)) / step**2
    if not curvature > 0.0:
        return np.nan, np.nan
    scatter = cost(best) / (len(values) - 2)
    return best, float(np.sqrt(2.0 * (max(scatter, 1.0) if noisy else scatter) / curvature))


def _yield_at(press: Press, frame: int, turn_rad: float) -> tuple[np.ndarray, np.ndarray] | None:
    """−f_y and u of one frame, and their covariance (2, 2); None without two points, or a force that is known."""
    points, stiffness = _two_points(press, frame), press.wire.stiffness_Nm2
    if points is None:
        return None

    def solve(given: np.ndarray) -> np.ndarray:
        found = two_point_contact(points[:, 0], given[:, :2], stiffness, press.wire.length_m)
        contact, force = found.contact_m, found.force_y_N
        bent = force * contact**3 / (3.0 * stiffness)
        return np.stack([-force, contact * np.sin(given[:, 2]) + bent * np.cos(given[:, 2])], axis=1)

    point_std, turn_std = np.nan_to_num([press.noise.point_m, press.noise.turn_rad])
    values, moved = _propagate(solve, np.array([*points[:, 1], turn_rad]), np.array([point_std, point_std, turn_std]))
    if np.isnan(press.noise.point_m):
        return values, np.full((2, 2), np.nan)
    if not np.linalg.norm(moved[0]) < _KNOWN * abs(values[0]):
        return None
    return values, moved @ moved.T
