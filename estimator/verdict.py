"""From a fit to what may be said: the status, and only the numbers that the data support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from vbaa_calib.geometry import Pose

from .contact import Contact
from .fit import NEAREST, Fit
from .hinge import camera_angle
from .scene import POSES, STEPS, TIP, Scene, rig_axes
from .uncertainty import Spread, evidence

CONTACT_EVIDENCE = 14.0
"""Least evidence for a contact. Noise exceeds it about four times in a million: χ² with 3 degrees of freedom > 28."""
LOW_SIGNAL, LOW_SIGNAL_OWN = 0.05, 0.1
"""Distances less certain than this fraction of the length, or of themselves, are not given out: beyond it first order
no longer describes what is known."""
EDGE_ON_RAD = 0.05
"""Within this angle of the camera's centre the deformation plane counts as seen edge-on."""
WRONG_SHAPE = 3.0
"""Median misfit, in standard deviations, beyond which the shape is not that of one contact."""
STRANGE_RIG = 2e-5
"""The rig's steps, in deviations, follow χ²: a sum of squares this improbable says that the frame asks for another."""
CONTRADICTION = 4.0
"""Moment misfit in standard deviations beyond which picture and moment are said to disagree."""
RIG_STEP = 1e-5
"""Finite-difference step of the antenna's parameters."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit and what belongs to it.

    Attributes
    ----------
    fit : on the rung that was taken.
    reference : the same contact on the highest rung.
    model, chosen : name of the rung that was taken, and why.
    """

    fit: Fit
    reference: Fit
    spread: Spread
    model: str
    chosen: str


def judge(solved: Solved, T_world_antenna: Pose) -> Contact:
    """The frame's result: what the fit is worth decides what is said."""
    result, spread, model = solved.fit, solved.spread, solved.model
    scene = result.scene
    if not np.isfinite(result.residuals).all():
        return Contact("failed", "the fit left the domain of the model", model, False)
    sensor = scene.rig.moment_sensor
    residual = float(result.residuals[-1] * sensor.std_Nm / sensor.gain)
    if evidence(solved.reference) < CONTACT_EVIDENCE:
        why = "the antenna has its free shape within its uncertainty"
        return Contact("no_contact", why, model, False, moment_residual_Nm=residual)
    # Without a contact the distance has no meaning, and nothing to converge to: only here does it matter.
    if not result.converged:
        return Contact("failed", "the fit did not converge", model, True, moment_residual_Nm=residual)
    if scene.scatter > WRONG_SHAPE:
        why = f"the shape is not that of one contact: points lie {scene.scatter:.0f} std off"
        return Contact("failed", why, model, True, moment_residual_Nm=residual)
    distance_std = float(np.sqrt(spread.covariance[0, 0]))
    if not distance_std < min(LOW_SIGNAL, LOW_SIGNAL_OWN * result.unknowns[0]):
        status, why = _too_little(result, distance_std)
        return Contact(status, why, model, True, moment_residual_Nm=residual)
    reasons = [solved.chosen]
    if result.at_tip:
        reasons.insert(0, "the contact cannot be told from the tip: its distance is the antenna's length")
    if scene.scatter > 1.0:
        reasons.append(f"the points scatter {scene.scatter:.1f} times more than they should")
    strange = float(result.rig_steps @ result.rig_steps)
    if chi2.sf(strange, max(len(result.rig_steps), 1)) < STRANGE_RIG:
        reasons.append(f"the rig's parameters had to move by {np.sqrt(strange):.0f} std to fit: check the rig")
    contradiction = abs(result.residuals[-1]) / spread.moment_std
    if contradiction > CONTRADICTION:
        reasons.append(f"picture and moment disagree by {contradiction:.0f} std")
    return _describe(solved, T_world_antenna, "; ".join(reasons), residual)


def edge_on_angle(result: Fit) -> float:
    """Angle between the deformation plane 𝒟 and the ray from the camera's centre to the contact, rad."""
    rig = result.scene.rig
    y_m, z_m, about_y, about_z = rig.antenna.parameters[:4]
    T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
    center_m = T_antenna_clamp.inverse() @ rig.T_antenna_camera.translation_m
    distance, force_y, force_z = result.unknowns
    return float(camera_angle(center_m, np.arctan2(force_z, force_y), distance * rig.antenna.length_m))


def _too_little(result: Fit, distance_std: float) -> tuple[str, str]:
    angle = edge_on_angle(result)
    if angle < EDGE_ON_RAD:
        return "unobservable", f"the camera sees the deformation plane edge-on, {np.degrees(angle):.1f}° off"
    if not np.isfinite(distance_std):
        return "unobservable", "nothing in picture and moment holds the contact distance"
    millimetres = 1e3 * distance_std * result.scene.rig.antenna.length_m
    return "low_signal", f"the contact distance is known only to {millimetres:.1f} mm"


def _quantities(scene: Scene, unknowns: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(B, 9) contact point, force and deflection, antenna frame, for unknowns (B, 3) and antennas (B, 9)."""
    curves = scene.curves(unknowns, parameters)
    free = scene.curves(unknowns * [1.0, 0.0, 0.0], parameters)
    return np.hstack([curves.contact_m, curves.force_N, curves.contact_m - free.contact_m])


def _estimates(result: Fit, spread: Spread) -> tuple[np.ndarray, np.ndarray]:
    """`_quantities` (9,) of a fit and their covariance (9, 9) from noise and rig.

    First order, and the second order in the unknowns: a point known badly along a bent antenna, or around it, is known
    within a bow, which a thin straight ellipsoid would leave.
    """
    scene, count = result.scene, len(result.scene.rig.antenna.parameters)
    antenna = slice(POSES, POSES + count)
    rig_axis = rig_axes(scene.rig)[antenna]
    steps = STEPS * np.where(result.unknowns + STEPS > TIP, [-1, 1, 1], 1)
    sizes, axes = np.linalg.eigh(spread.covariance)
    axes = np.sqrt(np.clip(sizes, 0.0, None))[:, None] * axes.T
    unknowns = result.unknowns + np.vstack([np.zeros(3), np.diag(steps), axes, -axes, np.zeros((count, 3))])
    unknowns[:, 0] = np.clip(unknowns[:, 0], NEAREST, TIP)
    parameters = np.tile(scene.rig.antenna.parameters + rig_axis @ result.rig_steps, (len(unknowns), 1))
    parameters[-count:] += RIG_STEP * np.eye(count)
    values = _quantities(scene, unknowns, parameters)
    by_unknowns = ((values[1:4] - values[0]) / steps[:, None]).T
    by_rig = ((values[-count:] - values[0]) / RIG_STEP).T @ rig_axis
    first = np.hstack([by_unknowns, by_rig])
    bows = values[4:7] + values[7:10] - 2.0 * values[0]
    return values[0], first @ spread.joint @ first.T + 0.75 * bows.T @ bows  # the mean square of z²/2 is 3/4


def _describe(solved: Solved, T_world_antenna: Pose, reason: str, residual: float) -> Contact:
    result, spread = solved.fit, solved.spread
    values, covariance = _estimates(result, spread)
    rotation = T_world_antenna.rotation
    length = result.scene.rig.antenna.length_m
    point, force = values[:3], values[3:6]
    return Contact(
        status="tip_contact" if result.at_tip else "ok",
        reason=reason,
        model=solved.model,
        in_contact=True,
        distance_m=float(result.unknowns[0] * length),
        distance_std_m=float(np.sqrt(spread.covariance[0, 0]) * length),
        force_N=force,
        force_std_N=np.sqrt(np.diag(covariance)[3:6]),
        deflection_m=values[6:],
        point_antenna_m=point,
        point_world_m=T_world_antenna @ point,
        covariance_world_m2=rotation @ covariance[:3, :3] @ rotation.T,
        force_world_N=rotation @ force,
        moment_residual_Nm=residual,
    )
