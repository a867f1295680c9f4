"""All that the stills say against what was typed and how the antenna is held, the cause before its consequences."""

from __future__ import annotations

from ...diagnosis import Diagnosis
from ...errors import SolveError
from ...geometry import Kinematics
from ...session import Load, Session
from ..joint import JointSolution
from ..joint_checks import check
from .bent import bent_diagnosis
from .clamp import soft_clamp, step_diagnosis
from .free_base import solve_free
from .gravity import gravity_diagnosis
from .load_rows import row_diagnoses, wrong_rows
from .rows import StillRows
from .sensor import drift_of, sensor_diagnoses

DISTANCE_STD_M, FORCE_STD = 7e-4, 7e-3
"""How well places and weights of loads are taken to be known: a little less well than they usually are."""


def still_diagnoses(session: Session, kinematics: Kinematics, joint: JointSolution) -> list[Diagnosis]:
    """What is wrong with loads, antenna, clamp, moment sensor, gravity and joint readings.

    What explains other faults away comes first, and those are then not asked for: with a wrong gravity, or with loads
    noted wrong, the clamp and the bow are wrong as well.

    Parameters
    ----------
    kinematics : with what a sweep found of the joints (`PlaneC.kinematics`).
    joint : of all stills, as `solve_antenna` gives it.
    """
    problem = joint.problem
    try:
        free: JointSolution | None = solve_free(
            problem.observations, problem.prior, problem.length_m, problem.moment_std_Nm
        )
    except SolveError:
        free = None
    if free is not None:
        gravity = gravity_diagnosis(free, kinematics, session.gravity_world_m_s2)
        if gravity is not None:
            return [gravity, *_sensor(session, joint, gravity is None)]
    rows = wrong_rows(free, problem.observations, problem.length_m) if free is not None else []
    found = row_diagnoses(rows, sum(isinstance(one.still, Load) for one in problem.observations))
    # rows that are wrong, and took part, have moved everything: the free antenna alone is asked then
    kept = [keep for one, keep in zip(problem.observations, joint.kept, strict=True) if isinstance(one.still, Load)]
    misled = any(kept[row.index] and row.reading is not None for row in rows)
    asked = free if free is not None and misled else joint
    linear = StillRows.of(asked)
    if asked is joint and free is not None:
        linear = linear.with_readings(DISTANCE_STD_M, FORCE_STD, min(free.noise_scale, joint.noise_scale))
    moved = step_diagnosis(asked, linear)
    held = [moved, bent_diagnosis(asked, linear) if moved is None else None]
    if asked is joint:
        held.append(soft_clamp(linear) if moved is None else None)
    return [*found, *(one for one in held if one is not None), *_sensor(session, joint, not misled)]


def _sensor(session: Session, joint: JointSolution, moments_known: bool) -> list[Diagnosis]:
    checks = check(joint)
    drift = drift_of(checks.drift_Nm_per_s, checks.drift_Nm_per_row)
    return sensor_diagnoses(joint, session.moment_std_Nm, *drift, moments_known)
