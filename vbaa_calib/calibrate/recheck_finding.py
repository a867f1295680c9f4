"""One question about a rig, and its answer: holds, look at, does not hold.

A difference counts when it is both improbable and large: beyond what the joint uncertainty predicts, and beyond a
practical floor below which nobody would notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

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
