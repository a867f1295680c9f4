"""What new data say of a change in some of a rig's parameters, when the rig itself is known only so well.

The data are linear in the parameters' errors: r = J·(e + E·δ) + noise, e the rig's own error with the joint covariance
Σ, δ the change of the parameters that E picks. A = JᵀJ and s = Jᵀr (whitened by the noise) hold all that matters. With
W = A (I + Σ A)⁻¹, which needs no inverse of either, δ has the information EᵀWE and the score Eᵀ(I + A Σ)⁻¹ s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..rig import RIG_PARAMETERS, Rig

_SEEN = 1.0
"""Least information in a direction, in units of the scale given, for the data to have a say in it."""
_VAGUE, _LOOSE = 10.0, 100.0
"""Standard deviation, in the same units, of what the data do not show, and of what is let loose."""
_SURE_STD = 3.0


@dataclass(frozen=True, eq=False)
class Information:
    """Whitened data about P parameters: JᵀJ (P, P) and Jᵀr (P,). Two sets of data add up."""

    matrix: np.ndarray
    score: np.ndarray

    @staticmethod
    def of(jacobian: np.ndarray, residuals: np.ndarray, unknown: np.ndarray | None = None) -> Information:
        """From whitened derivatives (N, P) of the predictions and whitened residuals (N,), seen less predicted.

        unknown : (N, K) how the predictions move with K unknowns of these data alone, of unit deviation each.
        """
        if unknown is None:
            return Information(jacobian.T @ jacobian, jacobian.T @ residuals)
        both = unknown.T @ np.column_stack([jacobian, residuals])
        left = np.linalg.solve(np.eye(unknown.shape[1]) + unknown.T @ unknown, both)
        taken = both[:, :-1].T @ left
        return Information(jacobian.T @ jacobian - taken[:, :-1], jacobian.T @ residuals - taken[:, -1])

    @staticmethod
    def none(count: int) -> Information:
        """No data."""
        return Information(np.zeros((count, count)), np.zeros(count))

    def __add__(self, other: Information) -> Information:
        return Information(self.matrix + other.matrix, self.score + other.score)


@dataclass(frozen=True, eq=False)
class Change:
    """An estimated change of the parameters asked for.

    Attributes
    ----------
    step : (Q,), zero along directions that the data do not show.
    covariance : (Q, Q) of the predicted difference, rig and new data together; large along those directions.
    sure : (Q,) the step without those directions that are not beyond three of their standard deviations.
    distance_std : length of the step in standard deviations. freedom : directions that the data show.
    """

    step: np.ndarray
    covariance: np.ndarray
    sure: np.ndarray
    distance_std: float
    freedom: int

    @property
    def std(self) -> np.ndarray:
        """(Q,)."""
        return np.sqrt(np.diag(self.covariance).clip(0.0))


def estimated_change(
    information: Information,
    covariance: np.ndarray,
    wanted: np.ndarray,
    scale: np.ndarray,
    free: Sequence[int] = (),
) -> Change:
    """The change of the parameters with indices `wanted` (Q,), while those of `free` may be anything.

    Parameters
    ----------
    covariance : (P, P) of the rig's parameters.
    scale : (P,) a change of each parameter that would be worth knowing of. Directions in which the data do not even
        show that are left out.
    """
    # in units of the scale, so that metres and radians weigh alike
    matrix, score = information.matrix * np.outer(scale, scale), information.score * scale
    known_before = covariance / np.outer(scale, scale)
    known_before[list(free), list(free)] += _LOOSE**2
    spread = np.eye(len(covariance)) + matrix @ known_before
    weight, score = np.linalg.solve(spread, matrix), np.linalg.solve(spread, score)
    values, axes = np.linalg.eigh(weight[np.ix_(wanted, wanted)])
    seen, std = values > _SEEN, 1.0 / np.sqrt(np.maximum(values, _VAGUE**-2))
    along = np.where(seen, (axes.T @ score[wanted]) * std**2, 0.0)
    units = scale[wanted]
    return Change(
        step=(axes @ along) * units,
        covariance=(axes * std**2) @ axes.T * np.outer(units, units),
        sure=(axes @ np.where(np.abs(along) > _SURE_STD * std, along, 0.0)) * units,
        distance_std=float(np.linalg.norm(along / std)),
        freedom=int(seen.sum()),
    )


def joint_covariance(rig: Rig) -> np.ndarray:
    """(16 + P, 16 + P) of `RIG_PARAMETERS` and the lens, which stands by itself where the rig does not hold it."""
    if rig.with_lens:
        return rig.covariance
    count = len(RIG_PARAMETERS)
    whole = np.zeros((count + len(rig.camera.parameter_names),) * 2)
    whole[:count, :count] = rig.covariance
    if rig.camera.covariance is not None:
        whole[count:, count:] = rig.camera.covariance
    return whole
