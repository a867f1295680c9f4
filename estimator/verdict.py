"""From a fit to what may be said: the status, and only the numbers that the data support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vbaa_calib.geometry import Pose

from .contact import Contact
from .fit import STEPS, TIP, Fit, Scene, evaluated
from .hinge import camera_angle
from .uncertainty import Spread, evidence

CONTACT_EVIDENCE = 14.0
"""Least evidence for a contact. Noise alone exceeds it about four times in a million (χ² with 3 degrees of freedom > 28)."""
LOW_SIGNAL = 0.12
"""Contact distances less certain than this fraction of the length are not given out."""
EDGE_ON_RAD = 0.05
"""Within this angle of the camera's centre the deformation plane counts as seen edge-on."""
WRONG_SHAPE = 6.0
"""Median misfit, in standard deviations, beyond which the shape is not that of one contact."""
CONTRADICTION = 4.0
"""Moment misfit in standard deviations beyond which picture and moment are said to disagree."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A fit and what belongs to it.

    Attributes
    ----------
    scene, reference : the frame on the rung that was fitted, and on the highest.
    model, chosen : name of the rung that was fitted, and why it was taken.
    """

    scene: Scene
    reference: Scene
    fit: Fit
    spread: Spread
    model: str
    chosen: str


def judge(solved: Solved, T_world_antenna: Pose) -> Contact:
    """The frame's result: what the fit is worth decides what is said."""
    scene, result, spread, model = solved.scene, solved.fit, solved.spread, solved.model
    if not result.converged or not np.isfinite(result.unknowns).all():
        return Contact("failed", "the fit did not converge", model, False)
    sensor = scene.rig.moment_sensor
    residual = float(result.residuals[-1] * sensor.std_Nm / sensor.gain)
    at_reference = result if solved.reference is scene else evaluated(solved.reference, result.unknowns, result.at_tip)
    if evidence(solved.reference, at_reference, spread.excess) < CONTACT_EVIDENCE:
        why = "the antenna has its free shape within its uncertainty"
        return Contact("no_contact", why, model, False, moment_residual_Nm=residual)
    misfit = 1.4826 * float(np.median(np.abs(result.residuals[:-1])))
    if misfit > WRONG_SHAPE:
        why = f"the shape is not that of one contact: points lie {misfit:.0f} std off"
        return Contact("failed", why, model, True, moment_residual_Nm=residual)
    distance_std = float(np.sqrt(spread.covariance[0, 0]))
    if not distance_std < LOW_SIGNAL:
        status, why = _too_little(scene, result, distance_std)
        return Contact(status, why, model, True, moment_residual_Nm=residual)
    reasons = [solved.chosen]
    if result.at_tip:
        reasons.insert(0, "the contact is at the tip: its distance is the antenna's length")
    contradiction = abs(result.residuals[-1]) / spread.moment_std
    if contradiction > CONTRADICTION:
        reasons.append(f"picture and moment disagree by {contradiction:.0f} std")
    return _describe(solved, T_world_antenna, "; ".join(reasons), residual)


def edge_on_angle(scene: Scene, result: Fit) -> float:
    """Angle between the deformation plane 𝒟 and the ray from the camera's centre to the contact, rad."""
    y_m, z_m, about_y, about_z = scene.rig.antenna.parameters[:4]
    T_antenna_clamp = Pose.from_rotvec(np.array([0.0, about_y, about_z]), np.array([0.0, y_m, z_m]))
    center_m = T_antenna_clamp.inverse() @ scene.rig.T_antenna_camera.translation_m
    distance, force_y, force_z = result.unknowns
    return float(camera_angle(center_m, np.arctan2(force_z, force_y), distance * scene.rig.antenna.length_m))


def _too_little(scene: Scene, result: Fit, distance_std: float) -> tuple[str, str]:
    angle = edge_on_angle(scene, result)
    if angle < EDGE_ON_RAD:
        return "unobservable", f"the camera sees the deformation plane edge-on, {np.degrees(angle):.1f}° off"
    if not np.isfinite(distance_std):
        return "unobservable", "nothing in picture and moment holds the contact distance"
    return "low_signal", f"the contact distance is known only to {100 * distance_std:.0f} % of the length"


def _quantities(scene: Scene, unknowns: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """(B, 9) contact point, force and deflection, antenna frame, for unknowns (B, 3) and antennas (B, 8)."""
    contact = unknowns[:, 0] * scene.rig.antenna.length_m
    lateral = unknowns[:, 1:] * scene.force_unit_N
    curves = scene.curves(contact, lateral, parameters)
    free = scene.curves(contact, np.zeros_like(lateral), parameters)
    return np.hstack([curves.contact_m, curves.force_N, curves.contact_m - free.contact_m])


def _describe(solved: Solved, T_world_antenna: Pose, reason: str, residual: float) -> Contact:
    scene, result, spread = solved.scene, solved.fit, solved.spread
    steps = STEPS * np.where(result.unknowns + STEPS > TIP, [-1, 1, 1], 1)
    rig_steps = np.full(8, 1e-5)
    unknowns = np.vstack([result.unknowns, result.unknowns + np.diag(steps), np.tile(result.unknowns, (8, 1))])
    parameters = np.repeat(scene.rig.antenna.parameters[None], 12, axis=0)
    parameters[4:] += np.diag(rig_steps)
    values = _quantities(scene, unknowns, parameters)
    by_unknowns = ((values[1:4] - values[0]) / steps[:, None]).T
    by_antenna = ((values[4:] - values[0]) / rig_steps[:, None]).T
    # The unknowns move with the rig's parameters (spread.gain), and the quantities with both.
    direct = np.zeros((9, spread.gain.shape[1]))
    direct[:, 6:14] = by_antenna
    total = direct + by_unknowns @ spread.gain
    covariance = by_unknowns @ spread.noise @ by_unknowns.T + total @ scene.rig.covariance @ total.T
    rotation = T_world_antenna.rotation
    point, force = values[0, :3], values[0, 3:6]
    return Contact(
        status="tip_contact" if result.at_tip else "ok",
        reason=reason,
        model=solved.model,
        in_contact=True,
        distance_m=float(result.unknowns[0] * scene.rig.antenna.length_m),
        distance_std_m=float(np.sqrt(spread.covariance[0, 0]) * scene.rig.antenna.length_m),
        force_N=force,
        force_std_N=np.sqrt(np.diag(covariance)[3:6]),
        deflection_m=values[0, 6:],
        point_antenna_m=point,
        point_world_m=T_world_antenna @ point,
        covariance_world_m2=rotation @ covariance[:3, :3] @ rotation.T,
        force_world_N=rotation @ force,
        moment_residual_Nm=residual,
    )
