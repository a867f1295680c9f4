"""EI from measured deflections of a clamped rod under one known load: least squares with an interval that is honest.

The deflection that the load adds is y(x) = h(x; EI) + offset: h the beam's or the elastica's, the offset the gauge's,
which was set to zero twice and not at the same place. What such a table cannot tell apart is not left to the fit:

- a soft rod from a clamp that turns. Free, the turning would soak up whatever else the model leaves out. It is held at
  zero, and a prior for it, a share of the rod's slope at the load, goes into the standard deviation;
- a deflection from errors that neighbouring readings share: they widen the interval (`correlated_noise`);
- EI from force and distance, which are taken as exact.

What EI would be with a clamp free to turn, and with the offset held, is reported beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.core.errors import InputError, SolveError

from .deflection_fit import (
    ErrorModels,
    Forward,
    Parameters,
    beam,
    elastica,
    error_models,
    least_squares,
    neighbour_correlation,
    outlying,
    robust_line,
    slope_at_load,
)
from .deflection_table import DeflectionTable, check_load


@dataclass(frozen=True)
class Fit:
    """EI under one set of assumptions; offset and clamp rotation are 0 where they were held."""

    stiffness_Nm2: float
    std_Nm2: float
    offset_m: float
    offset_std_m: float
    clamp_rotation_rad: float
    rms_m: float


@dataclass(frozen=True, eq=False)
class StiffnessSolution:
    """EI of a rod and the evidence for it.

    Attributes
    ----------
    fit : the estimate; its std holds the correlated scatter and the clamp's prior.
    interval_Nm2 : the 95 % interval of EI.
    model, model_reason : "linear" or "elastica", and why.
    slope_at_load : dy/dx of the fitted rod.
    linear_bias : by which share the small-angle formula would miss EI on such a rod.
    residuals_m : (N,) of all readings, outliers too.
    outliers : which readings were left out.
    correlation, correlation_length_m : of neighbouring residuals, and the length over which it dies out.
    effective_readings : how many independent readings would fix EI as well as these.
    clamp_share_std, clamp_std_Nm2 : the clamp's prior, and its part of EI's std.
    offset_free : whether the gauge's offset was fitted.
    other_offset : the same with the offset held at 0, or free where it was held.
    free_clamp : the same with a clamp that may turn at no cost; None where no such fit settles.
    """

    fit: Fit
    interval_Nm2: tuple[float, float]
    model: str
    model_reason: str
    slope_at_load: float
    linear_bias: float
    residuals_m: np.ndarray
    outliers: tuple[int, ...]
    correlation: float
    correlation_length_m: float
    effective_readings: float
    clamp_share_std: float
    clamp_std_Nm2: float
    offset_free: bool
    other_offset: Fit
    free_clamp: Fit | None


CLAMP_SHARE_STD = 0.02
"""How far a clamp may turn, as a share of the rod's slope at the load. A rod held in a solid block of its own material
turns there as if it were longer by about half its thickness t, which is the share t/distance: 1/50 for a rod 1 : 50."""
STEEP_RAD = 0.15
"""Slope at the load from which the small-angle formula is not used, however large the scatter."""
BIAS_SHARE = 0.1
"""Largest error of the small-angle formula that is let pass, as a share of EI's standard deviation."""
LEAST_BIAS = 1e-5
"""A share of EI that no bench test resolves, however well its readings agree."""


@dataclass(frozen=True, eq=False)
class _Screened:
    """A model fitted to the readings that are no slips."""

    model: str
    forward: Forward
    parameters: Parameters
    kept: np.ndarray


def solve_stiffness(
    table: DeflectionTable,
    force_N: float,
    distance_m: float,
    *,
    offset: bool = True,
    clamp_share_std: float = CLAMP_SHARE_STD,
) -> StiffnessSolution:
    """EI of the rod of a table, loaded by `force_N` at `distance_m` along it from the clamp.

    `offset` False holds the gauge's offset at zero: right only where the gauge was read at the clamp and showed 0.

    Raises
    ------
    InputError : force or distance impossible, or no bending that stands out from the scatter.
    SolveError : the fit does not settle.
    """
    check_load(force_N, distance_m)
    small = _fit_beam(table, force_N, distance_m, offset)
    clamp = _clamp_effect(small, table, force_N, distance_m, clamp_share_std)
    fit, errors, half = _judged(table, small, offset, clamp)
    slope, bias = _linear_error(small, table, force_N, distance_m, offset)
    steep, biased = slope > STEEP_RAD, abs(bias) > max(BIAS_SHARE * fit.std_Nm2 / fit.stiffness_Nm2, LEAST_BIAS)
    reason = _why(slope, bias, fit.std_Nm2 / fit.stiffness_Nm2, steep, biased)
    chosen = small
    if steep or biased:
        chosen = _fit_elastica(table, force_N, distance_m, offset, small)
        slope, bias = _linear_error(chosen, table, force_N, distance_m, offset)
        clamp = _clamp_effect(chosen, table, force_N, distance_m, clamp_share_std)
        fit, errors, half = _judged(table, chosen, offset, clamp)
    if half >= 1.0:
        raise _no_bending()
    residuals = table.deflection_m - chosen.forward(fit.stiffness_Nm2) - fit.offset_m
    return StiffnessSolution(
        fit=fit,
        interval_Nm2=(fit.stiffness_Nm2 / (1.0 + half), fit.stiffness_Nm2 / (1.0 - half)),
        model=chosen.model,
        model_reason=reason,
        slope_at_load=slope,
        linear_bias=bias,
        residuals_m=residuals,
        outliers=tuple(int(index) for index in np.flatnonzero(~chosen.kept)),
        correlation=neighbour_correlation(residuals[chosen.kept]),
        correlation_length_m=errors.length_m,
        effective_readings=_effective_readings(chosen, errors, residuals),
        clamp_share_std=clamp_share_std,
        clamp_std_Nm2=clamp * fit.stiffness_Nm2,
        offset_free=offset,
        other_offset=_judged(table, _refitted(table, chosen, not offset, False), not offset, clamp)[0],
        free_clamp=_free_clamp(table, chosen, offset),
    )


def _fit_beam(table: DeflectionTable, force_N: float, distance_m: float, offset: bool) -> _Screened:
    forward = beam(table.x_m, force_N, distance_m)
    compliance, _ = robust_line(forward(1.0), table.deflection_m, offset)
    if compliance <= 0.0:
        raise _no_bending()
    return _screened(table, "linear", forward, 1.0 / compliance, offset)


def _fit_elastica(
    table: DeflectionTable, force_N: float, distance_m: float, offset: bool, small: _Screened
) -> _Screened:
    forward = elastica(table.x_m, force_N, distance_m)
    # the beam's slips may be the elastica's shape, so they are looked for anew at its own EI
    start = _refitted(table, _Screened("elastica", forward, small.parameters, small.kept), offset, False)
    return _screened(table, "elastica", forward, start.parameters.stiffness_Nm2, offset)


def _screened(table: DeflectionTable, model: str, forward: Forward, start_Nm2: float, offset: bool) -> _Screened:
    shape = forward(start_Nm2)
    factor, intercept = robust_line(shape, table.deflection_m, offset)
    kept = ~outlying(table.deflection_m - factor * shape - intercept, _least_std(table))
    return _Screened(model, forward, _least_squares(table, forward, kept, start_Nm2, offset, False), kept)


def _refitted(table: DeflectionTable, screened: _Screened, offset: bool, turning: bool) -> _Screened:
    start, kept = screened.parameters.stiffness_Nm2, screened.kept
    parameters = _least_squares(table, screened.forward, kept, start, offset, turning)
    return _Screened(screened.model, screened.forward, parameters, kept)


def _least_squares(
    table: DeflectionTable, forward: Forward, kept: np.ndarray, start_Nm2: float, offset: bool, turning: bool
) -> Parameters:
    def kept_only(stiffness: float) -> np.ndarray:
        return forward(stiffness)[kept]

    x, y = table.x_m[kept], table.deflection_m[kept]
    return least_squares(kept_only, x, y, start_Nm2, offset=offset, turning=turning)


def _judged(table: DeflectionTable, screened: _Screened, offset: bool, clamp: float) -> tuple[Fit, ErrorModels, float]:
    """A fit with its standard deviations, the error models behind them, and half the relative interval of 1/EI."""
    found, kept = screened.parameters, screened.kept
    x = table.x_m[kept]
    model = screened.forward(found.stiffness_Nm2)[kept] + found.offset_m + found.clamp_rotation_rad * x
    residuals = table.deflection_m[kept] - model
    errors = error_models(x, found.design, residuals, _least_std(table))
    covariance = errors.covariance
    first = np.eye(len(covariance))[0]
    fit = Fit(
        found.stiffness_Nm2,
        found.stiffness_Nm2 * float(np.hypot(np.sqrt(covariance[0, 0]), clamp)),
        found.offset_m,
        float(np.sqrt(covariance[1, 1])) if offset else 0.0,
        found.clamp_rotation_rad,
        float(np.sqrt(np.mean(residuals**2))),
    )
    return fit, errors, errors.half_width(first, clamp)


def _free_clamp(table: DeflectionTable, screened: _Screened, offset: bool) -> Fit | None:
    if screened.kept.sum() <= screened.parameters.design.shape[1] + 1:
        return None
    try:
        return _judged(table, _refitted(table, screened, offset, True), offset, 0.0)[0]
    except SolveError:
        return None


def _clamp_effect(
    screened: _Screened, table: DeflectionTable, force_N: float, distance_m: float, share_std: float
) -> float:
    """Relative std of EI from the clamp's prior: how a turned clamp leaks into the estimated compliance."""
    found = screened.parameters
    slope = slope_at_load(screened.model, force_N, distance_m, found.stiffness_Nm2)
    leak = np.linalg.lstsq(found.design, table.x_m[screened.kept], rcond=None)[0][0]
    return abs(float(leak)) * share_std * slope


def _linear_error(
    screened: _Screened, table: DeflectionTable, force_N: float, distance_m: float, offset: bool
) -> tuple[float, float]:
    """Slope at the load, and by which share the small-angle formula misses EI if the rod is an elastica."""
    stiffness, kept = screened.parameters.stiffness_Nm2, screened.kept
    slope = slope_at_load(screened.model, force_N, distance_m, stiffness)
    x = table.x_m[kept]
    bent = elastica(x, force_N, distance_m)(stiffness)
    straight = beam(x, force_N, distance_m)
    if not np.isfinite(bent).all():
        return slope, 1.0
    design = np.stack([straight(stiffness), np.ones_like(x)], axis=1)[:, : 1 + offset]
    compliance = np.linalg.lstsq(design, bent, rcond=None)[0][0]
    return slope, 1.0 / float(compliance) - 1.0 if compliance > 0.0 else 1.0


def _effective_readings(screened: _Screened, errors: ErrorModels, residuals_m: np.ndarray) -> float:
    kept = residuals_m[screened.kept]
    inverse = np.linalg.pinv(screened.parameters.design)[0]
    plain = float(kept @ kept) / errors.freedom * float(inverse @ inverse)
    real = float(errors.covariance[0, 0])
    return len(kept) * min(plain / real, 1.0)


def _least_std(table: DeflectionTable) -> float:
    """The std that rounding two readings to the last decimal gives their difference, or what float64 can hold."""
    return max(table.resolution_m / np.sqrt(6.0), 1e-12 * float(np.abs(table.deflection_m).max()))


def _why(slope: float, bias: float, relative_std: float, steep: bool, biased: bool) -> str:
    facts = f"slope {slope:.3g} at the load, small-angle formula off by {100 * bias:+.2g} % of EI against a standard "
    facts += f"deviation of {100 * relative_std:.2g} %"
    if steep:
        return f"large deflection: {facts}"
    return f"the small-angle formula would bias EI: {facts}" if biased else f"small deflection: {facts}"


def _no_bending() -> InputError:
    return InputError(
        "no bending stands out from the scatter of the readings",
        where="the table",
        remedy="load the rod more, and check which column is which",
    )
