"""What can be said of a session whose calibration did not come to an end."""

from __future__ import annotations

from collections.abc import Sequence

from ...diagnosis import Diagnosis
from ...errors import InputError, SolveError
from ...geometry import Kinematics
from ...session import Load, Session, read_loads
from ..joint import solve_joint
from ..joint_problem import Observation, Prior
from .free_base import DEAF, solve_free
from .gravity import gravity_diagnosis
from .load_rows import row_diagnoses, unexplained, wrong_rows
from .scatter import own_scatter
from .still_diagnoses import still_diagnoses
from .typed_loads import typed_load_doubts


def explain_failure(
    session: Session,
    kinematics: Kinematics | None = None,
    observations: Sequence[Observation] = (),
    before: Prior | None = None,
) -> list[Diagnosis]:
    """What a calibration that raised may have failed of: by the typed loads, and by the free antenna where it was seen.

    Parameters
    ----------
    observations, before : what `solve_antenna` was to solve, as far as it came; without them the typed loads alone are
        judged.

    Raises nothing: a table that cannot be read has said so itself.
    """
    kinematics = session.kinematics if kinematics is None else kinematics
    loads: list[Load] = [one.still for one in observations if isinstance(one.still, Load)]
    if not loads:
        try:
            loads = read_loads(session)
        except InputError:
            loads = []
    found = typed_load_doubts(loads, session.antenna)
    if before is None or not observations:
        return found
    length, std = session.antenna.length_m, session.moment_std_Nm
    try:
        # without the sensor, which may be what is wrong
        return still_diagnoses(session, kinematics, solve_joint(observations, before, length, DEAF * std)) or found
    except SolveError:
        pass
    try:
        free = solve_free(observations, before, length, std)
    except SolveError:
        return found
    gravity = gravity_diagnosis(free, kinematics, session.gravity_world_m_s2, own_scatter(observations))
    if gravity is not None:
        return [gravity]
    rows = wrong_rows(free, observations, length)
    return row_diagnoses(rows, len(loads)) or found or unexplained(rows)
