"""The questions of a check, their answers, and the sizes from which a change is a warning or a failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vbaa_calib.core.robust import chi_limit

from .settings import CheckSettings

HOLDS = "holds"  # levels of an answer, the best first
LOOK = "look at"  # a warning
FAILS = "does not hold"  # the rig must not be used
UNANSWERED = "not given"  # the data leave the question open

# by the key in check.json
_QUESTIONS = {
    "plane_c": "How well is a point on plane C known?",
    "lens_region": "Does every pixel have one ray?",
    "stiffness_known": "Is EI known, and plausible?",
    "sensor_known": "Is the moment sensor known?",
    "planar_ambiguity": "Could the board in the jig have been read the other way round?",
    "doubts": "Did the calibration give warnings?",
    "lens_fit": "Do the pictures of the board fit the lens?",
    "lens_focus": "Is the focus unchanged?",
    "camera_pose": "Is the camera where it was?",
    "free_antenna": "Is the free antenna where the rig predicts it?",
    "stiffness": "Does the antenna bend as EI predicts?",
    "sensor_offset": "Does the moment sensor read zero without a load?",
    "sensor_gain": "Does the moment sensor read the loads as before?",
}


@dataclass(frozen=True)
class Discrepancy:
    """A difference between prediction and observation."""

    distance_std: float  # its Mahalanobis length, in standard deviations of the predicted difference
    freedom: int  # its degrees of freedom
    size: float  # its consequence, in `unit`
    floor: float  # largest size without consequence, in `unit`
    unit: str

    @property
    def limits_std(self) -> tuple[float, float]:
        """Distances from which the level is `LOOK` and `FAILS`."""
        look, fail = (
            chi_limit(chance, self.freedom) for chance in (CheckSettings.look_chance, CheckSettings.fail_chance)
        )
        return look, fail

    @property
    def level(self) -> str:
        """`HOLDS`, `LOOK` or `FAILS`."""
        look, fail = self.limits_std
        if self.distance_std <= look or self.size <= self.floor:
            return HOLDS
        return FAILS if self.distance_std > fail and self.size > CheckSettings.fail_floors * self.floor else LOOK

    def to_dict(self) -> dict[str, Any]:
        """The entry of check.json."""
        look, fail = self.limits_std
        return {**asdict(self), "look_from_std": look, "fails_from_std": fail}


@dataclass(frozen=True)
class Finding:
    """The answer to one question."""

    name: str  # its key in check.json
    level: str  # `HOLDS`, `LOOK`, `FAILS` or `UNANSWERED`
    words: str  # the answer, with numbers
    remedy: str | None = None  # what to do
    evidence: Discrepancy | None = None  # the difference behind it

    @property
    def is_bad(self) -> bool:
        """Whether the answer calls for an action: `LOOK` or `FAILS`."""
        return self.level in (LOOK, FAILS)

    @property
    def question(self) -> str:
        """The question in words."""
        return _QUESTIONS[self.name]

    def to_dict(self) -> dict[str, Any]:
        """The entry of check.json."""
        evidence = None if self.evidence is None else self.evidence.to_dict()
        return {**vars(self), "question": self.question, "evidence": evidence}


def judged(name: str, words: str, remedy: str, evidence: Discrepancy) -> Finding:
    """A finding graded by its evidence; with the remedy unless it is `HOLDS`."""
    return Finding(name, evidence.level, words, None if evidence.level == HOLDS else remedy, evidence)


def unanswered(name: str, why: str) -> Finding:
    """A finding for a question that the data leave open, with the reason."""
    return Finding(name, UNANSWERED, why)


def worst(findings: Sequence[Finding]) -> str:
    """The worst level of the answered questions; `UNANSWERED` where none is answered."""
    levels = (HOLDS, LOOK, FAILS)
    answered = [finding.level for finding in findings if finding.level in levels]
    return max(answered, key=levels.index, default=UNANSWERED)


def plus_minus(value: float, std: float) -> str:
    """A signed number and its standard deviation, with two digits of the latter."""
    digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 9)) if std > 0 else 3
    return f"{value:+.{digits}f} ± {std:.{digits}f}"
