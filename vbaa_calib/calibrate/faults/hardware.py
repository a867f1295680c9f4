"""Faults of the clamp, the wire, gravity and joint readings, and the moment sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vbaa_calib.antenna.shape import PARAMETERS
from vbaa_calib.calibrate.antenna.bundle_adjustment import BundleAdjustment, adjust_bundle, noise_scale
from vbaa_calib.calibrate.antenna.problem import ANTENNA
from vbaa_calib.calibrate.antenna.residual_checks import Checks, check
from vbaa_calib.core.errors import Diagnosis, SolveError
from vbaa_calib.core.least_squares import HUBER, SQUARES, Loss
from vbaa_calib.core.robust import huber_losses, mad_std
from vbaa_calib.geometry import Kinematics
from vbaa_calib.session import STANDARD_GRAVITY_M_S2, Load, Session, Still, gravity_antenna

from .explanations import Further, StillRows, fits, scatter_with_change

_USUAL = 4.0  # a bow is reported beyond so many standard deviations of a careful builder's wire
_LEAST_CHI_SQUARE = 50.0  # a change between stills above this is no chance, however many places were tried
_CLEARER = 1.5  # ratio of χ² of a slip and of a bend from which only one of the two is named
_CLEAR_STD = 4.0
_GIVE_STD = 4.0


class _Kind(NamedTuple):
    """A change of two parameters: which of the joint solve, its size and prior, and the unit and factor to say it in.

    Below `least`, a millimetre at the tip of 240 mm, it is not reported: half a millimetre on the ruler and half a per
    cent on the balance look like a quarter of that. Beyond `most` rows are wrong, or gravity.
    """

    which: list[int]
    least: float
    most: float
    prior_std: float
    unit: str
    factor: float

    def words(self, found: Further) -> str:
        (y, z), (y_std, z_std) = self.factor * found.values, self.factor * found.std
        return f"{y:.2f} ± {y_std:.2f}{self.unit} y and {z:.2f} ± {z_std:.2f}{self.unit} z"


def _indices(*names: str) -> list[int]:
    return [ANTENNA.start + PARAMETERS.index(name) for name in names]


_TURN = _Kind(_indices("clamp_about_y_rad", "clamp_about_z_rad"), 4e-3, 0.15, 0.05, "° about", np.rad2deg(1.0))
_PLACE = _Kind(_indices("clamp_y_m", "clamp_z_m"), 3e-4, 5e-3, 1e-3, " mm along", 1e3)
_BOW = _Kind(_indices("bow_about_y_per_m", "bow_about_z_per_m"), 0.04, 1.5, 0.3, " per m about", 1.0)
(_GIVE,) = _indices("clamp_give_m")


def bow_diagnosis(joint: BundleAdjustment) -> Diagnosis | None:
    """A bow beyond the ordinary."""
    length, which = joint.problem.length_m, _BOW.which
    found = Further(joint.parameters[which], joint.covariance[np.ix_(which, which)])
    bow, prior = found.values, joint.problem.prior.std[np.array(which) - ANTENNA.start]
    if not (np.abs(bow) > _USUAL * np.maximum(prior, found.std)).any():
        return None
    return Diagnosis(
        "antenna_bent",
        f"the free antenna is bowed by {_BOW.words(found)}: "
        f"{0.5e3 * float(np.linalg.norm(bow)) * length**2:.0f} mm at the tip of {1e3 * length:.0f} mm",
        "straighten or replace the wire, or set it with its bow in plane C, and check gravity_world",
    )


class _Step(NamedTuple):
    """A lasting change of a kind, from the still `first` on; `after` are the stills after it, in time."""

    kind: _Kind
    first: int
    found: Further
    after: tuple[int, ...]


def _steps(rows: StillRows) -> list[_Step]:
    """For each kind the change, at the place in time, that explains most; stills without times count in order."""
    times = [one.still.time_s for one in rows.joint.noted]
    whole = list(range(len(times)))
    if not any(time is None for time in times):
        whole = np.argsort(np.array(times, float), kind="stable").tolist()
    order = [index for index in whole if rows.moments[index] >= 0]
    best = []
    for kind in (_TURN, _PLACE, _BOW):
        columns = rows.solution.jacobian[:, kind.which]
        found = []
        for split in range(1, len(order)):
            change = rows.further(np.where(rows.of_stills(order[split:])[:, None], columns, 0.0), kind.prior_std)
            if change is not None:
                found.append(_Step(kind, order[split], change, tuple(whole[whole.index(order[split]) :])))
        best += [max(found, key=lambda step: step.found.chi_square)] if found else []
    return sorted(best, key=lambda step: step.found.chi_square, reverse=True)


def step_diagnosis(joint: BundleAdjustment, rows: StillRows, own_scatter: float) -> Diagnosis | None:
    """A slip of the clamp or a bend of the antenna between two stills, whichever explains the pictures better; None
    where neither leaves no more than the pictures' own scatter."""
    found = _steps(rows)
    if not found or found[0].found.chi_square < _LEAST_CHI_SQUARE:
        return None
    best = found[0]
    # what the pictures do not show is no change, however large it may be
    if not best.kind.least <= float(np.linalg.norm(best.found.clear(_CLEAR_STD))) <= best.kind.most:
        return None
    if not fits(scatter_with_change(joint, best.kind.which, best.after, best.kind.prior_std), own_scatter):
        return None
    rivals = [step for step in found[1:] if step.found.chi_square * _CLEARER > best.found.chi_square]
    still = joint.noted[best.first].still
    kind = "load" if isinstance(still, Load) else "no-load frame"
    named = f"{kind} {still.image.name}" if still.image else f"a {kind} at tilt {np.rad2deg(still.tilt_rad):.0f}°"
    since = f"from {named} on"
    if best.kind is _BOW and not rivals:
        return Diagnosis(
            "antenna_bent_between",
            f"the antenna is bent by {_BOW.words(best.found)} more {since} than before",
            "a load has bent it for good: straighten or replace the wire, then take no-load frames and loads anew, "
            "with lighter loads",
            severity="wrong",
        )
    slip = next((step for step in found if step.kind is not _BOW), best)
    other = ", or the antenna was bent" if any(step.kind is _BOW for step in (*rivals, best)) else ""
    moved = "moved" if slip.kind is _PLACE else "turned"
    return Diagnosis(
        "clamp_slipped_or_antenna_bent" if other else "clamp_slipped",
        f"the clamp has {moved} by {slip.kind.words(slip.found)} {since}, which the loads do not explain{other}",
        "tighten the clamp, then take no-load frames and loads anew",
        severity="wrong",
    )


def soft_clamp(rows: StillRows) -> Diagnosis | None:
    """A clamp that turns elastically, by more than one that is screwed tight does."""
    parameters, covariance = rows.estimate()
    value, std = float(parameters[_GIVE]), float(np.sqrt(covariance[_GIVE, _GIVE]))
    usual = float(rows.joint.problem.prior.std[_GIVE - ANTENNA.start])
    if value < _GIVE_STD * max(usual, std):
        return None
    return Diagnosis(
        "clamp_soft",
        f"the clamp turns with the load as {1e3 * value:.2f} ± {1e3 * std:.2f} mm more of the antenna would, a tight "
        f"one by {1e3 * usual:.1f} mm at most",
        "clamp it over a longer piece, between metal, and check where the distances are measured from",
    )


_STEPS, _CONVERGED = 8, 0.02  # gauss-Newton steps under another gravity: it is compared roughly, not to the last digit
_LEAST_GAIN, _LEAST_PART = 60.0, 0.1  # decrease of χ² that another gravity must bring, over the scatter, and as a part
_CONTRADICTED = 1e-3  # chance of the moments' scatter under another gravity, below which that is not right either
_LEAST_LIKELIER, _MOST_TRIED = 10.0, 3  # logarithm of the likelihoods' ratio; gravities that are solved with in full
_FEWEST_LOADS = 2  # with fewer, EI and the sensor's gain follow a compressed picture's errors to another gravity
_ALIKE_PART = 0.1  # others within this part of the gain fit as well
_SAME_M_S2 = 0.5  # gravities that differ by less in every frame are the same
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


def gravity_diagnosis(
    free: BundleAdjustment, kinematics: Kinematics, gravity_world_m_s2: np.ndarray, own_scatter: float
) -> Diagnosis | None:
    """Another direction of gravity, or another reading of the joints, under which the pictures fit well; many fit a
    slipping clamp or a kink better than the noted one. free : solution of the no-load frames, or of all stills, without
    the moment sensor.
    """
    observations = free.problem.observations
    noted = np.array([one.gravity_m_s2 for one in observations])
    now, scatter = _refitted(free, noted, free.solution.parameters)
    if fits(scatter, own_scatter):
        return None
    others = _hypotheses([one.still for one in observations], kinematics, gravity_world_m_s2, noted)
    begin = free.problem.begin
    tried = sorted(((*_refitted(free, pull, begin), other) for other, pull in others), key=lambda one: one[0])
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


def gravity_by_stills(
    joint: BundleAdjustment, kinematics: Kinematics, session: Session, own_scatter: float
) -> Diagnosis | None:
    """The same by pictures and moments together, which tell apart what either alone fits: a bow looks like another sag,
    but it does not weigh, nor turn with the tilt. joint : of all stills."""
    if sum(isinstance(one.still, Load) for one in joint.noted) < _FEWEST_LOADS:
        return None
    std, prior, length_m = session.moment_std_Nm, joint.problem.prior, joint.problem.length_m
    problem = replace(joint.problem, moment_std_Nm=std, kept=np.ones_like(joint.kept))
    noted, stills = np.array([one.gravity_m_s2 for one in joint.noted]), [one.still for one in joint.noted]

    def least(pull: np.ndarray, noise_scale: float, loss: Loss) -> float:
        """Least cost under a gravity (F, 3), to first order."""
        each = zip(problem.observations, pull, strict=True)
        pulled = replace(problem, observations=[replace(one, gravity_m_s2=g) for one, g in each])
        now = replace(pulled, noise_scale=noise_scale).linearised(joint.solution.parameters)
        now = replace(now, loss=loss)
        return now.cost - now.step(0.0)[1]

    now = least(noted, own_scatter, SQUARES)
    others = _hypotheses(stills, kinematics, session.gravity_world_m_s2, noted)
    likely = sorted(
        ((least(pull, own_scatter, SQUARES), other, pull) for other, pull in others), key=lambda one: one[0]
    )
    fitting = []
    for cost, other, pull in likely[:_MOST_TRIED]:
        if not cost < now - _LEAST_LIKELIER:
            continue
        observations = [replace(one, gravity_m_s2=each) for one, each in zip(joint.noted, pull, strict=True)]
        try:
            tried = adjust_bundle(observations, prior, length_m, std)
        except SolveError:
            continue
        fit = fits(tried.noise_scale, own_scatter) and check(tried).noise_chance(std) > _CONTRADICTED
        likelier = least(noted, tried.noise_scale, HUBER) - tried.solution.cost
        if tried.kept.all() and fit and likelier > _LEAST_LIKELIER:
            fitting.append((likelier, other))
    if not fitting:
        return None
    most, best = max(fitting, key=lambda one: one[0])
    alike = [other.words for likelier, other in fitting if other is not best and likelier > most - _LEAST_LIKELIER]
    return replace(best, words=f"the antenna's pictures look as if {' or '.join([best.words, *alike])}, not as noted")


def _refitted(free: BundleAdjustment, gravity_m_s2: np.ndarray, start: np.ndarray) -> tuple[float, float]:
    """χ² and scatter of the points, over claimed deviations, with all solved again under a gravity (F, 3)."""
    problem = free.problem
    observations = [
        replace(one, gravity_m_s2=pull) for one, pull in zip(problem.observations, gravity_m_s2, strict=True)
    ]
    kept = np.ones(len(observations), bool)
    problem = replace(problem, observations=observations, noise_scale=1.0, kept=kept)
    now = problem.linearised(start)
    for _ in range(_STEPS):
        # without robust weights: far from the antenna nearly all points would count as outliers
        scale = np.linalg.norm(now.jacobian, axis=0)
        step = -np.linalg.lstsq(now.jacobian / scale, now.residuals, rcond=None)[0] / scale
        try:
            moved = problem.linearised(now.parameters + step)
        except ValueError:
            # an impossible gravity winds the antenna up: no further
            break
        before, after = float(now.residuals @ now.residuals), float(moved.residuals @ moved.residuals)
        if not after < before:
            break
        now = moved
        if after > (1 - _CONVERGED) * before:
            break
    # the points' own: a bow that is not ordinary is no sign of another gravity
    points = now.residuals[: -now.certain]
    lines = np.split(points, np.cumsum([*map(len, problem.seen_at_lens)]))[:-1]
    return 2.0 * float(huber_losses(points).sum()), noise_scale(lines)


def _hypotheses(
    stills: Sequence[Still], kinematics: Kinematics, gravity_world_m_s2: np.ndarray, noted_m_s2: np.ndarray
) -> list[tuple[Diagnosis, np.ndarray]]:
    """What could be wrong with gravity or joint readings, and gravity (F, 3) in the frames if it were."""
    worlds = {f"gravity pointed to {name} of the world": STANDARD_GRAVITY_M_S2 * axis for name, axis in _AXES.items()}
    if gravity_world_m_s2.any():
        worlds["there were no gravity"] = np.zeros(3)
    found = []
    for words, gravity in worlds.items():
        numbers = ", ".join(f"{value + 0.0:g}" for value in gravity)
        remedy = f"gravity_world: [{numbers}] in session.yaml would fit; check where the world's axes point"
        pull = gravity_antenna(kinematics, gravity, stills)
        found.append((Diagnosis("gravity_direction", words, remedy, "wrong"), pull))
    for words, what, turn in _JOINT_SLIPS:
        angles = [turn @ (one.pan_rad, one.tilt_rad) for one in stills]
        moved = [replace(one, pan_rad=float(a[0]), tilt_rad=float(a[1])) for one, a in zip(stills, angles, strict=True)]
        pull = gravity_antenna(kinematics, gravity_world_m_s2, moved)
        found.append((Diagnosis("joint_readings_wrong", words, f"correct {what}, in all tables", "wrong"), pull))
    different: list[tuple[Diagnosis, np.ndarray]] = []
    for one in found:
        if all(np.abs(one[1] - known).max() > _SAME_M_S2 for known in (noted_m_s2, *(pull for _, pull in different))):
            different.append(one)
    return different


_LEAST_SPREAD_STD = 30.0  # range of the moments, in the sensor's deviations, from which its gain can be judged
_UNITS = (
    ("N·mm", 1e3, "divide the readings by 1000"),
    ("mN·m", 1e3, "divide the readings by 1000"),
    ("N·cm", 1e2, "divide the readings by 100"),
    ("kgf·m", 1 / STANDARD_GRAVITY_M_S2, "multiply the readings by 9.80665"),
    ("kgf·cm", 100 / STANDARD_GRAVITY_M_S2, "divide the readings by 10.197"),
    ("gf·cm", 1e5 / STANDARD_GRAVITY_M_S2, "divide the readings by 10197"),
    ("kN·m", 1e-3, "multiply the readings by 1000"),
    ("µN·m", 1e6, "divide the readings by 1000000"),
    ("lbf·in", 8.8507, "divide the readings by 8.8507"),
    ("ozf·in", 141.61, "divide the readings by 141.61"),
    ("lbf·ft", 0.73756, "divide the readings by 0.73756"),
    ("decimetres for metres", 1e1, "divide the readings by 10"),
)
_UNIT_REACH = 0.15  # logarithm within which a gain is a unit's: an honest sensor is that good before it is calibrated;
_UNIT_SHARE = 0.3  # and this part of the unit's own, at most
_USUAL_GAIN = (0.5, 2.0)
_DEAD_GAIN = 0.1
_EXPLAINED = 0.5  # part of the readings' spread that a working sensor's gain and offset explain at least
_SIGNIFICANT_STD = 4.0


def sensor_diagnoses(joint: BundleAdjustment, std_Nm: float, checks: Checks, moments_known: bool) -> list[Diagnosis]:
    """What is wrong with the sensor; at most one of wiring, sign, unit and drift.

    moments_known : the loads are as noted. If not, only an unconnected sensor can be recognised.
    """
    moments = joint.problem.evaluate(joint.solution.parameters).moments
    read = np.array([one.still.moment_Nm for one in joint.noted])[joint.kept]
    true = moments[joint.kept, 0]
    if len(read) < 3 or not np.isfinite(read).all() or np.ptp(true) / std_Nm < _LEAST_SPREAD_STD:
        return []
    spread = f"while the true moments span {1e3 * np.ptp(true):.3g} mN·m"
    if np.ptp(read) <= 1e-3 * std_Nm:
        words = f"all {len(read)} moment readings are {read[0]:.4g} N·m, {spread}"
        remedy = "connect the sensor, or leave moment_Nm to what it reads, not to a zero typed in"
        return [Diagnosis("sensor_not_connected", words, remedy, "wrong")]
    if not moments_known:
        return []
    # the line through readings and true moments by Theil and Sen's medians
    i, j = np.triu_indices(len(true), 1)
    far = np.abs(true[j] - true[i]) > 0.2 * np.ptp(true)
    gain = float(np.median((read[j] - read[i])[far] / (true[j] - true[i])[far]))
    left = read - gain * true - float(np.median(read - gain * true))
    std = max(mad_std(left), std_Nm) / max(float(np.sqrt(((true - true.mean()) ** 2).sum())), 1e-12)
    about = np.median(np.abs(read - np.median(read)))
    follows = float(1.0 - np.median(np.abs(left)) / max(about, 1e-15)) > _EXPLAINED
    off = {one: abs(np.log(max(abs(gain), 1e-15) / one[1])) for one in _UNITS}
    units = [one for one in _UNITS if off[one] < min(_UNIT_REACH, _UNIT_SHARE * abs(np.log(one[1])))]
    units.sort(key=off.__getitem__)
    known, words = f"gain {gain:.3g} ± {std:.2g}", f"the moment sensor's gain is {gain:.4g} ± {std:.2g}"
    weak = abs(gain) < max(_DEAD_GAIN, _SIGNIFICANT_STD * std) or np.ptp(read) < _SIGNIFICANT_STD * 2 * std_Nm
    if weak and not (follows and units):
        words = f"the moment readings do not follow the loads: {known}, {spread}"
        remedy = (
            "check that the sensor is connected, sits between clamp and base, and that each row has its own reading"
        )
        return [Diagnosis("sensor_not_connected", words, remedy, "wrong")]
    if not follows:
        return []
    read_in = f", as if it were read in {' or '.join(unit for unit, *_ in units)}" if units else ""
    if gain < 0 and (gain <= -_SIGNIFICANT_STD * std or units):
        remedy = "exchange its two leads, or change the sign of moment_Nm in all tables, the recording's too"
        remedy = f"{remedy}; {units[0][2]}: moment_Nm is in N·m" if units else remedy
        words = f"the moment sensor reads with the wrong sign: {known}{read_in}"
        return [Diagnosis("sensor_sign", words, remedy, "wrong" if units else "doubt")]
    usual = _USUAL_GAIN[0] < gain < _USUAL_GAIN[1]
    if gain > 0 and (units or not usual):
        if units:
            remedy = f"{units[0][2]}: moment_Nm is in N·m"
            return [Diagnosis("sensor_unit", f"{words}{read_in}", remedy, "doubt" if usual else "wrong")]
        return [Diagnosis("sensor_gain", f"{words}, far from 1", "check its calibration and the unit of moment_Nm")]
    drift = checks.drift_Nm
    if drift is None or abs(drift.in_std) <= _SIGNIFICANT_STD:
        return []
    moved = f"{1e3 * drift.value:.2g} ± {1e3 * drift.std:.2g} mN·m per {checks.drift_per}"
    words = f"the moment readings drift by {moved}, or a few readings are wrong"
    remedy = "let it warm up, zero it again before a recording, and check that it is not at the end of its range"
    return [Diagnosis("sensor_drift", words, remedy)]
