"""Pose fusion: whether camera poses by several methods agree within their uncertainty, and their weighted mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from vbaa_calib.core.errors import InputError
from vbaa_calib.core.robust import chi_square, chi_square_p
from vbaa_calib.geometry import Pose

from .settings import PoseSettings


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The camera's pose in the antenna frame by one method; `way` is its name, as reports print it.

    Attributes
    ----------
    covariance : (6, 6) of `Pose.retract`'s tangent (rotation vector rad, translation m) in the antenna frame, the lens
        fixed.
    lens_sensitivity : (6, 4 + k) derivative S of that tangent by the camera's (fx, fy, cx, cy, distortion). With the
        lens' covariance C the whole covariance is `covariance + S C Sᵀ`.
    common : (6, K) the part of it, `common @ common.T`, that estimates of further cameras by the same method share,
        error by error; none where that is not known.
    """

    way: str
    T_antenna_camera: Pose
    covariance: np.ndarray
    lens_sensitivity: np.ndarray
    common: np.ndarray = field(default_factory=lambda: np.zeros((6, 0)))


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference of two pose estimates, identified by their names.

    step : (6,) from the first pose to the second, `Pose.retract`'s tangent. covariance : (6, 6) of it.
    """

    ways: tuple[str, str]
    step: np.ndarray
    covariance: np.ndarray

    @property
    def statistic(self) -> float:
        """χ² of the difference, with 6 degrees of freedom if both estimates are right."""
        return chi_square(self.step, self.covariance)

    @property
    def p_value(self) -> float:
        """Probability of so large a difference if both estimates are right."""
        return chi_square_p(self.statistic, 6)

    @property
    def agrees(self) -> bool:
        """Whether the difference is within its uncertainty."""
        return self.p_value > PoseSettings.contradiction

    def __str__(self) -> str:
        turn, shift = 1e3 * np.linalg.norm(self.step[:3]), 1e3 * np.linalg.norm(self.step[3:])
        size = np.sqrt(self.statistic / 6)
        return f"{self.ways[0]} and {self.ways[1]} differ by {shift:.2f} mm and {turn:.2f} mrad, {size:.1f} std"

    def to_dict(self) -> dict[str, Any]:
        """The entry of rig.json."""
        return {
            "ways": list(self.ways),
            "shift_m": self.step[3:].tolist(),
            "turn_rad": self.step[:3].tolist(),
            "std": np.sqrt(np.diag(self.covariance)).tolist(),
            "p_value": self.p_value,
        }


def differences(ways: Sequence[PoseEstimate], lens_covariance: np.ndarray) -> list[Difference]:
    """Differences of every pair of estimates; lens errors (covariance (P, P)) that both share cancel."""
    found = []
    for one, other in combinations(ways, 2):
        covariance = one.covariance + other.covariance
        if len(lens_covariance):
            by_lens = other.lens_sensitivity - one.lens_sensitivity
            covariance = covariance + by_lens @ lens_covariance @ by_lens.T
        step = other.T_antenna_camera.tangent_from(one.T_antenna_camera)
        found.append(Difference((one.way, other.way), step, covariance))
    return found


def require_agreement(found: Sequence[Difference], where: object) -> None:
    """Raises InputError when estimates contradict each other, naming the one that disagrees with all others, if any."""
    apart = [difference for difference in found if not difference.agrees]
    if not apart:
        return
    names = sorted({name for difference in found for name in difference.ways})
    alone = [name for name in names if all((name in one.ways) != one.agrees for one in found)]
    which = f"{alone[0]} disagrees with the others" if len(alone) == 1 and len(names) > 2 else "one of them is wrong"
    raise InputError(
        f"the ways to plane C contradict each other: {'; '.join(map(str, apart))}: {which}",
        where=where,
        remedy="measure it again, or give its uncertainty in session.yaml (jig.translation_std_m, "
        "jig.rotation_std_rad, over.height_std_m), or take its folder away",
    )


def fused(ways: Sequence[PoseEstimate]) -> Pose:
    """The weighted mean of all estimates with the lens fixed, from which bundle adjustment starts."""
    first = ways[0].T_antenna_camera
    weights = [np.linalg.inv(way.covariance) for way in ways]
    weighted = [weight @ way.T_antenna_camera.tangent_from(first) for weight, way in zip(weights, ways, strict=True)]
    return first.retract(np.linalg.solve(np.sum(weights, axis=0), np.sum(weighted, axis=0)))


def inflated(estimate: PoseEstimate, directions: np.ndarray, std: np.ndarray, common: bool = False) -> PoseEstimate:
    """The estimate with independent errors of standard deviations (K,) added along directions (K, 6) of its tangent.
    common : estimates of other cameras by the same method that share these errors."""
    spread = directions.T * std
    wider = replace(estimate, covariance=estimate.covariance + spread @ spread.T)
    return replace(wider, common=np.hstack([estimate.common, spread])) if common and estimate.common.size else wider
