"""A free antenna that is not straight: bowed all along."""

from __future__ import annotations

import numpy as np

from ...antenna.shape import PARAMETERS
from ...diagnosis import Diagnosis
from ..joint import JointSolution
from ..joint_problem import ANTENNA

USUAL = 3.0
"""Standard deviations of what a careful builder's wire has, beyond which a bow is said."""


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
