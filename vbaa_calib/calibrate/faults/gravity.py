"""Whether the free antenna sags as gravity_world and the joint readings predict; if not, what they should be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, linearised, noise_scale
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import huber_losses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Still, gravity_antenna

from .fit_quality import fits

_STANDARD_GRAVITY_M_S2 = 9.80665
_STEPS, _CONVERGED = 8, 0.02
"""Gauss-Newton steps under another gravity: it is compared roughly, not to the last digit."""
_LEAST_GAIN, _LEAST_PART = 60.0, 0.1
"""Decrease of χ² that another gravity must bring, in units of the scatter that it leaves and as a part."""
_ALIKE_PART = 0.1
"""Others within this part of the gain fit as well."""
_SAME_M_S2 = 0.5
"""Gravities that differ by less in every frame are the same."""
_AXES = {
    f"{sign}{name}": value * np.eye(3)[axis] for axis, name in enumerate("xyz") for sign, value in (("+", 1), ("−", -1))
}

_JOINT_SLIPS = (
    ("the tilt turned the other way", "the sign of tilt_rad", np.diag([1.0, -1.0])),
    ("the pan turned the other way", "the sign of pan_rad", np.diag([-1.0, 1.0])),
    ("pan and tilt were exchanged", "the columns pan_rad and tilt_rad", np.array([[0.0, 1.0], [1.0, 0.0]])),
    ("the angles were in degrees", "the unit: angles are in rad", np.pi / 180 * np.eye(2)),
    ("the angles had been turned into rad twice", "the angles: they are in rad once", 180 / np.pi * np.eye(2)),
    ("the tilt stayed at 0", "tilt_rad, or connect its encoder", np.diag([1.0, 0.0])),
)
"""How the joints would have moved, what to correct, and the matrix (2, 2) that puts (pan, tilt) right."""


_Hypothesis = tuple[Diagnosis, np.ndarray]
"""What would be wrong with the session's record, and gravity (F, 3) in the frames if it were, antenna frame."""


def gravity_diagnosis(
    free: BundleAdjustment, kinematics: Kinematics, gravity_world_m_s2: np.ndarray, own_scatter: float
) -> Diagnosis | None:
    """Another direction of gravity, or another reading of the joints, under which the pictures fit.

    One that fits better, but not well, is not named: many fit a slipping clamp or a kink better.
    free : joint solution of the no-load frames, or of all stills, without the moment sensor.
    gravity_world_m_s2 : (3,) of the session. own_scatter : of the points, see `picture_scatter`.
    """
    observations = free.problem.observations
    noted = np.array([one.gravity_m_s2 for one in observations])
    now, scatter = _refitted(free, noted)
    if fits(scatter, own_scatter):
        return None
    others = _hypotheses([one.still for one in observations], kinematics, gravity_world_m_s2, noted)
    tried = sorted(((*_refitted(free, pull), other) for other, pull in others), key=lambda one: one[0])
    if not tried:
        return None
    least, scatter, best = tried[0]
    gain = now - least
    if not fits(scatter, own_scatter) or gain < max(_LEAST_GAIN * max(scatter, 1.0) ** 2, _LEAST_PART * now):
        return None
    # several may do as well: what they have in common is that the noted one is wrong
    alike = [other.words for left, _, other in tried[1:] if left < least + _ALIKE_PART * gain]
    words = " or ".join([best.words, *alike[:2]])
    return replace(best, words=f"the free antenna sags as if {words}, and not as noted")


def _refitted(free: BundleAdjustment, gravity_m_s2: np.ndarray) -> tuple[float, float]:
    """χ² and scatter of the points, over claimed deviations, with all solved again under a gravity (F, 3)."""
    problem = free.problem
    observations = [
        replace(one, gravity_m_s2=pull) for one, pull in zip(problem.observations, gravity_m_s2, strict=True)
    ]
    kept = np.ones(len(observations), bool)
    problem = replace(problem, observations=observations, noise_scale=1.0, kept=kept)
    now = linearised(problem, problem.begin)
    for _ in range(_STEPS):
        # without robust weights: far from the antenna nearly all points would count as outliers
        scale = np.linalg.norm(now.jacobian, axis=0)
        step = -np.linalg.lstsq(now.jacobian / scale, now.residuals, rcond=None)[0] / scale
        try:
            moved = linearised(problem, now.parameters + step)
        except ValueError:
            # an impossible gravity winds the antenna up: no further
            break
        before, after = float(now.residuals @ now.residuals), float(moved.residuals @ moved.residuals)
        if not after < before:
            break
        now = moved
        if after > (1 - _CONVERGED) * before:
            break
    blocks, _ = problem.evaluate(now.parameters)
    # the points' own: a bow that is not ordinary is no sign of another gravity
    points = now.residuals[: -now.certain]
    return 2.0 * float(huber_losses(points).sum()), noise_scale([block[:, 0] for block in blocks])


def _hypotheses(
    stills: Sequence[Still], kinematics: Kinematics, gravity_world_m_s2: np.ndarray, noted_m_s2: np.ndarray
) -> list[_Hypothesis]:
    """What could be wrong with gravity_world (3,) and with the joint readings, where it makes a difference.

    noted_m_s2 : (F, 3) antenna frame, by what was noted.
    """
    size = float(np.linalg.norm(gravity_world_m_s2)) or _STANDARD_GRAVITY_M_S2
    worlds = {f"gravity pointed to {name} of the world": size * axis for name, axis in _AXES.items()}
    if gravity_world_m_s2.any():
        worlds["there were no gravity"] = np.zeros(3)
    found = []
    for words, gravity in worlds.items():
        numbers = ", ".join(f"{value + 0.0:g}" for value in gravity)
        remedy = f"gravity_world: [{numbers}] in session.yaml would fit; check where the world's axes point"
        pull = gravity_antenna(kinematics, gravity, stills)
        found.append((Diagnosis("gravity_direction", words, remedy, grave=True), pull))
    for words, what, turn in _JOINT_SLIPS:
        angles = [turn @ (one.pan_rad, one.tilt_rad) for one in stills]
        moved = [replace(one, pan_rad=float(a[0]), tilt_rad=float(a[1])) for one, a in zip(stills, angles, strict=True)]
        pull = gravity_antenna(kinematics, gravity_world_m_s2, moved)
        found.append((Diagnosis("joint_readings_wrong", words, f"correct {what}, in all tables", grave=True), pull))
    different: list[_Hypothesis] = []
    for other, pull in found:
        if all(np.abs(pull - known).max() > _SAME_M_S2 for known in (noted_m_s2, *(pull for _, pull in different))):
            different.append((other, pull))
    return different
