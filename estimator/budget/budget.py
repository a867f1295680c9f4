"""The error budget of a rig: what each cause contributes to contacts, and what knowing it better would gain.

Contacts are taken as a rig would see them, without noise. To first order an estimate is off by
T·C·Jᵀ·W·n − T·C·P·x − D·z: n is the noise of points and readings, weighed by W; z are the independent errors of rig and
joint axes, and x these with the friction angle, all of unit standard deviation, with the prior's weights P. C is the
inverse of JᵀWJ + P. T says how results follow the unknowns, D their errors that no frame determines. Noise and errors
are independent, so that the variance is the sum of their parts.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Any, NamedTuple

import numpy as np

from estimator.contact.common_errors import empty_frames, noise_free_frames
from estimator.contact.settings import ContactSettings
from estimator.solver.frames import Frames
from estimator.solver.linearised import edge_on, linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import FRICTION_RAD
from vbaa_calib.antenna.rungs import REFERENCE
from vbaa_calib.antenna.shape import CONTACT
from vbaa_calib.calibrate.antenna.problem import GAIN, OFFSET
from vbaa_calib.calibrate.guide.next_observation import further_observations
from vbaa_calib.calibrate.guide.settings import GuideSettings
from vbaa_calib.calibrate.pipeline import Calibration
from vbaa_calib.core.arrays import Rows
from vbaa_calib.core.errors import InputError, VbaaError
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig


@dataclass(frozen=True)
class BudgetSettings:
    """The contacts of a rig's budget (ordinary ones, from light to firm touches), and the resolution of its tables."""

    distances: tuple[float, ...] = (0.2, 0.35, 0.5, 0.65, 0.8, 0.95)  # of the contacts, in lengths of the antenna
    # of the antenna at the contact: a light touch, a firm one, nearly as much as is ordinary
    slopes_deg: tuple[float, float, float] = (5.0, 15.0, 30.0)
    directions: int = 8  # around the antenna
    # nearer to the clamp, in lengths, the force stays what it is there: nobody presses harder
    strongest_at: float = 0.5
    steepest_rad: float = float(np.radians(45.0))  # slopes beyond it are not compared with the rod
    force_tolerance: float = 1e-6  # relative error of a force that gives its slope
    force_steps: int = 6  # of Newton's method for it
    # part of itself at which noise counts as gone: without any, a picture would determine all
    exact_noise: float = 0.01
    dependent: float = 1e-7  # a row of unit deviation that adds less than this to others is determined by them
    worthwhile: float = 0.05  # least gain of the results for which halving a deviation is advised
    small: float = 0.005  # causes whose share and gain stay below this part are listed together
    correlated: float = 0.1  # share of a variance that no cause has alone, from which it is reported


RIG_CAUSES = {
    "camera_rotation": POSE_PARAMETERS[:3],
    "camera_position": POSE_PARAMETERS[3:],
    "clamp_offset": ("clamp_y_m", "clamp_z_m"),
    "clamp_angle": ("clamp_about_y_rad", "clamp_about_z_rad"),
    "clamp_give": ("clamp_give_m",),
    "bow": ("bow_about_y_per_m", "bow_about_z_per_m"),
    "stiffness": ("log_stiffness_Nm2",),
    "mass": ("log_mass_per_length_kg_m",),
    "moment_gain": ("moment_gain",),
    "moment_offset": ("moment_offset_Nm",),
}
"""Causes and their rows of the joint covariance; the lens' rows follow them."""
RESULTS = {"distance_m": (0,), "force_y_N": (1,), "force_z_N": (2,), "force_N": (1, 2), "point_m": (3, 4, 5)}
"""Results and the rows that they are made of: of several, the variance is the sum."""


@dataclass(frozen=True, eq=False)
class BudgetContacts(Rows):
    """B contacts, antenna frame, at one pair of joint angles."""

    distance_m: np.ndarray  # (B,)
    push_N: np.ndarray  # (B, 2) force across the clamp's x axis before friction
    pan_rad: float = 0.0
    tilt_rad: float = 0.0


def ordinary_touches(rig: Rig, pan_rad: float = 0.0, tilt_rad: float = 0.0) -> BudgetContacts:
    """Default contacts of a budget: a grid over distance, slope at the contact, and direction of the force around
    the antenna."""
    around = 2.0 * np.pi * (np.arange(BudgetSettings.directions) + 0.5) / BudgetSettings.directions
    grid = np.meshgrid(
        np.array(BudgetSettings.distances) * rig.antenna.length_m,
        np.radians(BudgetSettings.slopes_deg),
        around,
        indexing="ij",
    )
    distance, slope, angle = (part.reshape(-1) for part in grid)
    lever = np.maximum(distance, BudgetSettings.strongest_at * rig.antenna.length_m)
    size = 2.0 * rig.antenna.stiffness_Nm2 * slope / lever**2 / rig.antenna.taper.turning(lever / rig.antenna.length_m)
    return BudgetContacts(distance, size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), pan_rad, tilt_rad)


def _unknowns_of(rig_arrays: RigArrays, touches: BudgetContacts) -> np.ndarray:
    """(B, 4) unknowns in the order of `rig_arrays.UNKNOWNS`, without friction."""
    unknowns = np.zeros((len(touches), UNKNOWNS))
    unknowns[:, 0] = touches.distance_m / rig_arrays.length_m
    unknowns[:, 1:3] = touches.push_N / rig_arrays.force_unit_N
    return unknowns


def touch_of_force(
    rig_arrays: RigArrays, distance_m: float, force_N: np.ndarray, pan_rad: float, tilt_rad: float
) -> BudgetContacts:
    """The contact with the lateral force `force_N` (2,), antenna frame; its push is NaN where it bends the antenna
    too far."""
    touch = BudgetContacts(np.array([distance_m]), force_N[None].astype(float), pan_rad, tilt_rad)
    empty = _empty(rig_arrays, touch)
    unknowns = _unknowns_of(rig_arrays, touch)
    with np.errstate(all="ignore"):
        for _ in range(BudgetSettings.force_steps):
            there = linearised(empty, REFERENCE, unknowns)
            slopes = there.columns[:, 4:6, 1:3]
            if not np.isfinite(slopes).all():
                break
            unknowns[:, 1:3] += np.linalg.solve(slopes, (force_N - there.point_force[:, 4:6])[..., None])[..., 0]
        there = linearised(empty, REFERENCE, unknowns)
        found = np.abs(there.point_force[0, 4:6] - force_N).max() <= BudgetSettings.force_tolerance * np.hypot(*force_N)
        ordinary = there.tangents[0, :, CONTACT] @ there.tangents[0, :, 0] >= np.cos(BudgetSettings.steepest_rad)
    return replace(touch, push_N=unknowns[:, 1:3] * (rig_arrays.force_unit_N if found and ordinary else np.nan))


def _world_rotation(rig: Rig, touches: BudgetContacts) -> np.ndarray:
    """(3, 3) rotation from the antenna frame to the world's at the contacts' joint angles."""
    return np.asarray(rig.kinematics.T_world_antenna(touches.pan_rad, touches.tilt_rad).rotation)


def _empty(rig_arrays: RigArrays, touches: BudgetContacts) -> Frames:
    gravity = _world_rotation(rig_arrays.rig, touches).T @ rig_arrays.rig.gravity_world_m_s2
    return empty_frames(rig_arrays, np.tile(gravity, (len(touches), 1)))


@dataclass(frozen=True, eq=False)
class _ErrorSpace:
    """S independent errors of unit standard deviation that span all errors of rig and joint axes."""

    causes: tuple[str, ...]  # G that have any error, of `RIG_CAUSES`, "lens", "sensor_axes" and "joint_axes"
    determined: np.ndarray  # (G, S, S) projector onto the errors determined once a cause is known, by correlation, too
    determined_by_others: np.ndarray  # (G, S, S) the same of all the other causes together
    shares: np.ndarray  # (G, S, S) each cause's part, see `_split`
    rig: int  # how many of the S, the first ones, are the estimator's own rig steps
    axes: np.ndarray  # (3, S) errors of the joint axes' skew, offset and tilt zero

    @property
    def size(self) -> int:
        """Number S of independent errors."""
        return self.axes.shape[1]

    @staticmethod
    def of(rig_arrays: RigArrays) -> _ErrorSpace:
        """The error space of a rig as the estimator models it."""
        rig_rows, axes = _independent(rig_arrays)
        rows = {cause: rig_rows[[RIG_PARAMETERS.index(name) for name in names]] for cause, names in RIG_CAUSES.items()}
        first, sensor = len(rig_arrays.rig.covariance), rig_arrays.rig.wrench_sensor
        after = first + (0 if sensor is None else len(sensor.covariance))
        lens = np.vstack([rig_rows[len(RIG_PARAMETERS) : first], rig_rows[after:]])
        rows |= {"lens": lens, "sensor_axes": rig_rows[first:after], "joint_axes": axes}
        rows = {cause: part for cause, part in rows.items() if part.any()}
        determined = _subsets(list(rows.values()), axes.shape[1])
        single = [1 << index for index in range(len(rows))]
        without = [len(determined) - 1 - one for one in single]
        return _ErrorSpace(
            tuple(rows), determined[single], determined[without], _split(determined), rig_arrays.axes.shape[1], axes
        )


def _independent(rig_arrays: RigArrays) -> tuple[np.ndarray, np.ndarray]:
    """Linear maps from the independent errors: (17 + P, S) to the rig's parameters, (3, S) to those of the joint
    axes."""
    rig_axes, kinematics = np.asarray(rig_arrays.axes), rig_arrays.rig.kinematics
    own = np.diag(kinematics.axes_std)[:, kinematics.axes_std > 0.0]
    axes = np.hstack([kinematics.axes_by_pose @ rig_axes[: len(POSE_PARAMETERS)], own])
    return np.hstack([rig_axes, np.zeros((len(rig_axes), own.shape[1]))]), axes


def _subsets(rows: list[np.ndarray], size: int) -> np.ndarray:
    """(2^G, S, S) projectors onto the subspaces of independent errors that each subset of causes determines; bit g
    is cause g. rows : G arrays (P_g, S), a cause's parameters by the errors."""
    determined = np.zeros((1, size, size))
    for part in rows:
        scale = np.linalg.norm(part, axis=1, keepdims=True)
        unit = part / np.where(scale > 0.0, scale, 1.0)
        # what the cause adds to each of the sets without it
        _, lengths, new = np.linalg.svd(unit - unit @ determined, full_matrices=False)
        new = new * (lengths > BudgetSettings.dependent)[..., None]
        determined = np.concatenate([determined, determined + np.swapaxes(new, 1, 2) @ new])
    return determined


def _split(determined: np.ndarray) -> np.ndarray:
    """(G, S, S) Shapley shares of G causes, which add up to what all determine together: a cause's contribution
    beyond those known before it, averaged over all orders, so that correlated causes share what they have in common."""
    count = len(determined).bit_length() - 1
    members = (np.arange(len(determined))[:, None] >> np.arange(count)) & 1
    sizes = members.sum(axis=1)
    weight = np.array([factorial(k) * factorial(count - k - 1) / factorial(count) for k in range(count)])
    if not count:
        return np.zeros((0, *determined.shape[1:]))
    joins, stays = weight[np.clip(sizes - 1, 0, None)][:, None], weight[np.clip(sizes, None, count - 1)][:, None]
    return np.tensordot(np.where(members == 1, joins, -stays).T, determined, 1)


@dataclass(frozen=True, eq=False)
class _Linearization(Rows):
    """B contacts, linearised in K = 4 + S unknowns, the last of which are the errors of rig and joint axes."""

    points: np.ndarray  # (B, K, K) information in the picture
    readings: np.ndarray  # (B, K, K) information in the readings
    prior: np.ndarray  # (B, K) the weights P
    results: np.ndarray  # (B, 6, K) is T
    beyond: np.ndarray  # (B, 6, S) is D
    usable: np.ndarray  # (B,) how many points the picture shows


def _linearize(
    rig_arrays: RigArrays, space: _ErrorSpace, touches: BudgetContacts, with_moment: bool = True
) -> _Linearization:
    """Linearise contacts about their noise-free frames."""
    available = np.full(len(touches), with_moment)
    unknowns = _unknowns_of(rig_arrays, touches)
    frames = noise_free_frames(_empty(rig_arrays, touches), REFERENCE, unknowns, available, point_per_px=True)
    there = linearised(frames, REFERENCE, unknowns)
    prior, moved, touch = there.prior, there.readings, there.columns
    by_readings = np.swapaxes(moved, 1, 2) @ moved
    points = there.information - np.eye(prior.shape[1]) * prior[:, None] - by_readings
    rotation = _world_rotation(rig_arrays.rig, touches)
    distance = np.zeros_like(touch[:, :1])
    distance[:, 0, 0] = rig_arrays.length_m
    results = np.concatenate([distance, touch[:, 4:6], rotation @ touch[:, :3]], axis=1)
    pan, tilt = (np.full(len(touches), angle) for angle in (touches.pan_rad, touches.tilt_rad))
    turned, shifted = rig_arrays.rig.kinematics.by_axes(pan, tilt)
    moved_by_axes = np.einsum("kbij,bj->bik", turned, there.point_force[:, :3]) + np.moveaxis(shifted, 0, -1)
    beyond = np.concatenate([np.zeros((len(touches), 3, space.size)), moved_by_axes @ space.axes], axis=1)
    more = (0, space.size - space.rig)
    return _Linearization(
        np.pad(points, ((0, 0), more, more)),
        np.pad(by_readings, ((0, 0), more, more)),
        np.pad(prior, ((0, 0), more), constant_values=1.0),
        np.pad(results, ((0, 0), (0, 0), more)),
        beyond,
        frames.usable.sum(axis=1),
    )


_Propagation = tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]
"""The errors of B results: (B, 6, K) by what pulls at the unknowns; variance (B, 6) by each kind of noise, friction and
the force's prior; (B, 6, S) by each independent error."""


def _variance(propagation: _Propagation) -> np.ndarray:
    """(B, 6) variances of the results due to all causes together."""
    _, by_noise, by_errors = propagation
    whole: np.ndarray = sum(by_noise.values(), np.zeros(()))
    return np.asarray(whole + (by_errors**2).sum(axis=-1))


def _propagate(
    linear: _Linearization, space: _ErrorSpace, cause: str = "", factor: float = 1.0, errors: np.ndarray | None = None
) -> _Propagation:
    """The error propagation of contacts, with the rig as it is or with a cause's standard deviation multiplied by a
    factor, as if it were measured again (which narrows correlated ones, too). errors : (S, S) map from unit errors
    to the remaining independent ones."""
    left = np.eye(linear.prior.shape[1])
    if errors is not None:
        left[UNKNOWNS:, UNKNOWNS:] = errors
    noise = {"pixels": linear.points, "moment_noise": linear.readings}
    if cause in noise:
        noise[cause] = noise[cause] / max(factor, BudgetSettings.exact_noise) ** 2
    elif cause == "friction":
        left[UNKNOWNS - 1, UNKNOWNS - 1] = factor
    elif cause:
        left[UNKNOWNS:, UNKNOWNS:] -= (1.0 - factor) * space.determined[space.causes.index(cause)]
    information = left @ (noise["pixels"] + noise["moment_noise"]) @ left
    information = information + np.eye(left.shape[-1]) * linear.prior[:, None]
    scale = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    with np.errstate(all="ignore"):
        covariance = _inverse(information / (scale[:, :, None] * scale[:, None])) / (scale[:, :, None] * scale[:, None])
    gain, weights = linear.results @ left @ covariance, linear.prior[:, None]
    slopes = gain @ left
    by_noise = {cause: (slopes @ each * slopes).sum(axis=-1) for cause, each in noise.items()}
    by_prior = gain[..., :UNKNOWNS] ** 2 * weights[..., :UNKNOWNS]
    by_noise |= {"friction": by_prior[..., -1], "force_prior": by_prior[..., 1:-1].sum(axis=-1)}
    by_errors = -gain[..., UNKNOWNS:] * weights[..., UNKNOWNS:] - linear.beyond @ left[UNKNOWNS:, UNKNOWNS:]
    return gain, by_noise, by_errors


def _correlated_variance(space: _ErrorSpace, propagation: _Propagation) -> np.ndarray:
    """(B, 6) variance due to correlations between causes: the total, less what each cause adds beyond what the
    others determine; negative where they cancel. `_variance_by_cause` distributes it."""
    errors = propagation[2]
    whole = (errors**2).sum(axis=-1)
    others = np.einsum("bqi,gij,bqj->gbq", errors, space.determined_by_others, errors, optimize=True)
    return np.asarray(whole - (whole - others).sum(axis=0))


def _variance_by_cause(space: _ErrorSpace, propagation: _Propagation) -> dict[str, np.ndarray]:
    """(B, 6) variances due to each cause, which add up to `_variance`."""
    errors = propagation[2]
    shared = np.einsum("bqi,gij,bqj->gbq", errors, space.shares, errors, optimize=True)
    # rounding leaves what is nothing a little below it
    return propagation[1] | dict(zip(space.causes, np.clip(shared, 0.0, None), strict=True))


def per_result(rows: np.ndarray) -> dict[str, np.ndarray]:
    """(B,) variance of each of `RESULTS`, from those of its components (B, 6)."""
    return {name: rows[:, list(which)].sum(axis=1) for name, which in RESULTS.items()}


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses (B, K, K) of symmetric matrices; infinite for singular ones."""
    known = np.where(np.isfinite(matrices), matrices, 0.0)
    with suppress(np.linalg.LinAlgError):
        found = np.linalg.inv(known)
        # those that may be singular are told by their eigenvalues, which take ten times as long
        if (np.linalg.norm(known, 1, axis=(1, 2)) * np.linalg.norm(found, 1, axis=(1, 2)) < 1e12).all():
            return found
    values, vectors = np.linalg.eigh(known)
    regular = values[:, :1] > 1e-15 * values[:, -1:]
    with np.errstate(all="ignore"):
        inverse = (vectors / np.where(regular, values, 1.0)[:, None]) @ np.swapaxes(vectors, 1, 2)
    return np.where(regular[..., None], inverse, np.inf)


class _ErrorCause(NamedTuple):
    """A cause of errors: its name and colour in tables and figures, and its remedy."""

    name: str
    colour: str
    remedy: str


_JIG = "take more pictures of the board in the jig, with a better jig, or a sweep of the joints"
_NO_LOAD = "take more pictures of the free antenna, at several tilts, and calibrate again"
_LOADS = "hang more loads, heavier and at several distances, weighed and measured with a caliper"
CAUSES = {
    "pixels": _ErrorCause(
        "pixel noise",
        "#0f766e",
        "bring the camera nearer, take one with more pixels or a longer lens, or light the antenna better",
    ),
    "moment_noise": _ErrorCause(
        "moment noise", "#b45309", "take a quieter moment sensor, or average more readings per picture"
    ),
    "friction": _ErrorCause(
        "friction angle", "#7c3aed", "polish or grease the antenna, and say with --friction how slippery it is"
    ),
    "lens": _ErrorCause(
        "lens", "#1d4ed8", "take more pictures of the board for the lens, up to the borders of the picture"
    ),
    "camera_rotation": _ErrorCause("camera rotation", "#0ea5e9", _JIG),
    "camera_position": _ErrorCause("camera position", "#7dd3fc", _JIG),
    "clamp_angle": _ErrorCause("clamp angle", "#15803d", _NO_LOAD),
    "clamp_offset": _ErrorCause("clamp offset", "#4ade80", _NO_LOAD),
    "clamp_give": _ErrorCause("clamp give", "#a3e635", _LOADS + "; or stiffen the clamp"),
    "bow": _ErrorCause("bow", "#facc15", _NO_LOAD),
    "stiffness": _ErrorCause("stiffness EI", "#dc2626", _LOADS),
    "mass": _ErrorCause("mass", "#fda4af", "weigh the antenna, or take more pictures of it free at several tilts"),
    "moment_gain": _ErrorCause("moment gain", "#f97316", _LOADS),
    "moment_offset": _ErrorCause("moment offset", "#fdba74", "take more readings without a load"),
    "sensor_axes": _ErrorCause("sensor axes", "#fed7aa", _LOADS),
    "joint_axes": _ErrorCause(
        "joint axes", "#78716c", "repeat the sweep of the joints with more poses, or measure the axes"
    ),
    "force_prior": _ErrorCause(
        "likely force", "#cbd5e1", "give the moment reading: the picture alone hardly holds the force here"
    ),
}
"""Every cause, in the order in which figures stack them."""
ADVISED = ("distance_m", "force_N", "point_m")  # results that the advice is about
OWN = ("pixels", "moment_noise", "friction", "force_prior")  # causes that are not the calibration's


@dataclass(frozen=True)
class _CausePart:
    """One cause's contribution to one result, rms over the contacts, in the result's unit."""

    std: float  # the deviation that it contributes; squares add up
    share: float  # of the variance
    if_halved: float  # the result's whole deviation if the cause's were half of what it is
    if_exact: float  # the same if the cause were known exactly


@dataclass(frozen=True)
class ResultBudget:
    """The budget of one result, rms over the contacts."""

    std: float  # whole deviation
    in_common: float  # share of the variance that belongs to no one cause, by correlations; the parts hold it divided
    parts: dict[str, _CausePart]  # by cause; they add up

    @property
    def first(self) -> str:
        """The cause with the largest gain from halving its standard deviation."""
        return max(self.parts, key=self.gain)

    def gain(self, cause: str) -> float:
        """Relative decrease of this result's standard deviation when that of a cause is halved."""
        return 1.0 - self.parts[cause].if_halved / self.std

    @property
    def common_std(self) -> float:
        """The calibration's contribution, which is common to all frames and does not average out."""
        return float(np.sqrt(sum(part.std**2 for cause, part in self.parts.items() if cause not in OWN)))


@dataclass(frozen=True, eq=False)
class Budget:
    """The error budget of a rig."""

    touches: BudgetContacts  # B contacts that would come with numbers
    asked: int  # number of contacts that were asked for
    results: dict[str, ResultBudget]  # by `RESULTS`
    variances: dict[str, np.ndarray]  # cause → (B, 6) of the rows that `RESULTS` names
    exact: tuple[str, ...]  # causes that rig.json says are exact, or nothing of
    notes: tuple[str, ...]

    def gain(self, cause: str) -> float:
        """Mean relative decrease of the standard deviations of distance, force and point when that of a cause is
        halved."""
        return float(np.mean([self.results[name].gain(cause) for name in ADVISED]))

    @property
    def first(self) -> str:
        """The cause to improve first, by `gain`."""
        return max(self.results["point_m"].parts, key=self.gain)

    @property
    def first_of_rig(self) -> str | None:
        """The cause to improve first among those that a calibration determines; None where the rig counts as exact."""
        return max((cause for cause in self.variances if cause not in OWN), key=self.gain, default=None)

    @property
    def leads(self) -> dict[str, int]:
        """Number of contacts in which each cause contributes most to the distance's error; those without any are left
        out."""
        causes = list(self.variances)
        largest = np.argmax([per_result(rows)["distance_m"] for rows in self.variances.values()], axis=0)
        count = np.bincount(largest, minlength=len(causes))
        return {causes[i]: int(count[i]) for i in np.argsort(-count, kind="stable") if count[i]}


def error_budget(
    rig: Rig, touches: BudgetContacts | None = None, *, friction: float = FRICTION_RAD, with_moment: bool = True
) -> Budget:
    """The budget of a rig, by default over ordinary contacts. with_moment : False for estimates from pictures alone.

    `friction` is the deviation of the friction angle, rad, as the estimator assumes it. Raises InputError where it is
    out of range, or where there is no contact for which the estimator would give numbers.
    """
    if not 0.0 <= friction <= 1.0:
        raise InputError(f"friction is {friction}", remedy="give the angle's deviation in rad, 0 to 1")
    touches = ordinary_touches(rig) if touches is None else touches
    with_moment = with_moment and any(rig.reading_noise)
    rig_arrays = RigArrays.from_rig(rig, float(friction), drift=False)
    space = _ErrorSpace.of(rig_arrays)
    with np.errstate(all="ignore"):  # what leaves the domain of the model is left out below
        every = _linearize(rig_arrays, space, touches, with_moment)
        determined = _determined(rig_arrays, space, touches, every, with_moment)
    if not determined.any():
        which = f"any of {len(determined)} contacts" if len(determined) > 1 else "this"
        raise InputError(
            f"the estimator would give no numbers for {which}",
            where="budget",
            remedy="give a contact that is pressed harder and in the picture, or calibrate the rig better",
        )
    linear = every.picked(determined)
    now = _propagate(linear, space)
    by_cause = {cause: part for cause, part in _variance_by_cause(space, now).items() if part.any()}
    without = () if with_moment else ("moment_noise", "moment_gain", "moment_offset")
    several = with_moment and rig.wrench_sensor is not None
    excluded = ("force_prior", *without, *([] if several else ["sensor_axes"]))
    whole, shared = _mean(_variance(now)), _mean(_correlated_variance(space, now))
    parts: dict[str, dict[str, _CausePart]] = {name: {} for name in RESULTS}
    for cause, rows in by_cause.items():
        own, halved, exact = _mean(rows), whole, whole
        if cause != "force_prior":
            halved, exact = (_mean(_variance(_propagate(linear, space, cause, factor))) for factor in (0.5, 0.0))
        for name in RESULTS:
            std, if_halved, if_exact = (float(np.sqrt(each[name])) for each in (own, halved, exact))
            parts[name][cause] = _CausePart(std, own[name] / whole[name], if_halved, if_exact)
    results = {
        name: ResultBudget(float(np.sqrt(whole[name])), shared[name] / whole[name], parts[name]) for name in RESULTS
    }
    exact_causes = tuple(cause for cause in CAUSES if cause not in (*by_cause, *excluded))
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


@dataclass(frozen=True, eq=False)
class _SharedError:
    """The distance's error that all frames of a rig share, rms over ordinary contacts, as a function of the rig's
    covariance.

    linear, space : the contacts, and the rig's independent errors. rig_rows : (17 + P, S) its parameters by these.
    covariance : (17 + P, 17 + P) as it is.
    """

    linear: _Linearization
    space: _ErrorSpace
    rig_rows: np.ndarray
    covariance: np.ndarray

    @staticmethod
    def of(rig: Rig) -> _SharedError | None:
        """The shared error of a rig as the estimator models it; None where no ordinary contact would be determined."""
        rig_arrays, touches = RigArrays.from_rig(rig, FRICTION_RAD, drift=False), ordinary_touches(rig)
        rows, axes = _independent(rig_arrays)
        none = np.zeros((0, axes.shape[1], axes.shape[1]))
        space = _ErrorSpace((), none, none, none, rig_arrays.axes.shape[1], axes)
        with_moment = any(rig.reading_noise)
        with np.errstate(all="ignore"):
            every = _linearize(rig_arrays, space, touches, with_moment)
            determined = _determined(rig_arrays, space, touches, every, with_moment)
        if not determined.any() or not rig.covariance.any():
            return None
        return _SharedError(every.picked(determined), space, rows[: len(rig.covariance)], rig.covariance)

    def std_m(self, covariance: np.ndarray) -> float:
        """The shared error with another covariance (17 + P, 17 + P) of the rig, no larger than its own, that is also
        used as weight."""
        values, axes = np.linalg.eigh(np.eye(self.space.size) - self._gained(covariance))
        root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
        errors = _propagate(self.linear, self.space, errors=root)[2][:, 0]
        return float(np.sqrt((errors**2).sum(axis=1).mean()))

    def variance_m2(self, covariance: np.ndarray) -> float:
        """The shared error's square with another covariance but the present weights."""
        return float(np.sum(self._form * (np.eye(self.space.size) - self._gained(covariance))))

    @cached_property
    def _form(self) -> np.ndarray:
        """(S, S) quadratic form of the mean square error in the independent errors."""
        errors = _propagate(self.linear, self.space)[2][:, 0]
        return np.asarray(errors.T @ errors / len(errors))

    @cached_property
    def _inverse_rows(self) -> np.ndarray:
        """(S, 17 + P) pseudoinverse of `rig_rows`, scaled because their units differ."""
        size = np.linalg.norm(self.rig_rows, axis=1)
        unit = 1.0 / np.where(size > 0.0, size, 1.0)
        return np.asarray(np.linalg.pinv(unit[:, None] * self.rig_rows, rcond=1e-9) * unit)

    def _gained(self, covariance: np.ndarray) -> np.ndarray:
        """(S, S) decrease of the independent errors' covariance from the identity."""
        less = self._inverse_rows @ (self.covariance - covariance) @ self._inverse_rows.T
        return np.asarray(0.5 * (less + less.T))


def _determined(
    rig_arrays: RigArrays, space: _ErrorSpace, touches: BudgetContacts, linear: _Linearization, with_moment: bool
) -> np.ndarray:
    """(B,) mask of the contacts for which the estimator would return numbers, as `contact.status` decides for
    contacts that fit well."""
    sound = np.isfinite(linear.points).all(axis=(1, 2)) & (linear.usable >= ContactSettings.fewest_points)
    std = np.full((len(linear), 6), np.nan)
    if sound.any():
        std[sound] = np.sqrt(_variance(_propagate(linear.picked(sound), space)))
    relative_m = ContactSettings.low_signal_relative * touches.distance_m
    limit = np.minimum(ContactSettings.low_signal * rig_arrays.length_m, relative_m)
    determined = np.isfinite(std).all(axis=1) & (std[:, 0] < limit)
    if with_moment:
        return determined
    force = np.hypot(*touches.push_N.T)
    seen = edge_on(rig_arrays, _unknowns_of(rig_arrays, touches)) >= ContactSettings.edge_on_blind_rad
    return determined & seen & (std[:, 1:3].max(axis=1) < 0.5 * force)


def _mean(rows: np.ndarray) -> dict[str, float]:
    return {name: float(values.mean()) for name, values in per_result(rows).items()}


def next_observations(made: Calibration) -> dict[str, Any]:
    """The entry `guide` of rig.json: the shared error of distance over ordinary contacts, and up to three
    observations that would lower it most, one after the other, each with the error after it; also in words. Empty
    for a wrong calibration, for several cameras, and where no contact would be determined."""
    try:
        error = None if made.rig.others or made.rig.verdict.severity == "wrong" else _SharedError.of(made.rig)
        left = [] if error is None else further_observations(made)
    except VbaaError:
        # the lens folds, or the antenna has no shape: there is nothing to forecast by
        return {}
    if error is None:
        return {}

    def forecast(rows: np.ndarray) -> np.ndarray:
        found = made.joint.forecast(rows)
        if not made.session.with_sensor:
            found[GAIN : OFFSET + 1] = found[:, GAIN : OFFSET + 1] = 0.0
        return found

    rows, steps = list[np.ndarray](), list[dict[str, Any]]()
    now = std = error.std_m(made.rig.covariance)
    while left and len(steps) < GuideSettings.steps:
        after = [forecast(np.vstack([*rows, more])) for _, more in left]
        # with the contacts weighed anew the shared error may be another: only the best are tried
        best = np.argsort([error.variance_m2(each) for each in after])[: GuideSettings.tried]
        stds = [error.std_m(after[index]) for index in best]
        described, more = left[best[int(np.argmin(stds))]]
        if min(stds) > (1.0 - GuideSettings.least_load_gain) * std:
            break
        rows, std = [*rows, more], min(stds)
        steps.append({**described, "distance_shared_std_m": std})
    return {"distance_shared_std_m": now, "next": steps, "words": _words(now, steps)}


def _words(now_m: float, steps: list[dict[str, Any]]) -> str:
    """The suggested observations in a sentence."""
    if not steps:
        least = f"{100 * GuideSettings.least_load_gain:.0f} %"
        return (
            f"No further load or picture would lower the shared error of distance, {1e3 * now_m:.2g} mm, by more than "
            f"{least}."
        )
    first, *rest = steps
    std_m = first["distance_shared_std_m"]
    halves = next((n for n, one in enumerate(steps) if one["distance_shared_std_m"] <= 0.5 * now_m), None)
    verb = "would halve" if halves == 0 else f"would take {100 * (1.0 - std_m / now_m):.0f} % off"
    words = f"{first['words']} {verb} the shared error of distance: {1e3 * now_m:.2g} → {1e3 * std_m:.2g} mm"
    words += "".join(f"; then {one['words']}: {1e3 * one['distance_shared_std_m']:.2g} mm" for one in rest)
    return words[:1].upper() + words[1:] + "."
