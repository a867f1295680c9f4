"""What can be said of a session whose calibration did not come to an end."""

from __future__ import annotations

from collections.abc import Sequence

from ...diagnosis import Diagnosis
from ...errors import InputError, SolveError
from ...geometry import Kinematics
from ...session import Load, Session, read_loads
from ..joint_problem import Observation, Prior
from .free_base import solve_free
from .gravity import gravity_diagnosis
from .load_rows import row_diagnoses, wrong_rows
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
    loads = [one.still for one in observations if isinstance(one.still, Load)]
    if not loads:
        try:
            loads = read_loads(session)
        except InputError:
            loads = []
    found = typed_load_doubts(loads, session.antenna)
    if before is None or not observations:
        return found
    try:
        free = solve_free(observations, before, session.antenna.length_m, session.moment_std_Nm)
        gravity = gravity_diagnosis(free, kinematics, session.gravity_world_m_s2)
        if gravity is not None:
            return [*found, gravity]
        rows = wrong_rows(free, observations, session.antenna.length_m)
    except SolveError:
        return found
    named = row_diagnoses(rows, len(loads))
    return named or found
