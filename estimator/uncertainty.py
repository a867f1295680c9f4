"""What a fit is worth: noise and the rig's joint covariance carried into the contact, and the test for contact itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.antenna.shape import Curves
from vbaa_calib.reprojection import image_curves, whitened_residuals
from vbaa_calib.rig import POSE_PARAMETERS

from .fit import ROBUST, Fit, Scene, linearised, robust_weights

POSES = len(POSE_PARAMETERS)
RIG_STEPS = np.array([1e-5] * POSES + [1e-5] * 2 + [1e-4] * 2 + [1e-3] * 4)
"""Finite-difference steps of the camera pose and the antenna's parameters."""


@dataclass(frozen=True, eq=False)
class Spread:
    """First-order uncertainty of a fit.

    Attributes
    ----------
    covariance : (3, 3) of the unknowns from all sources; infinite where the data do not hold an unknown.
    gain : (3, 16) change of the unknowns with `RIG_PARAMETERS`.
    excess : mean square of the points' whitened residuals where it is above one, else one.
    """

    covariance: np.ndarray
    gain: np.ndarray
    excess: float


def by_rig(scene: Scene, unknowns: np.ndarray) -> np.ndarray:
    """(N + 1, 16) change of the whitened residuals with `RIG_PARAMETERS`, at a contact given by its unknowns (3,)."""
    rig, sensor = scene.rig, scene.rig.moment_sensor
    antenna = np.repeat(rig.antenna.parameters[None], 9, axis=0)
    antenna[1:] += np.diag(RIG_STEPS[POSES:])
    contact = np.full(9, unknowns[0] * rig.antenna.length_m)
    curves = scene.curves(contact, np.tile(unknowns[1:] * scene.force_unit_N, (9, 1)), antenna)
    views = [rig.T_antenna_camera] + [rig.T_antenna_camera.retract(step) for step in np.diag(RIG_STEPS[:POSES])]
    views = [pose.inverse() for pose in [*views, *[views[0]] * 8]]
    points = whitened_residuals(scene.seen, image_curves(_picked(curves, [0] * 7 + list(range(1, 9))), views))
    moment = curves.moment_Nm
    table = np.zeros((len(points) + 1, len(rig.covariance)))
    table[:-1, : len(RIG_STEPS)] = (points[:, 1:] - points[:, :1]) / RIG_STEPS
    table[-1, POSES : len(RIG_STEPS)] = -sensor.gain * (moment[1:] - moment[0]) / RIG_STEPS[POSES:] / sensor.std_Nm
    table[-1, len(RIG_STEPS) :] = -moment[0] / sensor.std_Nm, -1.0 / sensor.std_Nm
    return table


def _picked(curves: Curves, order: list[int]) -> Curves:
    return Curves(
        curves.arclength_m[order],
        curves.points_m[order],
        curves.tangents[order],
        curves.force_N[order],
        curves.moment_Nm[order],
    )


def spread(scene: Scene, result: Fit) -> Spread:
    """Carry pixel noise, moment noise and the rig's joint covariance into the unknowns of a fit."""
    weights = robust_weights(result.residuals)[:, None]
    free = slice(1, 3) if result.at_tip else slice(0, 3)
    jacobian = result.jacobian[:, free] * weights
    scale = np.linalg.norm(jacobian, axis=0)
    nothing = Spread(np.full((3, 3), np.inf), np.zeros((3, len(scene.rig.covariance))), 1.0)
    if not np.isfinite(scale).all() or (scale == 0).any():
        return nothing
    information = (jacobian / scale).T @ (jacobian / scale)
    if np.linalg.cond(information) > 1e14:
        return nothing
    noise = np.linalg.inv(information) / np.outer(scale, scale)
    # Points that scatter more about the best shape than they should know less than they claim; never more.
    inliers = np.abs(result.residuals[:-1]) < 2 * ROBUST
    excess = max(1.0, float((result.residuals[:-1][inliers] ** 2).mean())) if inliers.any() else 1.0
    gain = np.zeros_like(nothing.gain)
    gain[free] = -noise @ jacobian.T @ (by_rig(scene, result.unknowns) * weights)
    covariance = gain @ scene.rig.covariance @ gain.T
    covariance[free, free] += excess * noise
    return Spread(covariance, gain, excess)


def evidence(scene: Scene, result: Fit, excess: float) -> float:
    """How much better a contact explains the frame than the free antenna: half the difference of the squared misfits.

    Both may bend the rig's parameters within their joint covariance first, so that a clamp angle that is known badly is
    not taken for a contact. Without contact it is about 1.5 (three unknowns fitted to noise). `scene` is the highest
    rung's, whatever rung was fitted: what a lower one leaves out of the weight must not pass for a force.
    """
    residuals, jacobian = linearised(scene, result.unknowns)
    free = np.array([0.5, 0.0, 0.0])
    without = linearised(scene, free)[0]
    gained = _marginal(scene, without, jacobian[:, :0], free) - _marginal(scene, residuals, jacobian, result.unknowns)
    return gained / excess


def _marginal(scene: Scene, residuals: np.ndarray, jacobian: np.ndarray, unknowns: np.ndarray) -> float:
    """Half the least sum of squares over the unknowns and over the rig's parameters under their prior."""
    weights = robust_weights(residuals)
    root = np.linalg.cholesky(_regular(scene.rig.covariance))
    table = np.hstack([jacobian, by_rig(scene, unknowns) @ root]) * weights[:, None]
    prior = np.hstack([np.zeros((len(root), jacobian.shape[1])), np.eye(len(root))])
    target = np.concatenate([residuals * weights, np.zeros(len(root))])
    stacked = np.vstack([table, prior])
    step, *_ = np.linalg.lstsq(stacked, -target, rcond=None)
    return 0.5 * float(((target + stacked @ step) ** 2).sum())


def _regular(covariance: np.ndarray) -> np.ndarray:
    """The covariance with a diagonal raised by 1e-12 of itself: parameters that are known exactly have a row of zeros."""
    diagonal = np.diag(covariance)
    return covariance + np.diag(1e-12 * diagonal + 1e-30)
