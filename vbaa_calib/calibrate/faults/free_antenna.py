"""How well an explanation fits: the scatter that it leaves, beside the scatter that the pictures have anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution, noise_scale, solve_joint
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.core.errors import SolveError
from vbaa_calib.core.robust import huber_weights, mad_std
from vbaa_calib.geometry import Pose
from vbaa_calib.rig.reprojection import SeenPoints, image_curves, see, whitened_residuals
from vbaa_calib.session import Load

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


DEGREE = 7
"""Of the smooth curve that any bent antenna is in the picture."""
FITS = 1.5
"""An explanation fits that leaves no more than this much of the pictures' own scatter."""
ROUNDS, PLAIN, SETTLED = 10, 4, 0.02
"""Of a solve: so many, the first ones by plain squares, the others until the scatter falls by less than this part."""


def own_scatter(observations: Sequence[Observation]) -> float:
    """Scatter of the points about a smooth curve of their own picture's, over their claimed deviations; no model in it.

    At least 0.2, as the joint solve's has it.
    """
    left = [_off_smooth(one) for one in observations if len(one.points_px) > 2 * DEGREE]
    return max(mad_std(np.concatenate(left)), 0.2) if left else 0.2


def fits(left: float, own: float) -> bool:
    """Whether a scatter that is left is the pictures' own."""
    return bool(left <= FITS * own)


def worst_still(joint: JointSolution) -> float:
    """Scatter of the points of the still that fits worst, over their claimed deviations."""
    return float(joint.point_rms.max() * joint.noise_scale)


def scatter_with_step(joint: JointSolution, which: Sequence[int], after: Sequence[int], prior_std: float) -> float:
    """The points' scatter, over their claimed deviations, with parameters that differ from some still on.

    Solved anew, for these parameters and all others, the moment sensor left out: it may be what is wrong.

    Parameters
    ----------
    which : of the parameters. after : indices of the stills from the change on.
    prior_std : of the changes, about 0.
    """
    problem = joint.problem
    everything = np.ones_like(problem.kept)
    problem = replace(problem, kept=everything, noise_scale=1.0, moment_std_Nm=DEAF * problem.moment_std_Nm)
    ends = np.cumsum([0, *map(len, problem.seen_at_lens)])
    later = np.zeros(ends[-1] + len(ends) - 1 + problem.certain, bool)
    for index in after:
        later[ends[index] : ends[index + 1]] = True
        later[ends[-1] + index] = True
    spans = [slice(a, b) for a, b in pairwise(ends)]
    parameters, change = joint.solution.parameters, np.zeros(len(which))
    least, certain = np.inf, problem.certain
    for turn in range(ROUNDS):
        moved = parameters.copy()
        moved[list(which)] += change
        (before, slopes), (beyond, other) = problem.residuals(parameters), problem.residuals(moved)
        residuals = np.where(later, beyond, before)
        jacobian = np.where(later[:, None], other, slopes)
        jacobian = np.hstack([jacobian, np.where(later[:, None], other[:, list(which)], 0.0)])
        scale = noise_scale([residuals[span] for span in spans])
        if scale > (1 - SETTLED) * least and turn > PLAIN:
            break
        least = min(least, scale)
        # at first none of the points counts as false: whole stills are far off
        robust = (
            np.sqrt(huber_weights(residuals[:-certain] / scale)) if turn >= PLAIN else np.ones(len(residuals) - certain)
        )
        weights = np.concatenate([robust / scale, np.ones(certain)])
        size = np.linalg.norm(jacobian, axis=0)
        scaled = jacobian / size * weights[:, None]
        known = np.concatenate([np.zeros(len(parameters)), np.full(len(which), prior_std**-2)])
        slope = scaled.T @ (residuals * weights) + known * np.concatenate([0 * parameters, change]) / size
        step = -np.linalg.solve(scaled.T @ scaled + np.diag(known / size**2), slope) / size
        parameters, change = parameters + step[: len(parameters)], change + step[len(parameters) :]
    return min(scale, least)


def _off_smooth(one: Observation) -> np.ndarray:
    """(N,) distances from the smooth curve, in claimed deviations."""
    centred = one.points_px - one.points_px.mean(axis=0)
    along, aside = (centred @ np.linalg.svd(centred, full_matrices=False)[2].T).T
    smooth = np.polynomial.Polynomial.fit(along, aside, DEGREE)
    slope = smooth.deriv()(along)
    freedom = np.sqrt(len(along) / (len(along) - DEGREE - 1))
    return freedom * (aside - smooth(along)) / np.hypot(1.0, slope) / one.sigma_px
