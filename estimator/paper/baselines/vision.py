"""The vision-based ones: 2D-VBAA (ξ = 0, vision alone) and 3D-VBAA with the paper's camera A and camera B.

Each takes two points of the last frame's centreline, as the paper does, and the formulas in `two_point` and `inclined`.
The paper advises points close to the tip, where the straight part is; which case they are, the formulas find out.
Deviations are those of the two points' and the moment's noise, carried through by differences of one deviation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from estimator.paper.inclined import inclined_two_point_contact
from estimator.paper.two_point import force_z, two_point_contact

from .press import Answer, Press

_SHARES = (0.6, 0.97)
"""Where the two points are taken, in antenna lengths."""
_UNCERTAIN = 0.1
"""Distances less certain than this share of the length are not given out."""
_STEEP = 0.5
"""Slopes of the straight part beyond this are not the small deflections of Assumption 1."""

_Formula = Callable[[np.ndarray], np.ndarray]
"""From M inputs (M, K) to results (M, Q)."""


def vbaa_2d(press: Press) -> Answer:
    """l and f_y from vision alone.

    Assumes: small deflections of a straight weightless beam, seen square on, and an object that bends it within plane
    C. Where it bends out of C, l and f_y stay right and f_z is missed.
    """
    return _upright(press, with_moment=False)


def vbaa_3d_camera_a(press: Press) -> Answer:
    """l and f_y from vision, f_z = τ_y/l from the moment sensor.

    Assumes: small deflections of a straight weightless beam, and a camera square on plane C whose rays are parallel.
    """
    return _upright(press, with_moment=True)


def vbaa_3d_camera_b(press: Press) -> Answer:
    """l, f_y and f_z from two points of the inclined camera and the moment together, by the exact solution.

    Assumes: small deflections of a straight weightless beam, parallel rays inclined by ϕ towards the clamp.
    """
    moment, wire = _moment_y(press), press.wire

    def solve(given: np.ndarray) -> np.ndarray:
        found = inclined_two_point_contact(
            given[:, 0:2], given[:, 2:4], given[:, 4], given[:, 5], press.camera_tilt_rad, wire.length_m
        )
        alone = np.where(found.solutions > 1, np.nan, found.contact_m)
        return np.stack([alone, found.force_y_N, found.force_z_N], axis=1)

    return _answer(press, solve, _two_points(press, -1), moment)


def _two_points(press: Press, frame: int) -> np.ndarray | None:
    """(2, 2) the points of a frame that are seen nearest to `_SHARES` of the length; None without two of them."""
    assert press.points_m is not None
    points = press.points_m[frame]
    points = points[np.isfinite(points).all(axis=1)]
    wanted = np.array(_SHARES) * press.wire.length_m
    if len(points) < 2:
        return None
    picked = np.argmin(np.abs(points[:, 0] - wanted[:, None]), axis=1)
    return points[picked] if picked[0] != picked[1] else None


def _propagate(solve: _Formula, given: np.ndarray, std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Results (Q,) of one input (K,), and what independent noise of these deviations (K,) moves them by, (Q, K).

    A column is half the difference over ± one deviation; NaN where the noise reaches out of what has a solution.
    """
    steps = np.concatenate([np.zeros((1, len(given))), np.diag(std), -np.diag(std)])
    values = solve(given + steps)
    half = len(given)
    return values[0], 0.5 * (values[1 : half + 1] - values[half + 1 :]).T


def _upright(press: Press, with_moment: bool) -> Answer:
    def solve(given: np.ndarray) -> np.ndarray:
        found = two_point_contact(given[:, 0:2], given[:, 2:4], given[:, 5], press.wire.length_m)
        return np.stack([found.contact_m, found.force_y_N, force_z(given[:, 4], found.contact_m)], axis=1)

    moment = _moment_y(press) if with_moment else np.nan
    points = _two_points(press, -1)
    if points is not None and abs(np.diff(points[:, 1])) > _STEEP * abs(np.diff(points[:, 0])):
        return Answer(reason=f"bent beyond small deflections: a slope of more than {_STEEP:g}")
    return _answer(press, solve, points, moment)


def _answer(press: Press, solve: _Formula, points: np.ndarray | None, moment_Nm: float) -> Answer:
    """The reading of a formula over (x1, x2, y1, y2, τ_y, EI)."""
    if points is None:
        return Answer(reason="fewer than two points of the antenna are seen apart from each other")
    wire, noise = press.wire, press.noise
    given = np.array([*points[:, 0], *points[:, 1], moment_Nm, wire.stiffness_Nm2])
    std = np.array([0.0, 0.0, noise.point_m, noise.point_m, noise.moment_Nm, wire.stiffness_std_Nm2])
    if np.isnan(moment_Nm):
        given[4], std[4] = 0.0, 0.0
    unknown = bool(np.isnan(std).any())
    values, moved = _propagate(solve, given, np.nan_to_num(std))
    if np.isnan(values[0]):
        return Answer(reason="no contact explains the two points, or more than one: too little bent for their noise")
    deviations = np.full(3, np.nan) if unknown else np.sqrt((moved**2).sum(axis=1))
    if not unknown and not deviations[0] < _UNCERTAIN * wire.length_m:
        return Answer(
            candidates_m=values[:1], reason="bent too little: the two points' noise leaves the contact's place open"
        )
    force, force_std = np.full(3, np.nan), np.full(3, np.nan)
    seen = slice(1, 2 if np.isnan(moment_Nm) else 3)
    force[seen], force_std[seen] = values[seen], deviations[seen]
    return Answer(float(values[0]), float(deviations[0]), force, force_std)


def _moment_y(press: Press) -> float:
    assert press.moment_Nm is not None
    return float(press.moment_Nm[-1, 1])


_FEWEST_FRAMES = 3
_KNOWN = 0.2
"""Frames whose force is less certain than this share of itself are left out: there the formulas are far from linear."""
STANDS_OUT = 3.0
"""The compliance must be so many of its deviations."""


def vbaa_2d_pushing(press: Press) -> Answer:
    """`vision.vbaa_2d` of the last frame, and the object's stiffness from all of them.

    Assumes, besides: a turn within plane C against an object whose normal is along y, a linear spring, no friction. At
    least three frames of different force. Frames whose two points no contact explains are left out. What the beam's
    second order leaves, some 0.1 % of the antenna's own compliance l³/3EI at slopes of 3°, 0.3 % at 7°, is a bias.
    """
    last = vbaa_2d(press)
    assert press.turn_rad is not None
    frames = [_yield_at(press, frame) for frame in range(len(press.turn_rad))]
    kept = [frame for frame in frames if frame is not None and np.isfinite(frame[0]).all()]
    prefix = f"{last.reason}; object's stiffness:" if last.reason else "object's stiffness:"
    if len(kept) < _FEWEST_FRAMES:
        return replace(last, reason=f"{prefix} {len(kept)} frames with a contact, {_FEWEST_FRAMES} are needed")
    compliance, std = compliance_of(*map(np.array, zip(*kept, strict=True)))
    if np.isfinite(std) and not compliance > STANDS_OUT * std:
        least = 1.0 / (max(compliance, 0.0) + 2.0 * std)
        words = f"{prefix} gives way by no more than the noise; probably stiffer than {least:.3g} N/m"
        return replace(last, object_at_least_N_m=least, reason=words)
    if not compliance > 0.0:
        return replace(last, reason=f"{prefix} it does not give way under the force")
    return replace(
        last,
        object_stiffness_N_m=1.0 / compliance,
        object_stiffness_std_N_m=std / compliance**2,
        object_at_least_N_m=1.0 / (compliance + 2.0 * std),
    )


def compliance_of(values: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """1/k in m/N and its deviation from −f and u (n, 2), with covariances (n, 2, 2): a line with both in error.

    Most likely is the slope that makes Σ (u − u₀ − slope·(−f))²/variance of that least; the variance hangs on the
    slope, since the errors of f and u go together. The deviation grows with the scatter about the line where that is
    more than the noise; without a known noise it is the scatter's.
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


def _yield_at(press: Press, frame: int) -> tuple[np.ndarray, np.ndarray] | None:
    """−f_y and u of one frame, and their covariance (2, 2); None without two points."""
    points = _two_points(press, frame)
    if points is None:
        return None
    assert press.turn_rad is not None
    stiffness = press.wire.stiffness_Nm2

    def solve(given: np.ndarray) -> np.ndarray:
        found = two_point_contact(points[:, 0], given[:, :2], stiffness, press.wire.length_m)
        contact, force = found.contact_m, found.force_y_N
        bent = force * contact**3 / (3.0 * stiffness)
        return np.stack([-force, contact * np.sin(given[:, 2]) + bent * np.cos(given[:, 2])], axis=1)

    noise = np.array([press.noise.point_m, press.noise.point_m, press.noise.turn_rad])
    noise[2] = np.nan_to_num(noise[2])
    values, moved = _propagate(solve, np.array([*points[:, 1], press.turn_rad[frame, 0]]), np.nan_to_num(noise))
    if np.isnan(noise).any():
        return values, np.full((2, 2), np.nan)
    if not np.linalg.norm(moved[0]) < _KNOWN * abs(values[0]):
        return None
    return values, moved @ moved.T
