"""Diagnoses of a session's stills: loads, antenna, clamp, moment sensor, gravity and joint readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle
from vbaa_calib.calibrate.antenna.inputs import Observation, Prior
from vbaa_calib.calibrate.antenna.residual_checks import check
from vbaa_calib.core.errors import Diagnosis, InputError, SolveError
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import Load, Session

from .explanations import SENSOR_OFF, StillRows, fits, picture_scatter, solve_free, worst_still
from .hardware import bow_diagnosis, gravity_by_stills, gravity_diagnosis, sensor_diagnoses, soft_clamp, step_diagnosis
from .loads import (
    Row,
    all_by_commonest,
    corrected,
    row_diagnoses,
    typed_load_diagnoses,
    unexplained,
    wrong_rows,
)

_CONTRADICTS = 5.0  # scatter of the points, over their pictures' own, beyond which the stills contradict each other
_ONE_CONTRADICTS = 20.0  # the same of a single still; clean sessions have one at 5 now and then


def still_diagnoses(session: Session, kinematics: Kinematics, joint: BundleAdjustment) -> list[Diagnosis]:
    """What is wrong with loads, antenna, clamp, moment sensor, gravity and joint readings; a fault that explains others
    comes first, and these are then not looked for. joint : of all stills, from `solve_antenna`."""
    length = _tips(joint)
    # the other causes follow from the lines alone, whatever the length is
    problem = joint.problem.without_tips()
    problem = replace(problem, prior=replace(problem.prior, tip_std_m=None))
    solution = replace(problem.linearised(joint.solution.parameters), converged=True)
    joint = replace(joint, problem=problem, solution=solution)
    return [*length, *_diagnoses(session, kinematics, joint)]


def _diagnoses(session: Session, kinematics: Kinematics, joint: BundleAdjustment) -> list[Diagnosis]:
    problem, own = joint.problem, picture_scatter(joint.noted)
    gravity = gravity_by_stills(joint, kinematics, session, own)
    if gravity is not None:
        return [gravity, *_sensor(session, joint, False)]
    try:
        free: BundleAdjustment | None = solve_free(joint.noted, problem.prior, problem.length_m, problem.moment_std_Nm)
    except SolveError:
        free = None
    if free is not None:
        gravity = gravity_diagnosis(free, kinematics, session.gravity_world_m_s2, own)
        if gravity is not None:
            return [gravity, *_sensor(session, joint, False)]
    rows = wrong_rows(free, joint.noted, problem.length_m) if free is not None else []
    named = [row for row in rows if row.entry is not None]
    if named:
        count = sum(isinstance(one.still, Load) for one in joint.noted)
        # one slip in all rows is likelier than several
        for tried in (all_by_commonest(named, joint.noted, problem.length_m), rows):
            if tried and _fit_corrected(joint, tried, own):
                right, odd = [[row for row in tried if (row.entry is None) == none] for none in (False, True)]
                return [*row_diagnoses(right, count), *unexplained(odd), *_sensor(session, joint, False)]
        return [_contradiction(joint, own, rows), *_sensor(session, joint, False)]
    found = _moved(session, kinematics, joint, free, own)
    if rows and not any(one.grave for one in found):
        found = unexplained(rows)
    elif not found and (joint.noise_scale > _CONTRADICTS * own or worst_still(joint) > _ONE_CONTRADICTS * own):
        found = [_contradiction(joint, own, rows)]
    sensor = _sensor(session, joint, not found)
    return [*found, *sensor]


def _tips(joint: BundleAdjustment) -> list[Diagnosis]:
    """Whether the antenna's ends contradict its length; they are then not used."""
    gap = joint.tip_gap_std
    if len(joint.problem.tips) or np.isnan(gap):
        return []
    words = "the antenna's ends do not agree on its length"
    if np.isfinite(gap):
        where = "beyond" if gap > 0 else "short of"
        size = f"about {1e3 * abs(joint.tip_gap_m):.0f} mm ({abs(gap):.0f} deviations)"
        words = f"the antenna's ends lie {size} {where} antenna.length_m"
    remedy = (
        "measure length_m from the clamp to the tip again, check the jig's distance, or set antenna.tip: null where "
        "the visible end is not the tip"
    )
    return [Diagnosis("antenna_length", f"{words} in the pictures; they were not used", remedy)]


def _moved(
    session: Session, kinematics: Kinematics, joint: BundleAdjustment, free: BundleAdjustment | None, own: float
) -> list[Diagnosis]:
    """Gravity, what moved between stills, or else bow and clamp."""
    linear, problem = StillRows.of(joint), joint.problem
    if free is not None:
        linear = linear.with_readings(min(free.noise_scale, joint.noise_scale))
    if not fits(joint.noise_scale, own):
        without_sensor = replace(problem, moment_std_Nm=SENSOR_OFF * problem.moment_std_Nm)
        gravity = gravity_diagnosis(replace(joint, problem=without_sensor), kinematics, session.gravity_world_m_s2, own)
        if gravity is not None:
            return [gravity]
    moved = step_diagnosis(joint, linear.without_sensor(), own)
    found = [moved] if moved is not None else [bow_diagnosis(joint), soft_clamp(linear)]
    return [one for one in found if one is not None]


def _fit_corrected(joint: BundleAdjustment, rows: Sequence[Row], own: float) -> bool:
    """Whether all stills fit one antenna once the rows are corrected."""
    problem, observations = joint.problem, corrected(joint.noted, rows)
    try:
        right = adjust_bundle(observations, problem.prior, problem.length_m, SENSOR_OFF * problem.moment_std_Nm)
    except SolveError:
        return False
    return fits(right.noise_scale, own) and worst_still(right) <= _ONE_CONTRADICTS * own


def _contradiction(joint: BundleAdjustment, own: float, rows: Sequence[Row]) -> Diagnosis:
    names = [
        one.still.image.name if one.still.image else f"no {index + 1}"
        for index, (one, kept) in enumerate(zip(joint.noted, joint.kept, strict=True))
        if not kept
    ]
    names += [row.load.image.name for row in rows if row.load.image and row.load.image.name not in names]
    off = max(float(joint.noise_scale), worst_still(joint)) / own
    which = f", {', '.join(names[:3])} the most" if names else ""
    return Diagnosis(
        "stills_contradict",
        f"the pictures do not fit one antenna: the points lie up to {off:.0f} times further off it than their own "
        f"scatter{which}; no single cause explains it",
        "check unit, sign and place of every load, the joints' angles (rad), gravity_world, and that nothing moved",
        severity="wrong",
    )


def _sensor(session: Session, joint: BundleAdjustment, moments_known: bool) -> list[Diagnosis]:
    return sensor_diagnoses(joint, session.moment_std_Nm, check(joint), moments_known)


def with_cause(error: SolveError, causes: Sequence[Diagnosis]) -> SolveError | InputError:
    """An error of `solve_antenna` with the likeliest of its `failure_causes`, or that none is found."""
    typed = [one for one in causes if one.name.startswith("load_")]
    if typed:
        return InputError(f"{error}. {typed[0].words}", remedy=typed[0].remedy)
    if causes:
        return SolveError(f"{error}. Likely: {causes[0]}")
    return SolveError(
        f"{error}. No load, reading or joint angle explains it: look at the antenna's pictures with vbaa look, "
        "add views of the board over the whole picture, or choose another --lens-model"
    )


def failure_causes(
    session: Session, kinematics: Kinematics, observations: Sequence[Observation], before: Prior
) -> list[Diagnosis]:
    """Likely causes of a calibration that raised, from the typed loads and the free antenna. Raises nothing."""
    loads: list[Load] = [one.still for one in observations if isinstance(one.still, Load)]
    found = typed_load_diagnoses(loads, session.antenna)
    length, std = session.antenna.length_m, session.moment_std_Nm
    try:
        # without the sensor, which may be what is wrong
        joint = adjust_bundle(observations, before, length, SENSOR_OFF * std)
        return still_diagnoses(session, kinematics, joint) or found
    except SolveError:
        pass
    try:
        free = solve_free(observations, before, length, std)
    except SolveError:
        return found
    gravity = gravity_diagnosis(free, kinematics, session.gravity_world_m_s2, picture_scatter(observations))
    if gravity is not None:
        return [gravity]
    rows = wrong_rows(free, observations, length)
    return row_diagnoses(rows, len(loads)) or found or unexplained(rows)
