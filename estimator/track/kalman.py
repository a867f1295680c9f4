"""Constant velocity with a random walk: filter, smoother and likelihood for paths in one to three dimensions."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

_DECADES = (-8.0, 4.0)
_TRIALS = 37
"""Trial intensities of the walk, about the one that would move the path by its own noise in its mean step."""
_WIDE = 1e6
"""The first velocity may be so many times what the path's whole way asks for."""


def smoothed(
    time_s: np.ndarray, values: np.ndarray, covariance: np.ndarray, walk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed values (P, D) and their covariances (P, D, D).

    Parameters
    ----------
    time_s : (P,) increasing. values : (P, D). covariance : (P, D, D) of their independent noise.
    walk : (D,) intensity of the velocity's random walk, unit²/s³.
    """
    count, size = values.shape
    means, covariances, ahead, ahead_covariances, moves = _filtered(time_s, values, covariance, walk)
    mean, spread = means[-1], covariances[-1]
    found, left = np.empty((count, size)), np.empty((count, size, size))
    found[-1], left[-1] = mean[:size], spread[:size, :size]
    for i in range(count - 2, -1, -1):
        gain = np.linalg.solve(ahead_covariances[i + 1], moves[i + 1] @ covariances[i]).T
        mean = means[i] + gain @ (mean - ahead[i + 1])
        spread = covariances[i] + gain @ (spread - ahead_covariances[i + 1]) @ gain.T
        found[i], left[i] = mean[:size], spread[:size, :size]
    return found, 0.5 * (left + np.swapaxes(left, 1, 2))


def _filtered(time_s: np.ndarray, values: np.ndarray, covariance: np.ndarray, walk: np.ndarray) -> tuple[list, ...]:
    """Means and covariances of place and velocity, after and before each value, and the moves between."""
    size = values.shape[1]
    unit, nothing = np.eye(size), np.zeros((size, size))
    span = max(float(time_s[-1] - time_s[0]), 1e-9)
    wide = ((np.ptp(values, axis=0) ** 2).sum() + np.trace(covariance, axis1=1, axis2=2).mean()) * 100.0
    mean = np.concatenate([values[0], np.zeros(size)])
    spread = np.block([[unit * wide, nothing], [nothing, unit * (wide * 100.0 / span**2)]])
    means, covariances, ahead, ahead_covariances, moves = [], [], [], [], []
    for i, value in enumerate(values):
        step = float(time_s[i] - time_s[i - 1]) if i else 0.0
        move = np.block([[unit, step * unit], [nothing, unit]])
        noise = np.diag(walk)
        added = np.block([[noise * step**3 / 3.0, noise * step**2 / 2.0], [noise * step**2 / 2.0, noise * step]])
        mean, spread = move @ mean, move @ spread @ move.T + added
        ahead.append(mean)
        ahead_covariances.append(spread)
        moves.append(move)
        gain = np.linalg.solve(spread[:size, :size] + covariance[i], spread[:size]).T
        kept = np.eye(2 * size)
        kept[:, :size] -= gain
        mean = mean + gain @ (value - mean[:size])
        spread = kept @ spread @ kept.T + gain @ covariance[i] @ gain.T
        means.append(mean)
        covariances.append(spread)
    return means, covariances, ahead, ahead_covariances, moves


def walk_of(time_s: np.ndarray, values: np.ndarray, variance: np.ndarray) -> float:
    """Intensity of the velocity's random walk in a path (P,) with noise of these variances (P,), unit²/s³.

    The mean over trial intensities, evenly on a logarithmic scale, under the likelihood. NaN where nothing can be said.
    """
    usable = np.isfinite(values).all() and np.isfinite(variance).all() and (variance > 0.0).all()
    if not usable or len(values) < 4 or not (np.diff(time_s) > 0.0).all():
        return np.nan
    step = float(np.diff(time_s).mean())
    trials = np.logspace(*_DECADES, _TRIALS) * (float(np.median(variance)) / step**3)
    log = _log_likelihoods(time_s - time_s[0], values - values.mean(), variance, trials)
    return float(np.exp(logsumexp(log + np.log(trials)) - logsumexp(log)))


def _log_likelihoods(time: np.ndarray, values: np.ndarray, variance: np.ndarray, trials: np.ndarray) -> np.ndarray:
    """(T,) of the trial intensities, one filter for all of them; the first two values only begin the path."""
    step = time[1] - time[0]
    place, speed = np.full(len(trials), values[1]), np.full(len(trials), (values[1] - values[0]) / step)
    pp = np.full(len(trials), variance[1])
    pv = np.full(len(trials), variance[1] / step)
    vv = (variance[0] + variance[1]) / step**2 + trials * step / 3.0
    log = np.zeros(len(trials))
    for i in range(2, len(values)):
        step = time[i] - time[i - 1]
        place = place + step * speed
        pp, pv, vv = (
            pp + 2.0 * step * pv + step**2 * vv + trials * step**3 / 3.0,
            pv + step * vv + trials * step**2 / 2.0,
            vv + trials * step,
        )
        total, off = pp + variance[i], values[i] - place
        log -= 0.5 * (off**2 / total + np.log(total))
        place, speed = place + pp / total * off, speed + pv / total * off
        pp, pv, vv = pp - pp * pp / total, pv - pp * pv / total, vv - pv * pv / total
    return log
