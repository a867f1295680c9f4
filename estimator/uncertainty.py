"""What a fit is worth: noise and the rig's joint covariance carried into the contact, and the test for contact itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.reprojection import image_curves, whitened_residuals
from vbaa_calib.rig import POSE_PARAMETERS

from .fit import ROBUST, Fit, Scene, linearised, robust_weights

POSES = len(POSE_PARAMETERS)
RIG_STEPS = np.array([1e-5] * POSES + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 4)
"""Finite-difference steps of the camera pose and the antenna's parameters."""
LEAST_REDUNDANCY = 0.1
"""A moment whose misfit may be only this part of its own deviation was fitted, not tested: it contradicts nothing."""


@dataclass(frozen=True, eq=False)
class Spread:
    """First-order uncertainty of a fit.

    Attributes
    ----------
    noise : (3, 3) covariance of the unknowns from pixels and moment; infinite where the data do not hold an unknown.
    gain : (3, 16) change of the unknowns with `RIG_PARAMETERS`.
    covariance : (3, 3) from noise and rig together.
    excess : mean square of the points' whitened residuals where it is above one, else one.
    moment_std : standard deviation that the moment's whitened misfit has by noise and rig, what was fitted away left
        out; at least `LEAST_REDUNDANCY`.
    """

    noise: np.ndarray
    gain: np.ndarray
    covariance: np.ndarray
    excess: float
    moment_std: float


def by_rig(scene: Scene, unknowns: np.ndarray) -> np.ndarray:
    """(N + 1, 16) change of the whitened residuals with `RIG_PARAMETERS`, at a contact given by its unknowns (3,)."""
    rig, sensor = scene.rig, scene.rig.moment_sensor
    antenna = np.repeat(rig.antenna.parameters[None], 9, axis=0)
    antenna[1:] += np.diag(RIG_STEPS[POSES:])
    contact = np.full(9, unknowns[0] * rig.antenna.length_m)
    curves = scene.curves(contact, np.tile(unknowns[1:] * scene.force_unit_N, (9, 1)), antenna)
    views = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
    views = [pose.inverse() for pose in [*views, *[views[0]] * 8]]
    order = np.array([0] * (POSES + 1) + list(range(1, 9)))
    points = whitened_residuals(scene.seen, image_curves(curves.picked(order), views))
    moment = curves.moment_Nm
    table = np.zeros((len(points) + 1, len(rig.covariance)))
    table[:-1, : len(RIG_STEPS)] = (points[:, 1:] - points[:, :1]) / RIG_STEPS
    table[-1, POSES : len(RIG_STEPS)] = -sensor.gain * (moment[1:] - moment[0]) / RIG_STEPS[POSES:] / sensor.std_Nm
    table[-1, len(RIG_STEPS) :] = -moment[0] / sensor.std_Nm, -1.0 / sensor.std_Nm
    return table


def spread(scene: Scene, result: Fit) -> Spread:
    """Carry pixel noise, moment noise and the rig's joint covariance into the unknowns of a fit.

    A distance held at the tip gets the deviation that it would have if it were free: the data allow it that far inside.
    """
    rig = scene.rig.covariance
    unknown = np.full((3, 3), np.inf)
    nothing = Spread(unknown, np.zeros((3, len(rig))), unknown, 1.0, 1.0)
    weights = robust_weights(result.residuals)[:, None]
    jacobian = result.jacobian * weights
    scale = np.linalg.norm(jacobian, axis=0)
    if not np.isfinite(scale).all() or (scale == 0).any():
        return nothing
    information = (jacobian / scale).T @ (jacobian / scale)
    if np.linalg.cond(information) > 1e14:
        return nothing
    pure = np.linalg.inv(information) / np.outer(scale, scale)
    # Points that scatter more about the best shape than they should know less than they claim; never more.
    inliers = np.abs(result.residuals[:-1]) < 2 * ROBUST
    excess = max(1.0, float((result.residuals[:-1][inliers] ** 2).mean())) if inliers.any() else 1.0
    response = -pure @ (jacobian * weights).T
    table = by_rig(scene, result.unknowns)
    gain = response @ table
    moment_by_noise = result.jacobian[-1] @ response
    moment_by_noise[-1] += 1.0
    moment_by_rig = table[-1] + result.jacobian[-1] @ gain
    moment_variance = excess * moment_by_noise @ moment_by_noise + moment_by_rig @ rig @ moment_by_rig
    return Spread(
        noise=excess * pure,
        gain=gain,
        covariance=excess * pure + gain @ rig @ gain.T,
        excess=excess,
        moment_std=max(float(np.sqrt(moment_variance)), LEAST_REDUNDANCY),
    )


def evidence(scene: Scene, result: Fit, excess: float) -> float:
    """How much better a contact explains the frame than the free antenna: half the difference of the squared misfits.

    Both may bend the rig's parameters within their joint covariance first, so that a clamp angle that is known badly is
    not taken for a contact. Without contact it is about 1.5 (three unknowns fitted to noise). Scene and result must be
    of the highest rung (`fit.evaluated`): what a lower one leaves out of the weight must not pass for a force.
    """
    free = np.array([0.5, 0.0, 0.0])
    without, _ = linearised(scene, free)
    gained = _marginal(scene, without, np.empty((len(without), 0)), free)
    gained -= _marginal(scene, result.residuals, result.jacobian, result.unknowns)
    return gained / excess


def _marginal(scene: Scene, residuals: np.ndarray, jacobian: np.ndarray, unknowns: np.ndarray) -> float:
    """Half the least sum of squares over the unknowns and over the rig's parameters under their prior."""
    weights = robust_weights(residuals)
    root = _root(scene.rig.covariance)
    table = np.hstack([jacobian, by_rig(scene, unknowns) @ root]) * weights[:, None]
    prior = np.concatenate([np.zeros(jacobian.shape[1]), np.ones(len(root))])
    slope = table.T @ (residuals * weights)
    hessian = table.T @ table + np.diag(prior)
    scale = np.sqrt(np.diag(hessian)) + 1e-30
    hessian = hessian / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    taken = (slope / scale) @ np.linalg.solve(hessian, slope / scale)
    return 0.5 * float(((residuals * weights) ** 2).sum() - taken)


def _root(covariance: np.ndarray) -> np.ndarray:
    """A with A·Aᵀ the covariance, which may be singular: what is known exactly has a row of zeros."""
    std = np.sqrt(np.diag(covariance))
    unit = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return std[:, None] * vectors * np.sqrt(np.clip(values, 0.0, None))
