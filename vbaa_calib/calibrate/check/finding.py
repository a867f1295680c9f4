"""What new data say of a change in some of a rig's parameters, when the rig itself is known only so well.

The data are linear in the parameters' errors: r = J·(e + E·δ) + noise, e the rig's own error with the joint covariance
Σ, δ the change of the parameters that E picks. A = JᵀJ and s = Jᵀr (whitened by the noise) hold all that matters. With
W = A (I + Σ A)⁻¹, which needs no inverse of either, δ has the information EᵀWE and the score Eᵀ(I + A Σ)⁻¹ s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from vbaa_calib.rig import RIG_PARAMETERS, Rig

HOLDS, LOOK, FAILS, NOT_GIVEN = "holds", "look at", "does not hold", "not given"
LEVELS = (HOLDS, LOOK, FAILS)
LOOK_CHANCE, FAIL_CHANCE = 2.7e-3, 5.7e-7
"""How often a rig that is right goes beyond each limit: 3 and 5 standard deviations of one normal number."""
FAIL_FLOORS = 2.0
"""A difference that makes a rig fail is this many times the practical floor."""


@dataclass(frozen=True)
class Evidence:
    """A difference between what the rig predicts and what was seen.

    Attributes
    ----------
    distance_std : its length in standard deviations of the predicted difference (Mahalanobis).
    freedom : how many numbers it has.
    size, floor, unit : what it amounts to, and what would not matter.
    """

    distance_std: float
    freedom: int
    size: float
    floor: float
    unit: str

    @property
    def limits_std(self) -> tuple[float, float]:
        """From which distance on to look at it, and from which on it does not hold."""
        look, fail = (float(np.sqrt(chi2.isf(chance, self.freedom))) for chance in (LOOK_CHANCE, FAIL_CHANCE))
        return look, fail

    @property
    def level(self) -> str:
        """One of `LEVELS`."""
        look, fail = self.limits_std
        if self.distance_std <= look or self.size <= self.floor:
            return HOLDS
        return FAILS if self.distance_std > fail and self.size > FAIL_FLOORS * self.floor else LOOK

    def to_dict(self) -> dict[str, Any]:
        """For check.json."""
        look, fail = self.limits_std
        return {**asdict(self), "look_from_std": look, "fails_from_std": fail}


@dataclass(frozen=True)
class Finding:
    """The answer to one question.

    Attributes
    ----------
    name : its key in check.json. question : as a person would ask it. words : the answer, with numbers.
    level : one of `LEVELS`, or not given. remedy : what to do, where something is to be done.
    evidence : the difference behind it, where there is one.
    """

    name: str
    question: str
    level: str
    words: str
    remedy: str | None = None
    evidence: Evidence | None = None

    def to_dict(self) -> dict[str, Any]:
        """For check.json."""
        return {
            "name": self.name,
            "question": self.question,
            "level": self.level,
            "words": self.words,
            "remedy": self.remedy,
            "evidence": None if self.evidence is None else self.evidence.to_dict(),
        }


def plus_minus(value: float, std: float) -> str:
    """A signed number and its standard deviation, with two digits of the latter."""
    digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 9)) if std > 0 else 3
    return f"{value:+.{digits}f} ± {std:.{digits}f}"


def judged(name: str, question: str, words: str, remedy: str, evidence: Evidence) -> Finding:
    """A finding from its evidence; the remedy stands only where something is to be done."""
    level = evidence.level
    return Finding(name, question, level, words, None if level == HOLDS else remedy, evidence)


def not_given(name: str, question: str, why: str) -> Finding:
    """A question that the data leave open."""
    return Finding(name, question, NOT_GIVEN, why)


def worst(findings: Sequence[Finding]) -> str:
    """The overall level: the worst of those that were answered; not given where none was."""
    answered = [finding.level for finding in findings if finding.level in LEVELS]
    return max(answered, key=LEVELS.index, default=NOT_GIVEN)


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
