"""Repeated calibrations of one rig: for each parameter, whether it is constant, scatters more than its stated
uncertainty, or drifts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, t

from .parts import RIG_PARAMETERS
from .rig import Rig

FALSE_ALARM = 0.01  # that a parameter that stays is said to scatter or drift; of all together
FEWEST_FOR_TREND = 4


@dataclass(frozen=True, eq=False)
class OverTime:
    """P parameters of a rig in N calibrations."""

    names: tuple[str, ...]  # the lens' where all calibrations have the same model
    days: np.ndarray  # (N,) since the first calibration
    values: np.ndarray  # (N, P) how far each parameter is from what it was at first
    std: np.ndarray  # (N, P)
    mean: np.ndarray  # (P,) weighted by the variances of measurement and change
    between_std: np.ndarray  # (P,) variation from one calibration to the next, beyond what they state
    slope_per_day: np.ndarray  # (P,) NaN with fewer than `FEWEST_FOR_TREND` calibrations
    slope_std_per_day: np.ndarray  # (P,)
    scatters: np.ndarray  # (P,) bool, beyond what chance gives (`FALSE_ALARM`)
    drifts: np.ndarray  # (P,) bool, likewise
    supposed_std: np.ndarray  # (P,) by which the drift in rig.json lets it change


def over_time(rigs: Sequence[Rig], days: Sequence[float]) -> OverTime:
    """Comparison of two or more calibrations, in order of their days since the first. A parameter without uncertainty
    scatters as soon as its values differ at all."""
    steps = [rig.step_from(rigs[0]) for rig in rigs]
    size = min(map(len, steps))
    values = np.array([step[:size] for step in steps])
    std = np.array([parameter_std(rig)[:size] for rig in rigs])
    names = (*RIG_PARAMETERS, *rigs[0].camera.parameter_names)[:size]
    at = np.asarray(days, float)
    count, limit = len(rigs), FALSE_ALARM / size
    mean, between, slope, slope_std = (np.full(size, np.nan) for _ in range(4))
    scatters, drifts = np.zeros((2, size), bool)
    for index in range(size):
        x, own = values[:, index], std[:, index]
        if not (own > 0.0).all():
            mean[index], between[index] = x.mean(), x.std(ddof=1)
            scatters[index] = bool(x.any())
            continue
        constant = np.ones((count, 1))
        chi_square, _ = _misfit(x, own, constant)
        scatters[index] = chi_square > chi2.isf(limit, count - 1)
        between[index], (mean[index],), _ = _fitted(x, own, constant)
        if count >= FEWEST_FOR_TREND and np.ptp(at) > 0.0:
            line = np.column_stack([np.ones(count), at - at.mean()])
            _, (_, slope[index]), deviations = _fitted(x, own, line)
            slope_std[index] = deviations[1]
            drifts[index] = abs(slope[index]) > t.isf(limit / 2, count - 2) * slope_std[index]
    wide = rigs[0].drifted().covariance
    supposed = np.sqrt(np.clip(np.diag(wide)[:size] - std[0, : len(wide)] ** 2, 0.0, None))
    supposed = np.concatenate([supposed, np.zeros(size - len(supposed))])
    return OverTime(names, at, values, std, mean, between, slope, slope_std, scatters, drifts, supposed)


def parameter_std(rig: Rig) -> np.ndarray:
    """(17 + P,) standard deviations of the rig's parameters and the lens's; 0 for exact ones."""
    return np.sqrt(np.diag(rig.joint_covariance))


def _misfit(x: np.ndarray, std: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray]:
    """χ² about the best linear combination of columns (N, K), and its leverages (N,)."""
    scaled = columns / std[:, None]
    basis, _ = np.linalg.qr(scaled)
    rest = x / std - basis @ (basis.T @ (x / std))
    return float(rest @ rest), (basis**2).sum(axis=1)


def _fitted(x: np.ndarray, std: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Standard deviation of the changes between calibrations (DerSimonian and Laird), and with it the best
    coefficients (K,) of the columns and their standard deviations (K,)."""
    chi_square, leverage = _misfit(x, std, columns)
    weight = std**-2
    excess = chi_square - (len(x) - columns.shape[1])
    between = max(excess / float((weight * (1.0 - leverage)).sum()), 0.0) if excess > 0.0 else 0.0
    scaled = columns / np.sqrt(std**2 + between)[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled)
    best = covariance @ scaled.T @ (x / np.sqrt(std**2 + between))
    return float(np.sqrt(between)), best, np.sqrt(np.diag(covariance))
