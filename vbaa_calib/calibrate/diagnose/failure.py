"""What can be said of a session whose calibration did not come to an end."""

from __future__ import annotations

from collections.abc import Sequence

from ...diagnosis import Diagnosis
from ...errors import InputError, SolveError, VbaaError
from ...geometry import Kinematics
from ...session import Load, Session, read_loads, read_noload
from ..joint import solve_joint
from ..joint_problem import Observation, Prior
from ..session_rig import nominal_parameters
from ..stills import observe
from .free_base import DEAF, solve_free
from .gravity import gravity_diagnosis
from .load_rows import row_diagnoses, unexplained, wrong_rows
from .scatter import own_scatter
from .still_diagnoses import still_diagnoses
from .typed_loads import typed_load_doubts


def with_cause(session: Session, kinematics: Kinematics, before: Prior, error: SolveError) -> SolveError | InputError:
    """What to raise instead of an error of `solve_antenna`: with its likely cause, where one is found."""
    nominal = nominal_parameters(session.antenna)
    try:
        free = observe(session, kinematics, read_noload(session), before.camera, before.start, nominal, "free antenna")
        loaded = observe(
            session, kinematics, read_loads(session), before.camera, before.start, nominal, "known loads", free[0].paint
        )
    except VbaaError:
        # nothing was seen: the error says that better
        return error
    causes = explain_failure(session, kinematics, [*free, *loaded], before)
    typed = [one for one in causes if one.name.startswith("load_")]
    if typed:
        return InputError(f"{error}. {typed[0].words}", remedy=typed[0].remedy)
    return SolveError(f"{error}. Likely: {causes[0]}") if causes else error


def explain_failure(
    session: Session, kinematics: Kinematics, observations: Sequence[Observation], before: Prior
) -> list[Diagnosis]:
    """What a calibration that raised may have failed of: by the typed loads, and by the free antenna. Raises nothing.

    observations, before : what `solve_antenna` was to solve.
    """
    loads: list[Load] = [one.still for one in observations if isinstance(one.still, Load)]
    found = typed_load_doubts(loads, session.antenna)
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
