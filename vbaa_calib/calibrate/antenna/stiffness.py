"""EI from measured deflections of a clamped rod under one known load, with an interval that allows for correlated
errors.

The deflection that the load adds is y(x) = h(x; EI) + offset: h is the beam's or the elastica's shape, the offset that
of the gauge, which was set to zero twice. A clamp that turns cannot be separated from bending: its rotation is fixed at
zero, and its prior enters the standard deviation. Errors that neighbouring readings share widen the interval; force and
distance count as exact. EI with a free clamp rotation, and with a fixed offset, is reported as well.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from decimal import MAX_EMAX, Context, Decimal
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import cho_solve
from scipy.optimize import brentq
from scipy.special import stdtr, stdtrit

from vbaa_calib.antenna import linear
from vbaa_calib.antenna.elastica import planar_elastica_dead
from vbaa_calib.core.arrays import spread_evenly
from vbaa_calib.core.csv_rows import number, read_csv
from vbaa_calib.core.errors import InputError, SolveError
from vbaa_calib.core.least_squares import SQUARES, Linearised, Rules, minimise
from vbaa_calib.core.robust import mad_std

from .settings import AntennaSettings

_COLUMNS = ("x_m", "unloaded_y_m", "loaded_y_m")  # of the table


@dataclass(frozen=True, eq=False)
class DeflectionTable:
    """N readings of a gauge along a clamped rod, without and with a load at `distance_m` from the clamp."""

    x_m: np.ndarray  # (N,) strictly increasing, from the clamp along the undeflected rod
    unloaded_y_m: np.ndarray  # (N,) positive in the force's direction
    loaded_y_m: np.ndarray  # (N,)
    force_N: float
    distance_m: float
    resolution_m: float = 0.0  # the last decimal written down; 0: unknown

    @property
    def deflection_m(self) -> np.ndarray:
        """(N,) deflection added by the load: the gauge's constant errors along x, and the rod's sag and bow, cancel."""
        return self.loaded_y_m - self.unloaded_y_m

    def forward(self, model: str, kept: np.ndarray | slice = slice(None)) -> Forward:
        """Function of EI that gives the deflections at the readings, by the "linear" or the "elastica" model."""
        return (_beam if model == "linear" else _elastica)(self.x_m[kept], self.force_N, self.distance_m)

    @property
    def least_std_m(self) -> float:
        """Standard deviation of a difference of two readings that are rounded to their last decimal, or to float64."""
        return max(self.resolution_m / np.sqrt(6.0), 1e-12 * float(np.abs(self.deflection_m).max()))

    def screened(self, model: str, start_Nm2: float, offset: bool) -> _RodFit:
        """Fits a model to the readings that are not outliers."""
        shape = self.forward(model)(start_Nm2)
        factor, intercept = _robust_line(shape, self.deflection_m, offset)
        kept = ~_outlying(self.deflection_m - factor * shape - intercept, self.least_std_m)
        return self.fitted(model, kept, start_Nm2, offset)

    def fitted(self, model: str, kept: np.ndarray, start_Nm2: float, offset: bool, turning: bool = False) -> _RodFit:
        """Fits a model to the readings of a mask (N,). offset, turning : whether the gauge's offset and the clamp are
        free."""
        x, y = self.x_m[kept], self.deflection_m[kept]
        found = _least_squares(self.forward(model, kept), x, y, start_Nm2, offset=offset, turning=turning)
        return _RodFit(self, model, kept, offset, *found)


def read_deflections(path: Path, force_N: float, distance_m: float) -> DeflectionTable:
    """The table in a CSV file. Raises InputError naming file, line and remedy."""
    _check_load(force_N, distance_m)
    rows = read_csv(path, _COLUMNS)
    if not AntennaSettings.fewest_rows <= len(rows) <= AntennaSettings.most_rows:
        remedy = f"at least {AntennaSettings.fewest_rows}, spread between clamp and load, are needed"
        if len(rows) > AntennaSettings.most_rows:
            remedy = f"average them to {AntennaSettings.most_rows} at most"
        raise InputError(f"has {len(rows)} readings", where=path, remedy=remedy)
    x, unloaded, loaded = (np.array([number(row, name, path) for row in rows]) for name in _COLUMNS)
    places = [f"{path} line {row['line']}" for row in rows]
    _check_positions(x, distance_m, places)
    _check_deflections(loaded - unloaded, x, force_N, distance_m, places, path)
    # the power of ten of the last digit that is written down: -3 for 0.120 and for 5e-3
    silent = Context(traps=[])  # of an exponent beyond decimals nothing is known
    digits = [Decimal(row[name], silent).as_tuple().exponent for row in rows for name in _COLUMNS[1:]]
    finest = min(exponent if isinstance(exponent, int) else -MAX_EMAX for exponent in digits)
    return DeflectionTable(x, unloaded, loaded, force_N, distance_m, 10.0**finest)


def _check_load(force_N: float, distance_m: float) -> None:
    """Raises InputError for a force or distance that is impossible in a bench test."""
    if not np.isfinite(force_N) or force_N == 0.0:
        raise InputError(f"the force is {force_N:g}", remedy="give the load in newtons (mass in kg times 9.81)")
    if not 0.0 < distance_m <= AntennaSettings.longest_rod_m:
        raise InputError(f"the distance is {distance_m:g}", remedy="give metres from the clamp to the load")


def _check_positions(x_m: np.ndarray, distance_m: float, places: list[str]) -> None:
    for before, x, place in zip([-np.inf, *x_m], x_m, places, strict=False):
        rules = (
            (x < 0.0, f"x_m is {x:g}", "measure x from the clamp towards the load, in metres"),
            (
                x > distance_m,
                f"x_m is {x:g}, beyond the load at {distance_m:g} m",
                "give x and the distance in metres from the clamp, and take out readings beyond the load",
            ),
            (x == before, f"x_m is {x:g} a second time", "put the mean of repeated readings in one row"),
            (x < before, f"x_m falls from {before:g} to {x:g}", "sort the rows by x, and check this one"),
        )
        for wrong, what, remedy in rules:
            if wrong:
                raise InputError(what, where=place, remedy=remedy)


def _check_deflections(
    deflection_m: np.ndarray, x_m: np.ndarray, force_N: float, distance_m: float, places: list[str], path: Path
) -> None:
    worst = int(np.argmax(np.abs(deflection_m)))
    if abs(deflection_m[worst]) > distance_m:
        raise InputError(
            f"the rod is deflected by {deflection_m[worst]:g} m, more than its length {distance_m:g} m",
            where=places[worst],
            remedy="give the readings in metres (1 mm is 0.001)",
        )
    if not deflection_m.any():
        raise InputError(
            "loaded_y_m equals unloaded_y_m in every row", where=path, remedy="give the readings without and with load"
        )
    # by the half nearer to the load, where the bending exceeds the gauge's offset
    far = deflection_m[x_m >= np.median(x_m)]
    rise = np.polyfit(x_m, deflection_m, 1)[0]
    if np.median(far) * force_N < 0.0 and rise * force_N < 0.0:
        raise InputError(
            f"the deflections (loaded less unloaded, {np.median(far):g} m near the load) run against the force",
            where=path,
            remedy="swap the two columns, or give the force the other sign",
        )


@dataclass(frozen=True, eq=False)
class _ErrorModels:
    """K weighted models of the readings' errors, with the covariance of the P least-squares parameters under each."""

    weights: np.ndarray  # (K,) probabilities, adding up to 1
    lengths_m: np.ndarray  # (K,) correlation length λ; 0 for plain scatter
    covariances: np.ndarray  # (K, P, P) of the least-squares estimate
    freedom: int  # N − P, degrees of freedom of every one of them

    @property
    def covariance(self) -> np.ndarray:
        """(P, P) weighted mean of the models' covariances."""
        return np.einsum("k,kij->ij", self.weights, self.covariances)

    @property
    def length_m(self) -> float:
        """Weighted median of the errors' correlation length."""
        order = np.argsort(self.lengths_m)
        at = int(np.searchsorted(np.cumsum(self.weights[order]), 0.5))
        return float(self.lengths_m[order[min(at, len(order) - 1)]])

    def half_width(self, direction: np.ndarray, other_std: float) -> float:
        """Half the 95 % interval of direction @ parameters, including an independent error of standard deviation
        `other_std`.

        direction : (P,). Student's t under every model, with Welch and Satterthwaite's degrees of freedom for the sum.
        """
        own = np.einsum("i,kij,j->k", direction, self.covariances, direction)
        scale = np.sqrt(own + other_std**2)
        if not scale.any():
            return 0.0
        freedom = self.freedom * (scale**2 / np.maximum(own, 1e-30 * scale.max() ** 2)) ** 2
        tail = 0.5 + 0.5 * 0.95

        def excess(half: float) -> float:
            return float(self.weights @ stdtr(freedom, half / scale)) - tail

        widest = float(scale.max() * stdtrit(self.freedom, tail))
        return float(brentq(excess, 0.0, widest * (1.0 + 1e-9)))


def _error_models(x_m: np.ndarray, design: np.ndarray, residuals_m: np.ndarray, least_std_m: float) -> _ErrorModels:
    """Error models weighted by their restricted likelihood, from the residuals (N,) of least squares with the design
    (N, P), N > P. least_std_m : lower bound of the readings' standard deviation. The correlation length λ runs
    log-uniformly from half the typical spacing to the span of x (N,), beyond which the parameters absorb it."""
    count, parameters = design.shape
    inverse = np.linalg.pinv(design)
    lengths = np.geomspace(0.5 * np.median(np.diff(x_m)), np.ptp(x_m), AntennaSettings.correlation_lengths).repeat(
        len(AntennaSettings.plain_shares)
    )
    priors = np.full(1 + len(lengths), (1.0 - AntennaSettings.plain_only) / len(lengths))
    priors[0] = AntennaSettings.plain_only
    apart = np.abs(x_m[:, None] - x_m)
    # 1e-9: places that all but coincide must not make it singular
    correlations = [np.eye(count)] + [
        (1.0 - share) * np.exp(-apart / length) + (share + 1e-9) * np.eye(count)
        for length, share in zip(
            lengths, AntennaSettings.plain_shares * AntennaSettings.correlation_lengths, strict=True
        )
    ]
    weighed = [_weigh(correlation, design, residuals_m, inverse, least_std_m) for correlation in correlations]
    log_weights = np.log(priors) + [log_weight for log_weight, _ in weighed]
    weights = np.exp(log_weights - log_weights.max())
    covariances = np.array([covariance for _, covariance in weighed])
    return _ErrorModels(weights / weights.sum(), np.append(0.0, lengths), covariances, count - parameters)


def _neighbour_correlation(residuals: np.ndarray) -> float:
    """Correlation of neighbouring residuals; 0 without any."""
    square = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / square if square > 0.0 else 0.0


def _weigh(
    correlation: np.ndarray, design: np.ndarray, residuals_m: np.ndarray, inverse: np.ndarray, least_std_m: float
) -> tuple[float, np.ndarray]:
    """Restricted log-likelihood of one error model, with the scale integrated out, and the estimate's covariance (P,
    P) under it."""
    lower = np.linalg.cholesky(correlation)
    weighted = cho_solve((lower, True), design)
    normal = design.T @ weighted
    remainder = residuals_m - design @ np.linalg.solve(normal, weighted.T @ residuals_m)
    freedom = len(residuals_m) - design.shape[1]
    variance = float(remainder @ cho_solve((lower, True), remainder)) / freedom
    variance = max(variance, least_std_m**2, np.finfo(float).tiny)
    log_weight = -np.log(lower.diagonal()).sum() - 0.5 * np.linalg.slogdet(normal)[1] - 0.5 * freedom * np.log(variance)
    return float(log_weight), variance * inverse @ correlation @ inverse.T


def _robust_line(regressor: np.ndarray, y: np.ndarray, offset: bool) -> tuple[float, float]:
    """(slope, intercept) of y (N,) over the regressor (N,) by least median of squares over the lines through two
    readings (or one and the origin), at most 780; intercept 0 if fixed."""
    anchors = spread_evenly(len(y), AntennaSettings.anchors)
    apart = 0.2 * np.ptp(regressor)
    if offset:
        pairs = np.array([p for p in combinations(anchors, 2) if abs(regressor[p[0]] - regressor[p[1]]) > apart])
        slopes = np.diff(y[pairs])[:, 0] / np.diff(regressor[pairs])[:, 0]
        intercepts = y[pairs[:, 0]] - slopes * regressor[pairs[:, 0]]
    else:
        anchors = anchors[np.abs(regressor[anchors]) > 0.2 * np.abs(regressor).max()]
        slopes = y[anchors] / regressor[anchors]
        intercepts = np.zeros_like(slopes)
    misses = np.median(np.abs(y - slopes[:, None] * regressor - intercepts[:, None]), axis=1)
    best = int(np.argmin(misses))
    return float(slopes[best]), float(intercepts[best])


def _outlying(residuals: np.ndarray, least_std: float) -> np.ndarray:
    """(N,) mask of the outliers among a robust fit's residuals, in the order of x; none among fewer than 8. least_std
    : lower bound of their scatter, because rounded readings may agree too well."""
    if len(residuals) < AntennaSettings.fewest_readings:
        return np.zeros(len(residuals), bool)
    index = np.arange(len(residuals))
    first = np.clip(index - 2, 0, len(residuals) - 5)
    # the four nearest in order, two on either side where there are two
    near = first[:, None] + np.arange(4)
    around = residuals - np.median(residuals[near + (near >= index[:, None])], axis=1)
    return _far(residuals, least_std) & _far(around, least_std)


def _far(values: np.ndarray, least_std: float) -> np.ndarray:
    scale = max(mad_std(values), least_std)
    return np.abs(values) > AntennaSettings.outlying * scale


Forward = Callable[[float], np.ndarray]  # EI in N·m² → deflections (N,) in m at the readings


def _beam(x_m: np.ndarray, force_N: float, distance_m: float) -> Forward:
    """Function of EI that gives the small-angle deflections (N,) m at places x (N,)."""
    return lambda stiffness: linear.deflection(x_m, distance_m, force_N, stiffness)


def _elastica(x_m: np.ndarray, force_N: float, distance_m: float) -> Forward:
    """Function of EI that gives large deflections (N,) m under a hanging weight, at places x (N,) on the undeflected
    rod's axis; NaN where the bent rod no longer reaches a reading."""

    def deflections(stiffness: float) -> np.ndarray:
        shape = planar_elastica_dead(np.linspace(0.0, 1.0, 201) * distance_m, distance_m, force_N, stiffness)
        x, w, theta = shape.x_m[0], shape.w_m[0], shape.theta_rad[0]
        if not np.all(np.diff(x) > 0.0):
            return np.full(len(x_m), np.nan)
        # beyond the load the rod is straight
        beyond = w[-1] + np.tan(theta[-1]) * (x_m - x[-1])
        return np.where(x_m <= x[-1], CubicHermiteSpline(x, w, np.tan(theta))(x_m), beyond)

    return deflections


def _least_squares(
    forward: Forward,
    x_m: np.ndarray,
    deflection_m: np.ndarray,
    start_Nm2: float,
    *,
    offset: bool,
    turning: bool = False,
) -> tuple[float, float, float, np.ndarray]:
    """EI, offset, clamp rotation and design matrix (N, P) at the least-squares minimum, in terms of the compliance, as
    the beam is linear in it. All arrays (N,). Raises SolveError when it does not converge, as where a
    clamp rotation explains all of the deflection."""
    share = 1e-4  # of the compliance, in central differences
    extra = [column for free, column in ((offset, np.ones_like(x_m)), (turning, x_m)) if free]

    def evaluate(at: np.ndarray) -> Linearised | None:
        if at[0] <= 0.0:
            return None
        stiffness = start_Nm2 / at[0]
        softer, stiffer = forward(stiffness / (1.0 + share)), forward(stiffness / (1.0 - share))
        jacobian = np.stack([(softer - stiffer) / (2.0 * share * at[0]), *extra], axis=1)
        found = Linearised(at, forward(stiffness) + jacobian[:, 1:] @ at[1:] - deflection_m, jacobian, 0, loss=SQUARES)
        return found if found.is_finite else None

    start = evaluate(np.eye(1, 1 + len(extra))[0])
    # a step of 1e-10 of the deflection, or one whose gain is lost in the rounding of the cost
    least = 0.5e-20 * float(deflection_m @ deflection_m)
    rules = Rules(60, tolerance=1e-15, standstill=least, takes_last=True, may_rise_share=1e-12)
    found, promise, _ = (start, np.inf, True) if start is None else minimise(evaluate, start, rules)
    if found is None or promise > rules.standstill + rules.tolerance * found.cost:
        raise SolveError(
            "the fit of EI does not converge: the readings are not those of one rod in a clamp; check force, distance "
            "and the table's columns"
        )
    compliance, *others = found.parameters.tolist()
    design = found.jacobian * np.append(compliance, np.ones(len(extra)))
    return start_Nm2 / compliance, others[0] if offset else 0.0, others[-1] if turning else 0.0, design


def _slope_at(model: str, force_N: float, distance_m: float, stiffness_Nm2: float) -> float:
    """Absolute slope dy/dx of the rod at the load, by the "linear" or the "elastica" model."""
    if model == "linear":
        return float(linear.slope(distance_m, distance_m, abs(force_N), stiffness_Nm2))
    shape = planar_elastica_dead(np.array([distance_m]), distance_m, abs(force_N), stiffness_Nm2)
    return float(np.tan(shape.theta_rad[0, 0]))


@dataclass(frozen=True)
class BeamFit:
    """EI under one set of assumptions; offset and clamp rotation are 0 where fixed."""

    stiffness_Nm2: float
    std_Nm2: float
    offset_m: float
    offset_std_m: float
    clamp_rotation_rad: float
    rms_m: float


@dataclass(frozen=True, eq=False)
class StiffnessSolution:
    """EI of a rod, with the evidence for it."""

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
    other_offset: BeamFit  # the fit with the offset fixed where `fit` has it free, and free where fixed
    free_clamp: BeamFit | None  # with a clamp free to turn; None where it does not converge


def solve_stiffness(
    table: DeflectionTable, *, offset: bool = True, clamp_share_std: float = AntennaSettings.clamp_share_std
) -> StiffnessSolution:
    """EI of the rod of a table.

    `offset` False fixes the gauge's offset at zero: right only where the gauge was read at the clamp and showed 0.

    Raises
    ------
    InputError : force or distance impossible, or no bending that stands out from the scatter.
    SolveError : the fit does not converge.
    """
    _check_load(table.force_N, table.distance_m)
    compliance, _ = _robust_line(table.forward("linear")(1.0), table.deflection_m, offset)
    if compliance <= 0.0:
        raise _no_bending()
    chosen = table.screened("linear", 1.0 / compliance, offset)
    clamp = chosen.clamp_effect(clamp_share_std)
    fit, errors, half = chosen.judged(clamp)
    slope, bias = chosen.linear_error()
    relative = fit.std_Nm2 / fit.stiffness_Nm2
    steep, biased = (
        slope > AntennaSettings.steep_rad,
        abs(bias) > max(AntennaSettings.bias_share * relative, AntennaSettings.least_bias),
    )
    reason = "large deflection" if steep else "the small-angle formula would bias EI" if biased else "small deflection"
    reason += f": slope {slope:.3g} at the load, small-angle formula off by {100 * bias:+.2g} % of EI against a "
    reason += f"standard deviation of {100 * relative:.2g} %"
    if steep or biased:
        # the beam's outliers may be the elastica's shape, so they are looked for anew at its own EI
        start = table.fitted("elastica", chosen.kept, chosen.stiffness_Nm2, offset)
        chosen = table.screened("elastica", start.stiffness_Nm2, offset)
        slope, bias = chosen.linear_error()
        clamp = chosen.clamp_effect(clamp_share_std)
        fit, errors, half = chosen.judged(clamp)
    if half >= 1.0:
        raise _no_bending()
    residuals = table.deflection_m - table.forward(chosen.model)(fit.stiffness_Nm2) - fit.offset_m
    kept, inverse = residuals[chosen.kept], np.linalg.pinv(chosen.design)[0]
    plain = float(kept @ kept) / errors.freedom * float(inverse @ inverse)
    free_clamp = None
    if chosen.kept.sum() > chosen.design.shape[1] + 1:
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
        correlation=_neighbour_correlation(kept),
        correlation_length_m=errors.length_m,
        effective_readings=len(kept) * min(plain / float(errors.covariance[0, 0]), 1.0),
        clamp_share_std=clamp_share_std,
        clamp_std_Nm2=clamp * fit.stiffness_Nm2,
        offset_free=offset,
        other_offset=chosen.refitted(not offset).judged(clamp)[0],
        free_clamp=free_clamp,
    )


@dataclass(frozen=True, eq=False)
class _RodFit:
    """A model fitted to the readings (N,) that are not outliers."""

    table: DeflectionTable
    model: str
    kept: np.ndarray
    offset: bool
    stiffness_Nm2: float
    offset_m: float
    clamp_rotation_rad: float
    design: np.ndarray  # (N, P) derivatives by ln(1/EI), offset and clamp rotation, the last two only if free

    def refitted(self, offset: bool, turning: bool = False) -> _RodFit:
        """Fits the same model to the same readings under other assumptions."""
        return self.table.fitted(self.model, self.kept, self.stiffness_Nm2, offset, turning)

    def judged(self, clamp: float) -> tuple[BeamFit, _ErrorModels, float]:
        """Standard deviations of the estimate, the error models that give them, and half the relative interval of
        1/EI."""
        table = self.table
        x = table.x_m[self.kept]
        model = self.table.forward(self.model, self.kept)(self.stiffness_Nm2)
        residuals = table.deflection_m[self.kept] - (model + self.offset_m + self.clamp_rotation_rad * x)
        errors = _error_models(x, self.design, residuals, self.table.least_std_m)
        covariance = errors.covariance
        fit = BeamFit(
            self.stiffness_Nm2,
            self.stiffness_Nm2 * float(np.hypot(np.sqrt(covariance[0, 0]), clamp)),
            self.offset_m,
            float(np.sqrt(covariance[1, 1])) if self.offset else 0.0,
            self.clamp_rotation_rad,
            float(np.sqrt(np.mean(residuals**2))),
        )
        return fit, errors, errors.half_width(np.eye(len(covariance))[0], clamp)

    def _slope_at_load(self) -> float:
        return _slope_at(self.model, self.table.force_N, self.table.distance_m, self.stiffness_Nm2)

    def clamp_effect(self, share_std: float) -> float:
        """Relative standard deviation of EI due to the prior of the clamp's rotation."""
        leak = np.linalg.lstsq(self.design, self.table.x_m[self.kept], rcond=None)[0][0]
        return abs(float(leak)) * share_std * self._slope_at_load()

    def linear_error(self) -> tuple[float, float]:
        """Slope at the load, and the relative error of EI by the small-angle formula if the rod is an elastica."""
        forwards = (self.table.forward(model, self.kept) for model in ("linear", "elastica"))
        straight, bent = (forward(self.stiffness_Nm2) for forward in forwards)
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
