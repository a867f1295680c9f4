"""EI from measured deflections of a clamped rod under one known load, with an interval that allows for shared errors.

The deflection that the load adds is y(x) = h(x; EI) + offset: h the beam's or the elastica's, the offset the gauge's,
which was set to zero twice. What a table cannot separate is not left to the fit: a clamp that turns is held at zero,
and a prior for it goes into the standard deviation; errors that neighbouring readings share widen the interval; force
and distance are taken as exact. EI with a clamp free to turn, and with the offset held, is reported beside it.
"""

from __future__ import annotations

import contextlib
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
    gauss_newton,
    neighbour_correlation,
    outlying,
    robust_line,
    slope_at_load,
)
from .deflection_table import DeflectionTable, check_load


@dataclass(frozen=True)
class BeamFit:
    """EI under one set of assumptions; offset and clamp rotation are 0 where they were held."""

    stiffness_Nm2: float
    std_Nm2: float
    offset_m: float
    offset_std_m: float
    clamp_rotation_rad: float
    rms_m: float


@dataclass(frozen=True, eq=False)
class StiffnessSolution:
    """EI of a rod and the evidence for it."""

    fit: BeamFit  # its std holds the correlated scatter and the clamp's prior
    interval_Nm2: tuple[float, float]  # 95 % of EI
    model: str  # "linear" or "elastica"
    model_reason: str
    slope_at_load: float  # dy/dx of the fitted rod
    linear_bias: float  # by which share the small-angle formula would miss EI
    residuals_m: np.ndarray  # (N,) of all readings
    outliers: tuple[int, ...]  # which readings were left out
    correlation: float  # of neighbouring residuals
    correlation_length_m: float  # over which it dies out
    effective_readings: float  # independent readings that would fix EI as well
    clamp_share_std: float  # the clamp's prior
    clamp_std_Nm2: float  # its part of EI's std
    offset_free: bool  # whether the gauge's offset was fitted
    other_offset: BeamFit  # the fit with the offset held, or free
    free_clamp: BeamFit | None  # with a clamp free to turn; None where it does not converge


_CLAMP_SHARE_STD = 0.02
"""How far a clamp may turn, as a share of the rod's slope at the load. A rod held in a solid block of its own material
turns there as if it were longer by about half its thickness t, which is the share t/distance: 1/50 for a rod 1 : 50."""
_STEEP_RAD = 0.15  # slope at the load from which the small-angle formula is not used, however large the scatter
_BIAS_SHARE = 0.1  # largest error of the small-angle formula that is let pass, as a share of EI's standard deviation
_LEAST_BIAS = 1e-5  # a share of EI that no bench test resolves, however well its readings agree


def solve_stiffness(
    table: DeflectionTable,
    force_N: float,
    distance_m: float,
    *,
    offset: bool = True,
    clamp_share_std: float = _CLAMP_SHARE_STD,
) -> StiffnessSolution:
    """EI of the rod of a table, loaded by `force_N` at `distance_m` along it from the clamp.

    `offset` False holds the gauge's offset at zero: right only where the gauge was read at the clamp and showed 0.

    Raises
    ------
    InputError : force or distance impossible, or no bending that stands out from the scatter.
    SolveError : the fit does not converge.
    """
    check_load(force_N, distance_m)
    bench = _Bench(table, force_N, distance_m)
    compliance, _ = robust_line(bench.forward("linear")(1.0), table.deflection_m, offset)
    if compliance <= 0.0:
        raise _no_bending()
    chosen = bench.screened("linear", 1.0 / compliance, offset)
    clamp = chosen.clamp_effect(clamp_share_std)
    fit, errors, half = chosen.judged(clamp)
    slope, bias = chosen.linear_error()
    relative = fit.std_Nm2 / fit.stiffness_Nm2
    steep, biased = slope > _STEEP_RAD, abs(bias) > max(_BIAS_SHARE * relative, _LEAST_BIAS)
    reason = "large deflection" if steep else "the small-angle formula would bias EI" if biased else "small deflection"
    reason += f": slope {slope:.3g} at the load, small-angle formula off by {100 * bias:+.2g} % of EI against a "
    reason += f"standard deviation of {100 * relative:.2g} %"
    if steep or biased:
        # the beam's outliers may be the elastica's shape, so they are looked for anew at its own EI
        start = bench.fitted("elastica", chosen.kept, chosen.parameters.stiffness_Nm2, offset)
        chosen = bench.screened("elastica", start.parameters.stiffness_Nm2, offset)
        slope, bias = chosen.linear_error()
        clamp = chosen.clamp_effect(clamp_share_std)
        fit, errors, half = chosen.judged(clamp)
    if half >= 1.0:
        raise _no_bending()
    residuals = table.deflection_m - bench.forward(chosen.model)(fit.stiffness_Nm2) - fit.offset_m
    kept, inverse = residuals[chosen.kept], np.linalg.pinv(chosen.parameters.design)[0]
    plain = float(kept @ kept) / errors.freedom * float(inverse @ inverse)
    free_clamp = None
    if chosen.kept.sum() > chosen.parameters.design.shape[1] + 1:
        with contextlib.suppress(SolveError):
            free_clamp = chosen.refitted(offset, turning=True).judged(0.0)[0]
    return StiffnessSolution(
        fit=fit,
        interval_Nm2=(fit.stiffness_Nm2 / (1.0 + half), fit.stiffness_Nm2 / (1.0 - half)),
        model=chosen.model,
        model_reason=reason,
        slope_at_load=slope,
        linear_bias=bias,
        residuals_m=residuals,
        outliers=tuple(np.flatnonzero(~chosen.kept).tolist()),
        correlation=neighbour_correlation(kept),
        correlation_length_m=errors.length_m,
        effective_readings=len(kept) * min(plain / float(errors.covariance[0, 0]), 1.0),
        clamp_share_std=clamp_share_std,
        clamp_std_Nm2=clamp * fit.stiffness_Nm2,
        offset_free=offset,
        other_offset=chosen.refitted(not offset).judged(clamp)[0],
        free_clamp=free_clamp,
    )


@dataclass(frozen=True, eq=False)
class _Bench:
    """The table and the load it was measured under."""

    table: DeflectionTable
    force_N: float
    distance_m: float

    def forward(self, model: str, kept: np.ndarray | slice = slice(None)) -> Forward:
        return (beam if model == "linear" else elastica)(self.table.x_m[kept], self.force_N, self.distance_m)

    @property
    def least_std_m(self) -> float:
        """What rounding two readings to the last decimal gives their difference, or what float64 can hold."""
        table = self.table
        return max(table.resolution_m / np.sqrt(6.0), 1e-12 * float(np.abs(table.deflection_m).max()))

    def screened(self, model: str, start_Nm2: float, offset: bool) -> _RodFit:
        """Fitted to the readings that are not outliers."""
        shape = self.forward(model)(start_Nm2)
        factor, intercept = robust_line(shape, self.table.deflection_m, offset)
        kept = ~outlying(self.table.deflection_m - factor * shape - intercept, self.least_std_m)
        return self.fitted(model, kept, start_Nm2, offset)

    def fitted(self, model: str, kept: np.ndarray, start_Nm2: float, offset: bool, turning: bool = False) -> _RodFit:
        x, y = self.table.x_m[kept], self.table.deflection_m[kept]
        found = gauss_newton(self.forward(model, kept), x, y, start_Nm2, offset=offset, turning=turning)
        return _RodFit(self, model, found, kept, offset)


@dataclass(frozen=True, eq=False)
class _RodFit:
    """A model fitted to the readings kept (N,)."""

    bench: _Bench
    model: str
    parameters: Parameters
    kept: np.ndarray
    offset: bool

    def refitted(self, offset: bool, turning: bool = False) -> _RodFit:
        """The same model and readings under other assumptions."""
        return self.bench.fitted(self.model, self.kept, self.parameters.stiffness_Nm2, offset, turning)

    def judged(self, clamp: float) -> tuple[BeamFit, ErrorModels, float]:
        """Standard deviations, the error models behind them, and half the relative interval of 1/EI."""
        found, table = self.parameters, self.bench.table
        x = table.x_m[self.kept]
        model = self.bench.forward(self.model, self.kept)(found.stiffness_Nm2)
        residuals = table.deflection_m[self.kept] - (model + found.offset_m + found.clamp_rotation_rad * x)
        errors = error_models(x, found.design, residuals, self.bench.least_std_m)
        covariance = errors.covariance
        fit = BeamFit(
            found.stiffness_Nm2,
            found.stiffness_Nm2 * float(np.hypot(np.sqrt(covariance[0, 0]), clamp)),
            found.offset_m,
            float(np.sqrt(covariance[1, 1])) if self.offset else 0.0,
            found.clamp_rotation_rad,
            float(np.sqrt(np.mean(residuals**2))),
        )
        return fit, errors, errors.half_width(np.eye(len(covariance))[0], clamp)

    def _slope_at_load(self) -> float:
        return slope_at_load(self.model, self.bench.force_N, self.bench.distance_m, self.parameters.stiffness_Nm2)

    def clamp_effect(self, share_std: float) -> float:
        """Relative std of EI from the clamp's prior: how a turned clamp leaks into the estimated compliance."""
        leak = np.linalg.lstsq(self.parameters.design, self.bench.table.x_m[self.kept], rcond=None)[0][0]
        return abs(float(leak)) * share_std * self._slope_at_load()

    def linear_error(self) -> tuple[float, float]:
        """Slope at the load, and by which share the small-angle formula misses EI if the rod is an elastica."""
        forwards = (self.bench.forward(model, self.kept) for model in ("linear", "elastica"))
        straight, bent = (forward(self.parameters.stiffness_Nm2) for forward in forwards)
        compliance = 0.0
        if np.isfinite(bent).all():
            design = np.stack([straight, np.ones_like(straight)], axis=1)[:, : 1 + self.offset]
            compliance = float(np.linalg.lstsq(design, bent, rcond=None)[0][0])
        return self._slope_at_load(), 1.0 / compliance - 1.0 if compliance > 0.0 else 1.0


def _no_bending() -> InputError:
    return InputError(
        "no bending stands out from the scatter of the readings",
        where="the table",
        remedy="load the rod more, and check which column is which",
    )
