"""The error budget of a rig: what each cause contributes to contacts, and what knowing it better would gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estimator.contact.settings import ContactSettings
from estimator.solver.linearised import edge_on
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.core.errors import InputError
from vbaa_calib.rig import Rig

from .parts import (
    FORCE_PRIOR,
    FRICTION,
    JOINT_AXES,
    LENS,
    MOMENT_NOISE,
    PIXELS,
    RESULTS,
    BudgetContacts,
    ErrorSpace,
    Linearization,
    correlated_variance,
    linearize,
    ordinary_touches,
    per_result,
    propagate,
    unknowns_of,
    variance_by_cause,
)


class _ErrorCause(NamedTuple):
    """Of errors: its name and colour in tables and figures, and what to do about it."""

    name: str
    colour: str
    remedy: str


_JIG = "take more pictures of the board in the jig, with a better jig, or a sweep of the joints"
_NO_LOAD = "take more pictures of the free antenna, at several tilts, and calibrate again"
_LOADS = "hang more loads, heavier and at several distances, weighed and measured with a caliper"
_LENS = "take more pictures of the board for the lens, up to the borders of the picture"
_CAMERA = "bring the camera nearer, take one with more pixels or a longer lens, or light the antenna better"
_SENSOR = "take a quieter moment sensor, or average more readings per picture"
_AXES = "repeat the sweep of the joints with more poses, or measure the axes"
_FORCE = "give the moment reading: the picture alone hardly holds the force here"
_POLISH = "polish or grease the antenna, and say with --friction how slippery it is"
_WEIGH = "weigh the antenna, or take more pictures of it free at several tilts"
CAUSES = {
    PIXELS: _ErrorCause("pixel noise", "#0f766e", _CAMERA),
    MOMENT_NOISE: _ErrorCause("moment noise", "#b45309", _SENSOR),
    FRICTION: _ErrorCause("friction angle", "#7c3aed", _POLISH),
    LENS: _ErrorCause("lens", "#1d4ed8", _LENS),
    "camera_rotation": _ErrorCause("camera rotation", "#0ea5e9", _JIG),
    "camera_position": _ErrorCause("camera position", "#7dd3fc", _JIG),
    "clamp_angle": _ErrorCause("clamp angle", "#15803d", _NO_LOAD),
    "clamp_offset": _ErrorCause("clamp offset", "#4ade80", _NO_LOAD),
    "clamp_give": _ErrorCause("clamp give", "#a3e635", _LOADS + "; or stiffen the clamp"),
    "bow": _ErrorCause("bow", "#facc15", _NO_LOAD),
    "stiffness": _ErrorCause("stiffness EI", "#dc2626", _LOADS),
    "mass": _ErrorCause("mass", "#fda4af", _WEIGH),
    "moment_gain": _ErrorCause("moment gain", "#f97316", _LOADS),
    "moment_offset": _ErrorCause("moment offset", "#fdba74", "take more readings without a load"),
    "sensor_axes": _ErrorCause("sensor axes", "#fed7aa", _LOADS),
    JOINT_AXES: _ErrorCause("joint axes", "#78716c", _AXES),
    FORCE_PRIOR: _ErrorCause("likely force", "#cbd5e1", _FORCE),
}
"""Every cause, in the order in which figures stack them."""
ADVISED = ("distance_m", "force_N", "point_m")  # results that the advice is about
OWN = (PIXELS, MOMENT_NOISE, FRICTION, FORCE_PRIOR)  # causes that are not the calibration's


@dataclass(frozen=True)
class CausePart:
    """One cause's part of one result, rms over the contacts, in the result's unit."""

    std: float  # the deviation that it contributes; squares add up
    share: float  # of the variance
    if_halved: float  # the result's whole deviation if the cause's were half of what it is
    if_exact: float  # or none


@dataclass(frozen=True)
class ResultBudget:
    """One result's budget, rms over the contacts."""

    std: float  # whole deviation
    in_common: float  # share of the variance that belongs to no one cause, by correlations; the parts hold it divided
    parts: dict[str, CausePart]  # by cause; they add up

    @property
    def first(self) -> str:
        """The cause of which half the deviation would help most."""
        return max(self.parts, key=self.gain)

    def gain(self, cause: str) -> float:
        """The part that half a cause's deviation would take off this result's."""
        return 1.0 - self.parts[cause].if_halved / self.std

    @property
    def common_std(self) -> float:
        """What the calibration contributes: it is common to all frames, and does not average out."""
        return float(np.sqrt(sum(part.std**2 for cause, part in self.parts.items() if cause not in OWN)))


@dataclass(frozen=True, eq=False)
class Budget:
    """The error budget of a rig."""

    touches: BudgetContacts  # B contacts that would come with numbers
    asked: int  # of so many
    results: dict[str, ResultBudget]  # by `RESULTS`
    variances: dict[str, np.ndarray]  # cause → (B, 6) of the rows that `RESULTS` names
    exact: tuple[str, ...]  # causes that rig.json says are exact, or nothing of
    notes: tuple[str, ...]

    def gain(self, cause: str) -> float:
        """Mean part that half a cause's deviation would take off distance, force and point."""
        return float(np.mean([self.results[name].gain(cause) for name in ADVISED]))

    @property
    def first(self) -> str:
        """The cause to improve first, by `gain`."""
        return max(self.results["point_m"].parts, key=self.gain)

    @property
    def first_of_rig(self) -> str | None:
        """The same among what a calibration finds. None where the rig counts as exact."""
        return max((cause for cause in self.variances if cause not in OWN), key=self.gain, default=None)

    def leads(self, name: str) -> dict[str, int]:
        """In how many contacts each cause has the largest part of a result; causes that lead nowhere are left out."""
        causes = list(self.variances)
        largest = np.argmax([per_result(rows)[name] for rows in self.variances.values()], axis=0)
        count = np.bincount(largest, minlength=len(causes))
        return {causes[i]: int(count[i]) for i in np.argsort(-count, kind="stable") if count[i]}


def error_budget(
    rig: Rig, touches: BudgetContacts | None = None, *, friction: float = FRICTION_RAD, with_moment: bool = True
) -> Budget:
    """The budget of a rig, by default over ordinary contacts; `with_moment` False for vision alone.

    `friction` is the deviation of the friction angle, rad, as the estimator assumes it. Raises InputError where it is
    out of range, or where there is no contact for which the estimator would give numbers.
    """
    if not 0.0 <= friction <= 1.0:
        raise InputError(f"friction is {friction}", remedy="give the angle's deviation in rad, 0 to 1")
    touches = ordinary_touches(rig) if touches is None else touches
    with_moment = with_moment and any(rig.reading_noise)
    rig_arrays = RigArrays.from_rig(rig, float(friction), drift=False)
    space = ErrorSpace.of(rig_arrays)
    with np.errstate(all="ignore"):  # what leaves the domain of the model is left out below
        every = linearize(rig_arrays, space, touches, with_moment)
        determined = _determined(rig_arrays, space, touches, every, with_moment)
    if not determined.any():
        which = f"any of {len(determined)} contacts" if len(determined) > 1 else "this"
        raise InputError(
            f"the estimator would give no numbers for {which}",
            where="budget",
            remedy="give a contact that is pressed harder and in the picture, or calibrate the rig better",
        )
    linear = every.picked(determined)
    now = propagate(linear, space)
    by_cause = {cause: part for cause, part in variance_by_cause(space, now).items() if part.any()}
    without = () if with_moment else (MOMENT_NOISE, "moment_gain", "moment_offset")
    several = with_moment and rig.wrench_sensor is not None
    aside = (FORCE_PRIOR, *without, *([] if several else ["sensor_axes"]))
    whole, shared = _mean(now.variance), _mean(correlated_variance(space, now))
    parts: dict[str, dict[str, CausePart]] = {name: {} for name in RESULTS}
    for cause, rows in by_cause.items():
        own, halved, exact = _mean(rows), whole, whole
        if cause != FORCE_PRIOR:
            halved, exact = (_mean(propagate(linear, space, cause, factor).variance) for factor in (0.5, 0.0))
        for name in RESULTS:
            std, if_halved, if_exact = (float(np.sqrt(each[name])) for each in (own, halved, exact))
            parts[name][cause] = CausePart(std, own[name] / whole[name], if_halved, if_exact)
    results = {
        name: ResultBudget(float(np.sqrt(whole[name])), shared[name] / whole[name], parts[name]) for name in RESULTS
    }
    exact_causes = tuple(cause for cause in CAUSES if cause not in (*by_cause, *aside))
    notes = []
    if not rig.covariance.any():
        notes.append("rig.json says that the whole rig is exact: nothing of the calibration is counted. Calibrate it.")
    elif not rig.with_lens:
        notes.append(
            "The joint covariance in rig.json is without the lens: the lens counts as exact here. Calibrate again with "
            "`vbaa calibrate`, which keeps it."
        )
    if rig.kinematics.axes_known:
        notes.append("The joint axes count as exact: no sweep has measured them.")
    if not with_moment:
        notes.append("Vision alone: no moment reading counts.")
    return Budget(touches.picked(determined), len(determined), results, by_cause, exact_causes, tuple(notes))


def _determined(
    rig_arrays: RigArrays, space: ErrorSpace, touches: BudgetContacts, linear: Linearization, with_moment: bool
) -> np.ndarray:
    """(B,) whether the estimator would give numbers, as `contact.status` decides for contacts that fit well."""
    sound = np.isfinite(linear.points).all(axis=(1, 2)) & (linear.usable >= ContactSettings.fewest_points)
    std = np.full((len(linear), 6), np.nan)
    if sound.any():
        std[sound] = np.sqrt(propagate(linear.picked(sound), space).variance)
    relative_m = ContactSettings.low_signal_relative * touches.distance_m
    limit = np.minimum(ContactSettings.low_signal * rig_arrays.length_m, relative_m)
    determined = np.isfinite(std).all(axis=1) & (std[:, 0] < limit)
    if with_moment:
        return determined
    force = np.hypot(*touches.push_N.T)
    seen = edge_on(rig_arrays, unknowns_of(rig_arrays, touches)) >= ContactSettings.edge_on_blind_rad
    return determined & seen & (std[:, 1:3].max(axis=1) < 0.5 * force)


def _mean(rows: np.ndarray) -> dict[str, float]:
    return {name: float(values.mean()) for name, values in per_result(rows).items()}
