"""Gravity and joint readings: does the free antenna sag as session.yaml and noload.csv say?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import JointSolution, Linearised, noise_scale
from vbaa_calib.core.errors import Diagnosis
from vbaa_calib.core.robust import huber_losses
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Still, gravity_antenna

from .free_antenna import fits

GRAVITY_M_S2 = 9.80665
FIT_STEPS, SETTLED = 8, 0.02
"""Steps towards what a gravity leaves unexplained: it is compared in large, not to its last digit."""
BETTER, LEAST_PART = 60.0, 0.1
"""How much less χ² another gravity must leave, in units of the scatter that it leaves and as a part."""
ALIKE_PART = 0.1
"""Others that lie within this part of the gain fit as well."""
SAME_M_S2 = 0.5
"""Gravities that differ by less in every frame are the same."""
AXES = {
    f"{sign}{name}": value * np.eye(3)[axis] for axis, name in enumerate("xyz") for sign, value in (("+", 1), ("−", -1))
}


@dataclass(frozen=True, eq=False)
class Otherwise:
    """Gravity in the frames, were something in the session other than it is noted.

    Attributes
    ----------
    name, words, remedy : of the diagnosis. gravity_m_s2 : (F, 3) antenna frame.
    """

    name: str
    words: str
    remedy: str
    gravity_m_s2: np.ndarray


@dataclass(frozen=True, eq=False)
class Left:
    """What a fit leaves unexplained.

    Attributes
    ----------
    squares : twice the robust cost of the points, their deviations as claimed.
    noise_scale : scatter of the points over these.
    """

    squares: float
    noise_scale: float


def gravity_diagnosis(
    free: JointSolution, kinematics: Kinematics, gravity_world_m_s2: np.ndarray, own: float
) -> Diagnosis | None:
    """Another direction of gravity, or another reading of the joints, that the pictures fit as well as they can.

    One that fits better only, and not well, is not named: a clamp that slips, or a kink, is fitted better by many.

    Parameters
    ----------
    free : joint solution of the no-load frames, or of all stills, the moment sensor left out.
    gravity_world_m_s2 : (3,) as the session says.
    own : scatter of the points that no model explains, see `own_scatter`.
    """
    observations = free.problem.observations
    noted = np.array([one.gravity_m_s2 for one in observations])
    now = _left_by(free, noted)
    if fits(now.noise_scale, own):
        return None
    others = otherwise([one.still for one in observations], kinematics, gravity_world_m_s2, noted)
    tried = sorted(((_left_by(free, other.gravity_m_s2), other) for other in others), key=lambda one: one[0].squares)
    if not tried:
        return None
    least, best = tried[0]
    gain = now.squares - least.squares
    if not fits(least.noise_scale, own):
        return None
    if gain < max(BETTER * max(least.noise_scale, 1.0) ** 2, LEAST_PART * now.squares):
        return None
    # several may do as well: what they have in common is that the noted one is wrong
    alike = [other.words for left, other in tried[1:] if left.squares < least.squares + ALIKE_PART * gain]
    words = " or ".join([best.words, *alike[:2]])
    return Diagnosis(best.name, f"the free antenna sags as if {words}, and not as noted", best.remedy, grave=True)


def _left_by(free: JointSolution, gravity_m_s2: np.ndarray) -> Left:
    """What the no-load frames leave unexplained under another gravity (F, 3), antenna frame, all else solved anew."""
    problem = free.problem
    observations = [
        replace(one, gravity_m_s2=pull) for one, pull in zip(problem.observations, gravity_m_s2, strict=True)
    ]
    kept = np.ones(len(observations), bool)
    problem = replace(problem, observations=observations, noise_scale=1.0, kept=kept)
    now = Linearised.of(problem, problem.begin)
    for _ in range(FIT_STEPS):
        # plain squares: far from the antenna nearly all points would count as false
        scale = np.linalg.norm(now.jacobian, axis=0)
        step = -np.linalg.lstsq(now.jacobian / scale, now.residuals, rcond=None)[0] / scale
        try:
            moved = Linearised.of(problem, now.parameters + step)
        except ValueError:
            # an antenna wound up by what cannot be: no further
            break
        before, after = float(now.residuals @ now.residuals), float(moved.residuals @ moved.residuals)
        if not after < before:
            break
        now = moved
        if after > (1 - SETTLED) * before:
            break
    blocks, _ = problem.evaluate(now.parameters)
    # the points' own: a bow that is not ordinary is no sign of another gravity
    return Left(
        2.0 * float(huber_losses(now.residuals[: -now.certain]).sum()), noise_scale([block[:, 0] for block in blocks])
    )


def otherwise(
    stills: Sequence[Still], kinematics: Kinematics, gravity_world_m_s2: np.ndarray, noted_m_s2: np.ndarray
) -> list[Otherwise]:
    """What could be wrong with gravity_world (3,) and with the joints' readings, where it makes a difference.

    noted_m_s2 : (F, 3) antenna frame, as it is with what was noted.
    """
    size = float(np.linalg.norm(gravity_world_m_s2)) or GRAVITY_M_S2
    found = []
    for name, axis in AXES.items():
        found.append(_with_gravity(stills, kinematics, size * axis, f"gravity pointed to {name} of the world"))
    if gravity_world_m_s2.any():
        found.append(_with_gravity(stills, kinematics, np.zeros(3), "there were no gravity"))
    for words, remedy, turned in _joint_slips():
        moved = [turned(still) for still in stills]
        pull = gravity_antenna(kinematics, gravity_world_m_s2, moved)
        found.append(Otherwise("joint_readings_wrong", words, f"correct {remedy}, in all tables", pull))
    different: list[Otherwise] = []
    for other in found:
        if all(
            np.abs(other.gravity_m_s2 - known).max() > SAME_M_S2
            for known in [noted_m_s2, *(one.gravity_m_s2 for one in different)]
        ):
            different.append(other)
    return different


def _with_gravity(stills: Sequence[Still], kinematics: Kinematics, gravity: np.ndarray, words: str) -> Otherwise:
    numbers = ", ".join(f"{value + 0.0:g}" for value in gravity)
    remedy = f"gravity_world: [{numbers}] in session.yaml would fit; check where the world's axes point"
    return Otherwise("gravity_direction", words, remedy, gravity_antenna(kinematics, gravity, stills))


def _joint_slips() -> list[tuple[str, str, Callable[[Still], Still]]]:
    """What the joints would do, what to correct, and the still with that."""
    degrees = np.pi / 180

    def turned(pan: tuple[float, float], tilt: tuple[float, float]) -> Callable[[Still], Still]:
        def still(one: Still) -> Still:
            at = np.array([one.pan_rad, one.tilt_rad])
            return replace(one, pan_rad=float(at @ pan), tilt_rad=float(at @ tilt))

        return still

    return [
        ("the tilt turned the other way", "the sign of tilt_rad", turned((1, 0), (0, -1))),
        ("the pan turned the other way", "the sign of pan_rad", turned((-1, 0), (0, 1))),
        ("pan and tilt were exchanged", "the columns pan_rad and tilt_rad", turned((0, 1), (1, 0))),
        ("the angles were in degrees", "the unit: angles are in rad", turned((degrees, 0), (0, degrees))),
        (
            "the angles had been turned into rad twice",
            "the angles: they are in rad once",
            turned((1 / degrees, 0), (0, 1 / degrees)),
        ),
        ("the tilt stayed at 0", "tilt_rad, or connect its encoder", turned((1, 0), (0, 0))),
    ]
