"""One least-squares solve of camera pose, antenna and moment sensor, from no-load frames and known loads.

Everything is solved together because everything is coupled: a tilted clamp looks like a tilted camera, a bowed wire
like a heavier one. What the pictures cannot tell apart is held by priors, and shows in the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..antenna.shape import bend
from ..camera import Camera
from ..errors import SolveError
from ..geometry import Pose
from ..reprojection import SeenPoints, image_curves, robust_cost, robust_weights, whitened_residuals
from ..rig import RIG_PARAMETERS, MomentSensor
from ..session import Load, Still

POSE, ANTENNA = slice(0, 6), slice(6, 14)
GAIN, OFFSET = 14, 15
STEPS = np.array([1e-5] * 3 + [1e-5] * 3 + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 2 + [1e-3] * 2)
"""Finite-difference steps of pose and antenna: small against the curvature of the model, large against its rounding."""
RUN = 10
"""Points in a run of neighbours: longer than the picture's noise is correlated, shorter than the shape."""
ITERATIONS, PASSES = 40, 10
SETTLED = 0.02
"""The passes end when the points' scatter changes by less than this part."""
FALSE_STILL = 3.0
"""A still whose points lie this many times further off than the median still's is left out."""
STANDSTILL = 1e-5
"""A step that promises less than this much of the cost is the last: a few thousandths of a standard deviation."""


@dataclass(frozen=True, eq=False)
class Observation:
    """One still of the antenna: what was seen, what was read, and the load on it, if any.

    Attributes
    ----------
    gravity_m_s2 : (3,) antenna frame.
    bright : whether the antenna is brighter than its background.
    """

    still: Still
    seen: SeenPoints
    gravity_m_s2: np.ndarray
    bright: bool = True

    @property
    def load_N(self) -> np.ndarray:
        """(2,) force components y, z."""
        return np.array([self.still.force_y_N, self.still.force_z_N]) if isinstance(self.still, Load) else np.zeros(2)


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before the stills: mean and standard deviation of `RIG_PARAMETERS` but the pose, and the pose."""

    T_antenna_camera: Pose
    pose_covariance: np.ndarray
    mean: np.ndarray
    std: np.ndarray


@dataclass(frozen=True, eq=False)
class JointSolution:
    """The solved rig.

    Attributes
    ----------
    parameters : (16,) `RIG_PARAMETERS`; the pose's six are steps from the prior pose.
    covariance : (16, 16), the pose's part about the solved pose.
    noise_scale : scatter of the centreline points about the model over what their own deviations predict.
    point_rms : (F,) per observation, in units of the scaled deviations.
    kept : (F,) whether the observation took part; others lie far off what the rest agree on.
    moment_residuals_Nm : (F,).
    """

    parameters: np.ndarray
    T_antenna_camera: Pose
    covariance: np.ndarray
    noise_scale: float
    point_rms: np.ndarray
    kept: np.ndarray
    moment_residuals_Nm: np.ndarray

    @property
    def sensor_gain_offset(self) -> tuple[float, float]:
        """Gain and offset (N·m) of the moment sensor."""
        return float(self.parameters[GAIN]), float(self.parameters[OFFSET])


@dataclass(frozen=True, eq=False)
class _Problem:
    observations: Sequence[Observation]
    camera: Camera
    prior: Prior
    length_m: float
    sensor: MomentSensor
    noise_scale: float
    kept: np.ndarray

    def evaluate(self, parameters: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Per observation (N, 1 + 14) whitened distances at the parameters and one step along each; (F, 9) moments."""
        antenna = np.repeat(parameters[None, ANTENNA], 9, axis=0)
        antenna[1:] += np.diag(STEPS[6:])
        poses = [self.prior.T_antenna_camera.retract(parameters[POSE])]
        poses += [poses[0].retract(step) for step in np.diag(STEPS[:6])]
        inverse = [pose.inverse() for pose in poses]
        count = len(self.observations)
        contact = [
            obs.still.distance_m if isinstance(obs.still, Load) else 0.5 * self.length_m for obs in self.observations
        ]
        curves = bend(
            np.tile(antenna, (count, 1)),
            self.length_m,
            np.repeat([obs.gravity_m_s2 for obs in self.observations], 9, axis=0),
            np.repeat(contact, 9),
            np.repeat([obs.load_N for obs in self.observations], 9, axis=0),
            dead=True,
            sweeps=4,
        )
        order = np.array([0] * 7 + list(range(1, 9)))
        views = [*inverse, *[inverse[0]] * 8]
        distances = []
        for index, observation in enumerate(self.observations):
            own = curves.picked(9 * index + order)
            distances.append(whitened_residuals(observation.seen, image_curves(own, views)))
        return distances, curves.moment_Nm.reshape(count, 9)

    def residuals(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All residuals (R,) and their Jacobian (R, 16)."""
        distances, moments = self.evaluate(parameters)
        blocks, rows = [], []
        for block in (block for block, kept in zip(distances, self.kept, strict=True) if kept):
            jacobian = np.zeros((len(block), 16))
            jacobian[:, :14] = (block[:, 1:] - block[:, :1]) / STEPS
            blocks.append(block[:, 0] / self.noise_scale)
            rows.append(jacobian / self.noise_scale)
        readings = np.array([obs.still.moment_Nm for obs in self.observations])
        std = self.sensor.std_Nm
        jacobian = np.zeros((len(readings), 16))
        jacobian[:, ANTENNA] = parameters[GAIN] * (moments[:, 1:] - moments[:, :1]) / STEPS[6:]
        jacobian[:, GAIN], jacobian[:, OFFSET] = moments[:, 0], 1.0
        blocks.append(((parameters[GAIN] * moments[:, 0] + parameters[OFFSET] - readings) / std)[self.kept])
        rows.append(jacobian[self.kept] / std)
        whiten = np.linalg.inv(np.linalg.cholesky(self.prior.pose_covariance))
        blocks.append(whiten @ parameters[POSE])
        rows.append(np.hstack([whiten, np.zeros((6, 10))]))
        blocks.append((parameters[6:] - self.prior.mean) / self.prior.std)
        rows.append(np.hstack([np.zeros((10, 6)), np.diag(1 / self.prior.std)]))
        return np.concatenate(blocks), np.vstack(rows)


def solve_joint(
    observations: Sequence[Observation], camera: Camera, prior: Prior, length_m: float, sensor: MomentSensor
) -> JointSolution:
    """Solve camera pose, antenna and moment sensor from stills.

    Solved in passes: each weighs the points by how much they scattered about the model of the one before, so that at
    first, far off, nothing counts as false, and leaves out the stills that lie much further off than the others do. A
    load noted wrong bends its whole shape: no weight on single points keeps it from drawing the others along.
    Raises SolveError when the solver does not converge.
    """
    problem = _Problem(observations, camera, prior, length_m, sensor, 1.0, np.ones(len(observations), bool))
    parameters = np.concatenate([np.zeros(6), prior.mean])
    distances, moments = problem.evaluate(parameters)
    for _ in range(PASSES):
        kept = problem.kept
        scale = noise_scale([block[:, 0] for block, inside in zip(distances, kept, strict=True) if inside])
        settled = abs(scale / problem.noise_scale - 1.0) < SETTLED
        problem = replace(problem, noise_scale=scale)
        solution = _descend(problem, parameters)
        parameters = solution.parameters
        distances, moments = problem.evaluate(parameters)
        rms = np.array([np.sqrt((block[:, 0] ** 2).mean()) for block in distances]) / scale
        problem = replace(problem, kept=rms < FALSE_STILL * np.median(rms))
        if settled and (problem.kept == kept).all():
            break
    if not solution.converged:
        raise SolveError("the joint solve of camera pose, antenna and sensor did not converge")
    gain, offset = parameters[GAIN], parameters[OFFSET]
    return JointSolution(
        parameters=parameters,
        T_antenna_camera=prior.T_antenna_camera.retract(parameters[POSE]),
        covariance=solution.covariance(),
        noise_scale=problem.noise_scale,
        point_rms=rms,
        kept=kept,
        moment_residuals_Nm=np.array([obs.still.moment_Nm for obs in observations]) - gain * moments[:, 0] - offset,
    )


def noise_scale(residuals: Sequence[np.ndarray]) -> float:
    """Factor between the deviations that the points claim and those that count when many are averaged.

    Measured on means of runs of neighbours, which also sees errors that neighbours share.
    """
    runs = [r[: len(r) // RUN * RUN].reshape(-1, RUN).mean(axis=1) for r in residuals]
    spread = 1.4826 * np.sqrt(RUN) * float(np.median(np.abs(np.concatenate(runs))))
    return float(max(spread, 1.4826 * np.median(np.abs(np.concatenate(residuals))), 0.2))


@dataclass(frozen=True, eq=False)
class _Solution:
    """Parameters (16,), residuals (R,), their Jacobian (R, 16), and whether the solver came to a standstill."""

    parameters: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    converged: bool = False

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Reweighted information (16, 16) and slope (16,), and the scale (16,) taken out: units differ greatly."""
        weights = robust_weights(self.residuals)
        weighted = self.jacobian * weights[:, None]
        scale = np.linalg.norm(weighted, axis=0)
        weighted /= scale
        return weighted.T @ weighted, weighted.T @ (self.residuals * weights), scale

    def covariance(self) -> np.ndarray:
        """(16, 16) inverse of the information."""
        information, _, scale = self.normal_equations()
        inverse = np.linalg.inv(information) / np.outer(scale, scale)
        return 0.5 * (inverse + inverse.T)


def _descend(problem: _Problem, start: np.ndarray) -> _Solution:
    """Parameters of least robust cost, by Levenberg and Marquardt's steps."""
    now, damping = _Solution(start, *problem.residuals(start)), 0.0
    for _ in range(ITERATIONS):
        information, slope, scale = now.normal_equations()
        step = -np.linalg.solve(information + damping * np.eye(len(slope)), slope)
        promise = -float(slope @ step + 0.5 * step @ information @ step)
        moved = now.parameters + step / scale
        trial = _Solution(moved, *problem.residuals(moved))
        better = robust_cost(trial.residuals) <= robust_cost(now.residuals)
        now = trial if better else now
        if promise < STANDSTILL:
            return replace(now, converged=True)
        damping = 0.1 * damping if better else max(10.0 * damping, 1e-3)
    return now


assert len(RIG_PARAMETERS) == OFFSET + 1
