"""Results of many frames: only numbers that the data support, each frame tested for motion with its neighbours."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, TypeVar, overload

import numpy as np

from estimator.solver.linearised import rigs_of
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import Contact, ContactEstimate, Jacobian, Measured
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import PLAUSIBLE
from vbaa_calib.native import core
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .inputs import Batch
from .motion import Beam, Inertia, Motion, Shapes
from .settings import ContactSettings
from .status import FAILED, NO_ANTENNA, NO_CONTACT, OK, TIP, limits, reason

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts(ContactEstimate[np.ndarray, np.ndarray, np.ndarray], Sequence[Contact]):
    """The results of B frames: a sequence of `Contact`, and its numbers as arrays with a leading axis B.

    Numbers that the data do not support are NaN. `numbers` are the fits themselves; `requested` is the model that was
    asked for; `outside_points` (B,) are left out because they lie outside the picture; `seen` (B, V) are those that
    each of several cameras saw; `jacobian`, if it was asked for, has the derivatives.
    """

    rig: Rig
    numbers: FitNumbers
    requested: str
    outside_points: np.ndarray
    ordinary: np.ndarray
    seen: np.ndarray | None = None
    jacobian: Jacobian | None = None

    def __len__(self) -> int:
        return len(self.status)

    @overload
    def __getitem__(self, index: int) -> Contact: ...
    @overload
    def __getitem__(self, index: slice) -> list[Contact]: ...
    def __getitem__(self, index: int | slice) -> Contact | list[Contact]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index %= len(self)
        values = {name: column[index] for name, column in self._columns.items()}
        jacobian = None if self.jacobian is None else self.jacobian.of(index)
        more = (
            self.rig,
            self.requested,
            int(self.outside_points[index]),
            None if self.seen is None else self.seen[index],
        )
        return _contact(values, jacobian, self.numbers, index, bool(self.ordinary[index]), more)

    @staticmethod
    def one_by_one(rig_arrays: RigArrays, friction_rad: float, requested: str) -> Callable[..., Contact | None]:
        """A function of a centreline, both moments and both joint angles that gives the contact of a frame as most
        are: floats, points in order within the picture, and a fit that is not doubted; None of any other. Of a rig with
        one camera and exact joint axes."""
        rig, (known, names), columns = rig_arrays.rig, limits(), core.solver.REPORTED["names"]
        fitted = -1 if requested == "auto" else RUNGS.index(requested), rig_arrays.independent
        picture = (*map(float, rig.camera.image_size), rig.image.noise_px)
        single = core.solver.Single(rigs_of(rig_arrays), known, fitted, picture, _units(rig, friction_rad))
        statuses, reads = names.tolist(), rig.moment_sensor.exists

        def contact(line_px: Any, moment: Any, moment_z: Any, pan: Any, tilt: Any) -> Contact | None:
            moment, moment_z = (math.nan if each is None else each for each in (moment, moment_z))
            if type(line_px) is not np.ndarray or line_px.dtype != float:
                return None
            if line_px.ndim != 2 or line_px.shape[1] != 2 or not len(line_px):
                return None
            if any(type(each) is not float for each in (moment, moment_z, pan, tilt)):
                return None
            if abs(moment) > PLAUSIBLE.moment_Nm or abs(moment_z) > PLAUSIBLE.moment_Nm:
                return None
            if not (abs(pan) <= PLAUSIBLE.angle_rad and abs(tilt) <= PLAUSIBLE.angle_rad):
                return None
            numbers, rows = FitNumbers.empty(1), np.empty(1, _kind())
            rotation, translation = rig.kinematics.world_antenna(np.array([pan]), np.array([tilt]))
            world = rotation, translation, rig.gravity_world_m_s2 @ rotation
            read = moment if reads else math.nan, moment_z
            found = single.fit(np.ascontiguousarray(line_px), read, *world, (numbers.rows, rows))
            if found is None:
                return None
            values, row = dict(zip(columns, rows.item(), strict=True)), numbers.rows[0]
            values["status"], values["model"] = statuses[found[0]], RUNGS[row["rung"]]
            values["friction_prior_rad"], values["condition"] = friction_rad, float(row["condition"])
            return _contact(values, None, numbers, 0, found[1], (rig, requested, 0, None))

        return contact

    @cached_property
    def _columns(self) -> dict[str, Any]:
        """The columns from which a `Contact` is built, by name: numbers and texts as Python objects, and arrays."""
        columns = {name: getattr(self, name) for name in ContactEstimate.__dataclass_fields__}
        return {name: column.tolist() if column.ndim == 1 else column for name, column in columns.items()}


@lru_cache
def _kind() -> np.dtype[np.void]:
    """Of the columns that the core fills in."""
    return np.dtype(core.solver.REPORTED)


def _contact(
    values: dict[str, Any],
    jacobian: Jacobian | None,
    numbers: FitNumbers,
    index: int,
    ordinary: bool,
    more: tuple[Rig, str, int, np.ndarray | None],
) -> Contact:
    """The contact of one frame, from its numbers and status by name and the fit of that index. more : rig, the
    requested model, points outside the picture, and those that each of several cameras saw."""
    (rig, requested, outside, seen), row = more, numbers.rows[index]
    bias = dict(zip(RUNGS, row["bias"].tolist(), strict=True))
    status = "" if values["status"] == OK and ordinary else values["status"]
    words = reason(numbers, index, status, rig.antenna.length_m, requested)
    for count, which in ((outside, "outside the picture"), (int(row["outliers"]), "far from where the neighbours lie")):
        words += f"; {count} point{'s' * (count > 1)} {which}: left out" if count else ""
    for name, count in zip(rig.cameras, seen.tolist(), strict=False) if seen is not None else ():
        if count < ContactSettings.fewest_points:
            words += f"; {name} shows only {count} points: left out" if count else f"; {name} shows no antenna"
    end_std = float(row["tip_std"])
    contact = object.__new__(Contact)  # of all fields at once: to set each takes longer than all else here
    vars(contact).update(
        values,
        reason=words,
        outside_points=outside,
        end_used=abs(end_std) <= ContactSettings.outlying_end if math.isfinite(end_std) else None,
        bias={rung: value for rung, value in bias.items() if math.isfinite(value)},
        jacobian=jacobian,
    )
    return contact


def _reported(
    numbers: FitNumbers, rig: Rig, friction_rad: float, batch: Batch
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The columns of a batch that the core fills in, as (B,) structures, statuses (B,) and a mask (B,) of frames about
    which there is nothing to remark."""
    rows, world = np.empty(len(numbers), _kind()), rig.kinematics.world_antenna(batch.pan_rad, batch.tilt_rad)
    known, names = limits()
    places, noticed = core.solver.report(known, numbers.rows, *world, _units(rig, friction_rad), rows)
    status, ordinary = names[places], noticed & core.solver.OUT_OF_ORDINARY == 0
    if not rig.kinematics.axes_known:
        by_axes = rig.kinematics.by_axes(batch.pan_rad, batch.tilt_rad)
        with np.errstate(invalid="ignore", over="ignore"):
            rows["covariance_world_m2"] += _by_axes(rig, numbers, world[0], by_axes)
    return rows, status, ordinary


def _units(rig: Rig, friction_rad: float) -> tuple[float, float, float]:
    """The antenna's length, the friction angle's deviation and that of the moment."""
    moment_Nm = rig.reading_noise[0] / rig.moment_sensor.gain if rig.moment_sensor.gain else math.nan
    return rig.antenna.length_m, friction_rad, float(moment_Nm)


def contacts_of(numbers: FitNumbers, rig: Rig, friction_rad: float, batch: Batch, model: str) -> Contacts:
    """The results of a batch; their statuses decide which numbers are filled in. model : the requested one."""
    rows, status, ordinary = _reported(numbers, rig, friction_rad, batch)
    columns: dict[str, Any] = {name: rows[name] for name in core.solver.REPORTED["names"]}
    return Contacts(
        rig=rig,
        numbers=numbers,
        requested=model,
        outside_points=batch.outside_points,
        ordinary=ordinary,
        seen=batch.seen,
        status=status,
        model=np.array(RUNGS)[numbers.rung],
        friction_prior_rad=np.full(len(numbers), friction_rad),
        condition=numbers.condition,
        **columns,
    )


def _by_axes(rig: Rig, numbers: FitNumbers, rotation: np.ndarray, by_axes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(B, 3, 3) covariance of the world points due to the joint axes' errors, correlated with those of the pose."""
    kinematics, pose = rig.kinematics, slice(0, len(POSE_PARAMETERS))
    moved = _moved(by_axes, numbers.point_m[:, None])[:, 0]
    by_pose = moved @ kinematics.axes_by_pose
    shared = rotation @ numbers.with_pose[:, :3] @ np.swapaxes(by_pose, 1, 2)
    own = (moved * kinematics.axes_std**2) @ np.swapaxes(moved, 1, 2)
    return own + by_pose @ rig.covariance[pose, pose] @ np.swapaxes(by_pose, 1, 2) + shared + np.swapaxes(shared, 1, 2)


def _moved(by: tuple[np.ndarray, np.ndarray], points_m: np.ndarray) -> np.ndarray:
    """(B, G, 3, K) derivatives of the world positions of antenna points (B, G, 3) by K numbers that rotate and
    translate it."""
    turned, shifted = by
    return np.asarray(np.einsum("kbij,bgj->bgik", turned, points_m) + np.moveaxis(shifted, 0, -1)[:, None])


def with_joint_errors(contacts: Contacts, batch: Batch) -> Contacts:
    """The contacts with the joint angles' uncertainty added to the covariance of the world points."""
    if batch.joint_errors_rad is None:
        return contacts
    by_joints = contacts.rig.kinematics.by_joints(batch.pan_rad, batch.tilt_rad)
    moved = _moved(by_joints, contacts.point_antenna_m[:, None])[:, 0] * batch.joint_errors_rad[:, None]
    return replace(contacts, covariance_world_m2=contacts.covariance_world_m2 + moved @ np.swapaxes(moved, 1, 2))


def motion_of(rig: Rig, several: Sequence[Measured], found: Contacts) -> tuple[np.ndarray, Shapes]:
    """Input of a motion test for successive frames: the error of a contact's distance, in its standard deviations, per
    N/m of load on each piece of the antenna along the world's axes (B, G, 3), and the frames' shapes in the world."""
    times = np.array([each.time_s for each in several], float)
    pan, tilt = (np.array([getattr(each, name) for each in several]) for name in ("pan_rad", "tilt_rad"))
    rotation, translation = rig.kinematics.world_antenna(pan, tilt)
    numbers = found.numbers
    fitted = (found.status != NO_ANTENNA) & (found.status != FAILED) & numbers.finite
    points = np.einsum("bij,bgj->bgi", rotation, numbers.pieces_m) + translation[:, None]
    points = np.where(fitted[:, None, None], points, np.nan)
    distance = np.where(found.status == NO_CONTACT, np.nan, numbers.unknowns[:, 0])
    std_m = numbers.pieces_std_m
    joint_errors = np.array([each.joint_errors_rad for each in several])
    if joint_errors.any():
        swung = _moved(rig.kinematics.by_joints(pan, tilt), numbers.pieces_m)
        std_m = np.hypot(std_m, np.linalg.norm(swung * joint_errors[:, None, None], axis=(-2, -1)))
    # a load's components along y and z of the antenna, from those along the world's axes
    push = numbers.push @ np.swapaxes(rotation[:, :, 1:], 1, 2)
    return push, Shapes(times, points, std_m, distance)


def _at_rest(contact: Contact, shift: float) -> Contact:
    """The contact, or its status while the antenna vibrates: inertia shifts the distance by `shift` standard
    deviations."""
    if not (abs(shift) > ContactSettings.largest_shift and contact.status in (OK, TIP)):
        return contact
    off_m = abs(shift) * contact.distance_std_m
    off = f"{1e3 * off_m:.1f} mm off, {abs(shift):.1f} std"
    off = off if off_m < contact.distance_m else "off by more than itself"
    return in_motion(contact, f"the antenna swings: its inertia puts the distance {off}")


def in_motion(contact: Contact, reason: str) -> Contact:
    """The result of a frame in which the antenna moves too fast for its contact to be located."""
    return Contact(
        status="not_quasistatic",
        reason=reason,
        model=contact.model,
        in_contact=True,
        moment_residual_Nm=contact.moment_residual_Nm,
        outside_points=contact.outside_points,
        end_used=contact.end_used,
    )


class MotionCheck:
    """Tests contacts for motion, in order; some are returned only once later frames are known.

    live : by earlier frames alone, so that nothing waits.
    """

    def __init__(self, beam: Beam, live: bool = False) -> None:
        self._motion = Motion(beam, live)
        self._waiting: deque[tuple[Sequence[Contact], np.ndarray, int]] = deque()

    def push(self, contacts: Sequence[Contact], push: np.ndarray, shapes: Shapes) -> Iterator[Contact]:
        """The contacts that can be judged once these frames are known, the latter two as from `motion_of`."""
        if not self._waiting and not np.isfinite(shapes.time_s).any():
            return iter(contacts)
        self._waiting.extend((contacts, push, index) for index in range(len(push)))
        return self._ready(self._motion.push(shapes))

    def finish(self) -> Iterator[Contact]:
        """The contacts that wait for later frames, at the end of the recording."""
        loads = self._motion.finish()
        return iter(()) if loads is None else self._ready(loads)

    def _ready(self, loads: Inertia) -> Iterator[Contact]:
        # each waiting frame is taken off, whether its load counts or not
        for load, significant in zip(np.asarray(loads.load_N_m), np.asarray(loads.significant), strict=True):
            contacts, push, index = self._waiting.popleft()
            shift = float(np.sum(push[index] * load)) if significant else 0.0
            yield _at_rest(contacts[index], shift)


def last(parts: Generator[None, None, _T]) -> _T:
    """The return value of a generator, run to its end."""
    while True:
        try:
            next(parts)
        except StopIteration as done:
            found: _T = done.value
            return found


def jacobian_of(batch: Batch, rig_arrays: RigArrays, rung: str, fitted: FitNumbers, located: np.ndarray) -> Jacobian:
    """Derivatives of the contacts (B,) that were fitted to a batch. located : mask of those that exist."""
    frames, rig = batch.frames(rig_arrays), rig_arrays.rig
    known = located & ~fitted.marginal
    at = np.where(known[:, None], fitted.unknowns, [0.5, 0.0, 0.0, 0.0])
    scatter = np.where(known, fitted.scatter, 1.0)
    by_points, by_readings, by_gravity, by_rig = core.solver.gradients(
        rig_arrays.core, frames, RUNGS.index(rung), at, scatter, fitted.at_tip & known
    )
    rotation, _ = rig.kinematics.world_antenna(batch.pan_rad, batch.tilt_rad)
    turned, shifted = rig.kinematics.by_joints(batch.pan_rad, batch.tilt_rad)  # (2, B, 3, 3), (2, B, 3)

    def in_world(by: np.ndarray) -> np.ndarray:
        """(B, 7, ...) rows of distance, force and contact point, the last rotated into the world frame."""
        point = np.einsum("bij,bj...->bi...", rotation, by[:, 1:4])
        whole: np.ndarray = np.where(
            known.reshape(-1, *[1] * (by.ndim - 1)), np.concatenate([by[:, :1], by[:, 4:], point], axis=1), np.nan
        )
        return whole

    slopes = batch.slopes(rig)
    by_pixels = in_world(np.einsum("brni,bnij->brnj", by_points, np.nan_to_num(slopes)))
    if batch.order is not None:
        listed = np.empty_like(by_pixels)
        np.put_along_axis(listed, batch.order[:, None, :, None], by_pixels, 2)
        by_pixels = listed
    gravity = np.einsum("kbji,j->bik", turned, rig.gravity_world_m_s2)
    by_joints = in_world(by_gravity @ gravity)
    by_joints[:, 4:] += np.einsum("kbij,bj->bik", turned, fitted.point_m) + np.moveaxis(shifted, 0, -1)
    names = len(rig.parameter_names)
    by_readings = in_world(by_readings)[..., rig_arrays.sensors]
    return Jacobian(by_pixels, by_readings, by_joints, in_world(by_rig)[..., :names])
