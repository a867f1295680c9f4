"""The rig as the free antenna alone shows it: nothing that was typed for a load can have moved it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...antenna.shape import Curves
from ...errors import SolveError
from ...geometry import Pose
from ...reprojection import SeenPoints, image_curves, see, whitened_residuals
from ...session import Load
from ..joint import JointSolution, solve_joint
from ..joint_problem import ANTENNA, Observation, Prior

DEAF = 1e6
"""Factor on the moment sensor's noise that leaves it out of a solve."""
MOST_BENT = 6.0
"""f·l²/EI beyond which an antenna hangs along its load: more looks the same."""


@dataclass(frozen=True, eq=False)
class Faithful:
    """How well readings of one load's row reproduce its picture.

    Attributes
    ----------
    misfit : (V,) mean distance of the points from the predicted antenna, over that from the free one.
    shown_std : mean distance of the points from the free antenna, in the points' own deviations.
    """

    misfit: np.ndarray
    shown_std: float


def solve_free(observations: Sequence[Observation], before: Prior, length_m: float, std_Nm: float) -> JointSolution:
    """The solve of the no-load frames alone, the moment sensor left out: it may be what is wrong.

    Raises SolveError when there are none, or it does not converge.
    """
    free = [one for one in observations if not isinstance(one.still, Load)]
    if not free:
        raise SolveError("there is no no-load frame")
    return solve_joint(free, before, length_m, DEAF * std_Nm)


def faithful(free: JointSolution, observation: Observation, loads: Sequence[Load]) -> Faithful:
    """Which of V readings of a load looks like its picture, the rig being what the free antenna says."""
    problem, parameters = free.problem, free.solution.parameters
    seen = see(problem.camera(parameters), observation.points_px, observation.sigma_px)
    stiffness = float(np.exp(parameters[ANTENNA][6]))
    nothing = replace(loads[0], force_y_N=0.0, force_z_N=0.0)
    possible = np.array([_bends(load, stiffness) < MOST_BENT for load in loads])
    # what would wind the antenna up is no reading of it, and is not worked out
    stills = [replace(observation, still=load if fits else nothing) for load, fits in zip(loads, possible, strict=True)]
    stills = [replace(observation, still=nothing), *stills]
    curves = replace(problem, observations=stills).curves(parameters[None, ANTENNA])
    view = problem.pose(parameters).inverse()
    distances = np.array([_distance(seen, curves, index, view) for index in range(len(stills))])
    distances[1:][~possible] = np.inf
    return Faithful(distances[1:] / max(distances[0], problem.noise_scale), distances[0] / problem.noise_scale)


def _bends(load: Load, stiffness_Nm2: float) -> float:
    """The elastica's dimensionless load, f·l²/EI: twice the linear beam's slope at the load."""
    return float(np.hypot(load.force_y_N, load.force_z_N)) * load.distance_m**2 / stiffness_Nm2


def _distance(seen: SeenPoints, curves: Curves, index: int, T_camera_antenna: Pose) -> float:
    one = curves.picked(np.array([index]))
    image = image_curves(one, T_camera_antenna)
    if not np.isfinite(image.nodes).all():
        return np.inf
    return float(np.abs(whitened_residuals(seen, image)[:, 0]).mean())
