"""Least squares of one rod's deflections: beam or elastica, with a gauge offset and a clamp that may turn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..antenna import linear
from ..antenna.elastica import planar_elastica_dead
from ..errors import SolveError

Forward = Callable[[float], np.ndarray]
"""EI in N·m² → deflections (N,) in m at the readings."""

_STEPS = 60
_NODES = np.linspace(0.0, 1.0, 201)


@dataclass(frozen=True, eq=False)
class Parameters:
    """Where the least squares ended, and the design matrix (N, P) there.

    Its columns are the derivatives by the compliance 1/EI (relative: dy/d ln 1/EI), the offset and the clamp's
    rotation, the last two only if they are free.
    """

    stiffness_Nm2: float
    offset_m: float
    clamp_rotation_rad: float
    design: np.ndarray


def beam(x_m: np.ndarray, force_N: float, distance_m: float) -> Forward:
    """Small deflections at x (N,)."""
    return lambda stiffness: linear.deflection(x_m, distance_m, force_N, stiffness)


def elastica(x_m: np.ndarray, force_N: float, distance_m: float) -> Forward:
    """Large deflections under a hanging weight, read at the places x (N,) on the undeflected rod's axis.

    NaN where the rod is bent so far that it no longer reaches to a reading.
    """

    def deflections(stiffness: float) -> np.ndarray:
        shape = planar_elastica_dead(_NODES * distance_m, distance_m, force_N, stiffness)
        x, w, theta = shape.x_m[0], shape.w_m[0], shape.theta_rad[0]
        if not np.all(np.diff(x) > 0.0):
            return np.full(len(x_m), np.nan)
        # beyond the load the rod is straight
        beyond = w[-1] + np.tan(theta[-1]) * (x_m - x[-1])
        return np.where(x_m <= x[-1], CubicHermiteSpline(x, w, np.tan(theta))(x_m), beyond)

    return deflections


def least_squares(
    forward: Forward,
    x_m: np.ndarray,
    deflection_m: np.ndarray,
    start_Nm2: float,
    *,
    offset: bool,
    turning: bool = False,
) -> Parameters:
    """Gauss-Newton in the compliance, exact in one step for the beam. All arrays (N,).

    Raises SolveError when it does not settle, as for a clamp that takes over all of the deflection.
    """
    stiffness = start_Nm2
    extra = [column for free, column in ((offset, np.ones_like(x_m)), (turning, x_m)) if free]
    for _ in range(_STEPS):
        shape = forward(stiffness)
        design = np.stack([by_compliance(forward, stiffness), *extra], axis=1)
        if not np.isfinite(design).all() or not np.isfinite(shape).all():
            break
        solution = np.linalg.lstsq(design, deflection_m - shape, rcond=None)[0]
        step = float(np.clip(solution[0], -0.5, 1.0))
        stiffness /= 1.0 + step
        if abs(step) < 1e-10:
            rest = iter(solution[1:])
            return Parameters(
                stiffness, float(next(rest)) if offset else 0.0, float(next(rest)) if turning else 0.0, design
            )
    raise SolveError(
        "the fit of EI does not settle: the readings are not those of one rod in a clamp; check force, distance "
        "and the table's columns"
    )


def by_compliance(forward: Forward, stiffness_Nm2: float) -> np.ndarray:
    """(N,) dy/d ln(1/EI) in m."""
    share = 1e-4
    return (forward(stiffness_Nm2 / (1.0 + share)) - forward(stiffness_Nm2 / (1.0 - share))) / (2.0 * share)


def slope_at_load(model: str, force_N: float, distance_m: float, stiffness_Nm2: float) -> float:
    """dy/dx of the rod at the load, without sign; "linear" or "elastica"."""
    if model == "linear":
        return float(linear.slope(distance_m, distance_m, abs(force_N), stiffness_Nm2))
    shape = planar_elastica_dead(np.array([distance_m]), distance_m, abs(force_N), stiffness_Nm2)
    return float(np.tan(shape.theta_rad[0, 0]))
