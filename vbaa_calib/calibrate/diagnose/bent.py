"""A free antenna that is not straight: bowed all along, or kinked at one place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...antenna.shape import PARAMETERS, Curves
from ...diagnosis import Diagnosis
from ...reprojection import image_curves, whitened_residuals
from ..joint import JointSolution
from ..joint_problem import ANTENNA
from .rows import Further, StillRows, further
from .scatter import fits, scatter_after

USUAL = 3.0
"""Standard deviations of what a careful builder's wire has, beyond which a bow is said."""
KINK_RAD, KINK_SURE = 0.01, 60.0
"""Least kink worth a word, and its χ²."""
PLACES = np.linspace(0.1, 0.8, 8)
STEP_RAD = 1e-4


@dataclass(frozen=True, eq=False)
class Kink:
    """A sharp bend at an arc length, about y and about z."""

    at_m: float
    found: Further

    @property
    def angle_rad(self) -> float:
        """Its size."""
        return float(np.linalg.norm(self.found.values))


def kink_diagnosis(joint: JointSolution, rows: StillRows, own: float) -> Diagnosis | None:
    """A kink, where it explains what the pictures show.

    own : scatter of the points that no model explains, see `own_scatter`.
    """
    kink = sharpest_kink(rows)
    if kink is None or kink.angle_rad < KINK_RAD or kink.found.statistic < KINK_SURE:
        return None
    if not fits(scatter_after(rows, kinked(rows, kink.at_m), np.inf), own, joint.noise_scale):
        return None
    length = joint.problem.length_m
    tip_mm = 1e3 * kink.angle_rad * (length - kink.at_m)
    return Diagnosis(
        "antenna_kinked",
        f"the free antenna is kinked by {np.rad2deg(kink.angle_rad):.1f}° about {1e3 * kink.at_m:.0f} mm from the "
        f"clamp, {tip_mm:.1f} mm at the tip",
        "straighten or replace the wire: the model knows an even bow only",
        grave=tip_mm > 0.02e3 * length,
    )


def bow_diagnosis(joint: JointSolution) -> Diagnosis | None:
    """A bow beyond the ordinary."""
    length = joint.problem.length_m
    first = ANTENNA.start + PARAMETERS.index("bow_about_y_per_m")
    bow = joint.parameters[first : first + 2]
    std = np.sqrt(np.diag(joint.covariance)[first : first + 2])
    known = joint.problem.prior.std[first - 6 : first - 4]
    beyond = (np.abs(bow) > USUAL * known) & (np.abs(bow) > USUAL * std)
    if not beyond.any():
        return None
    size = float(np.linalg.norm(bow))
    return Diagnosis(
        "antenna_bent",
        f"the free antenna is bowed by {bow[0]:.2f} ± {std[0]:.2f} per m about y and {bow[1]:.2f} ± {std[1]:.2f} about "
        f"z: {0.5e3 * size * length**2:.0f} mm at the tip of {1e3 * length:.0f} mm",
        "straighten or replace the wire, or set it with its bow in plane C, and check gravity_world",
    )


def sharpest_kink(rows: StillRows) -> Kink | None:
    """The kink that explains most of what is left of the free antenna's pictures; None where none can be told."""
    found = []
    for part in PLACES:
        at_m = float(part) * rows.joint.problem.length_m
        change = further(rows, kinked(rows, at_m))
        if change is not None:
            found.append(Kink(at_m, change))
    return max(found, key=lambda kink: kink.found.statistic, default=None)


def kinked(rows: StillRows, at_m: float) -> np.ndarray:
    """(R, 2) columns of a kink about y and about z, of the same angles in every still."""
    problem, parameters = rows.joint.problem, rows.solution.parameters
    curves = problem.curves(parameters[None, ANTENNA])
    beyond = np.clip(curves.arclength_m - at_m, 0.0, None)
    along = STEP_RAD * np.stack([np.zeros_like(beyond), np.zeros_like(beyond), -beyond], axis=-1)
    aside = STEP_RAD * np.stack([np.zeros_like(beyond), beyond, np.zeros_like(beyond)], axis=-1)
    view = problem.pose(parameters).inverse()
    columns = np.zeros((len(rows.solution.residuals), 2))
    seen = problem.seen(parameters)
    for index, span in enumerate(rows.points):
        if rows.moments[index] < 0:
            continue
        one = curves.picked(np.array([index] * 3))
        moved = replace(
            one, points_m=one.points_m + np.stack([np.zeros_like(along[index]), along[index], aside[index]])
        )
        distances = whitened_residuals(seen[index], image_curves(_with_slopes(moved), view))
        columns[span] = (distances[:, 1:] - distances[:, :1]) / STEP_RAD / problem.noise_scale
    return columns


def _with_slopes(curves: Curves) -> Curves:
    """With tangents that follow from the points: a kink turns them."""
    slopes = np.stack([np.gradient(p, s, axis=0) for p, s in zip(curves.points_m, curves.arclength_m, strict=True)])
    return replace(curves, tangents=slopes)
