"""The 2D-VBAA's third output: the environment's stiffness, from how far the contact has moved under which force.

While the base turns by w, the contact is carried along and bent back by Δy: since the first frame the object has given
way by u = l·sin w + Δy·cos w, but for a constant. With the force along it, u = u₀ − f_y/k.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from vbaa_calib.errors import InputError

from .press import Press, Reading
from .vision import contact_of_points, spread, two_points, vbaa_2d

FEWEST_FRAMES = 3
KNOWN = 0.2
"""Frames whose force is less certain than this share of itself are left out: there the formulas are far from linear."""
STANDS_OUT = 3.0
"""The compliance must be so many of its deviations."""


def vbaa_2d_pushing(press: Press) -> Reading:
    """`vision.vbaa_2d` of the last frame, and the object's stiffness from all of them.

    Assumes, besides: a turn within plane C against an object whose normal is along y, a linear spring, no friction. At
    least three frames of different force. Frames whose two points no contact explains are left out. What the beam's
    second order leaves, some 0.1 % of the antenna's own compliance l³/3EI at slopes of 3°, 0.3 % at 7°, is a bias.
    """
    last = vbaa_2d(press)
    if press.turn_rad is None:
        raise InputError("no turns", where="press", remedy="give turn_rad")
    frames = [_given_way(press, frame) for frame in range(len(press.turn_rad))]
    kept = [frame for frame in frames if frame is not None and np.isfinite(frame[0]).all()]
    if len(kept) < FEWEST_FRAMES:
        words = f"object's stiffness: {len(kept)} frames with a contact, {FEWEST_FRAMES} are needed"
        return replace(last, reason=_both(last.reason, words))
    compliance, std = compliance_of(np.array([each[0] for each in kept]), np.array([each[1] for each in kept]))
    if np.isfinite(std) and not compliance > STANDS_OUT * std:
        least = 1.0 / (max(compliance, 0.0) + 2.0 * std)
        words = f"object's stiffness: gives way by no more than the noise; probably stiffer than {least:.3g} N/m"
        return replace(last, object_at_least_N_m=least, reason=_both(last.reason, words))
    if not compliance > 0.0:
        return replace(last, reason=_both(last.reason, "object's stiffness: it does not give way under the force"))
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
    if len(values) < FEWEST_FRAMES or not np.ptp(force) > 0.0:
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


def _given_way(press: Press, frame: int) -> tuple[np.ndarray, np.ndarray] | None:
    """−f_y and u of one frame, and their covariance (2, 2); None without two points."""
    points = two_points(press, frame)
    if points is None or press.turn_rad is None:
        return None
    stiffness = press.wire.stiffness_Nm2

    def solve(given: np.ndarray) -> np.ndarray:
        pairs = np.stack([np.broadcast_to(points[:, 0], (len(given), 2)), given[:, :2]], axis=-1)
        contact, force = contact_of_points(press, pairs).T
        bent = force * contact**3 / (3.0 * stiffness)
        return np.stack([-force, contact * np.sin(given[:, 2]) + bent * np.cos(given[:, 2])], axis=1)

    noise = np.array([press.noise.point_m, press.noise.point_m, press.noise.turn_rad])
    noise[2] = np.nan_to_num(noise[2])
    values, moved = spread(solve, np.array([*points[:, 1], press.turn_rad[frame, 0]]), np.nan_to_num(noise))
    if np.isnan(noise).any():
        return values, np.full((2, 2), np.nan)
    if not np.linalg.norm(moved[0]) < KNOWN * abs(values[0]):
        return None
    return values, moved @ moved.T


def _both(first: str, second: str) -> str:
    return f"{first}; {second}" if first else second
