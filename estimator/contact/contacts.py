"""Results of many frames: only numbers that the data support, each frame tested for motion with its neighbours."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Self, TypeVar, overload

import numpy as np

from estimator.solver.linearised import rigs_of
from estimator.solver.numbers import FitNumbers
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import LOCATED, Contact, ContactEstimate, ContactTable, Jacobian
from vbaa_calib.antenna.rungs import RUNGS
from vbaa_calib.core.arrays import PLAUSIBLE, Rows
from vbaa_calib.native import core
from vbaa_calib.rig import POSE_PARAMETERS, Rig

from .inputs import Batch
from .motion import Beam, Inertia, Motion, Shapes
from .settings import ContactSettings
from .status import FAILED, NO_ANTENNA, NO_CONTACT, OK, limits, model_words, reason

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False, kw_only=True)
class Contacts(Rows, ContactEstimate[np.ndarray, np.ndarray, np.ndarray], Sequence[Contact]):
    """The results of B frames: a sequence of `Contact`, and its numbers as arrays with a leading axis B.

    Numbers that the data do not support are NaN. `numbers` are the fits themselves; `requested` is the model that was
    asked for; `outside_points` (B,) are left out because they lie outside the picture; `seen` (B, V) are those that
    each of several cameras saw; `moving` (B,) says in words where the antenna swings, "" where it is at rest; None
    before the motion test; `jacobian`, if it was asked for, has the derivatives.
    """

    rig: Rig
    numbers: FitNumbers
    requested: str
    outside_points: np.ndarray
    ordinary: np.ndarray
    seen: np.ndarray | None = None
    moving: np.ndarray | None = None
    jacobian: Jacobian | None = None

    def __len__(self) -> int:
        return len(self.status)

    def picked(self, which: slice | np.ndarray) -> Self:
        """The results of some frames, without derivatives."""
        return super().picked(which)._with({"numbers": self.numbers.picked(which), "jacobian": None})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The results of several parts, at least one, one after the other."""
        return super().joined(parts)._with({"numbers": FitNumbers.joined([part.numbers for part in parts])})

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
        found = _contact(values, jacobian, self.numbers, index, bool(self.ordinary[index]), more)
        words = "" if self.moving is None else self.moving[index]
        return in_motion(found, words) if words else found

    def at_rest(self, shift: np.ndarray) -> Contacts:
        """The results, or their status while the antenna vibrates: inertia shifts the distances by `shift` (B,)
        standard deviations."""
        swings = np.flatnonzero(np.abs(shift) > ContactSettings.largest_shift)
        words = np.full(len(self), "", object)
        if not len(swings) or not len(swings := swings[np.isin(self.status[swings], LOCATED)]):
            return self._with({"moving": words})
        status, columns = self.status.astype(object), dict[str, Any]()
        for row in swings.tolist():
            distance_m, off_m = float(self.distance_m[row]), float(abs(shift[row]) * self.distance_std_m[row])
            words[row] = _swinging(distance_m, off_m, float(shift[row]))
        for name in ContactEstimate.__dataclass_fields__:
            if (column := getattr(self, name)).dtype == float and name != "moment_residual_Nm":
                columns[name] = column.copy()
                columns[name][swings] = np.nan
        status[swings] = "not_quasistatic"
        return replace(self, status=status.astype(str), moving=words, **columns)

    def table(self, frames: Mapping[str, np.ndarray]) -> ContactTable:
        """The rows of contacts.csv. frames : (B,) their frame, time_s, pan_rad and tilt_rad."""
        count, bias = len(self), self.numbers.bias
        usual = self.ordinary & (self.status == OK) & (self.numbers.outliers + self.outside_points == 0)
        rungs, biases = self.numbers.rung.tolist(), bias.tolist()
        words = [
            model_words(rungs[row], biases[row], self.requested) if plain and self.seen is None else self[row].reason
            for row, plain in enumerate(usual.tolist())
        ]
        own = bias[np.arange(count), self.numbers.rung]
        at_rest = True if self.moving is None else self.moving == ""
        return ContactTable.of(
            self, **frames, reason=np.array(words, object), bias_std=np.where(np.isfinite(own) & at_rest, own, np.nan)
        )

    @staticmethod
    def one_by_one(rig_arrays: RigArrays, friction_rad: float, requested: str) -> Callable[..., Contact | None]:
        """A function of a centreline, both moments and both joint angles that gives the contact of an ordinary frame
        (floats, points in order within the picture, a fit that is not doubted) and None for any other. For a rig with
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
    """The structured dtype of the columns that the core fills in."""
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
    found = Contacts(
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
    return _with_joint_errors(found, batch)


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


def _with_joint_errors(contacts: Contacts, batch: Batch) -> Contacts:
    """The contacts with the joint angles' uncertainty added to the covariance of the world points."""
    if batch.joint_errors_rad is None:
        return contacts
    by_joints = contacts.rig.kinematics.by_joints(batch.pan_rad, batch.tilt_rad)
    moved = _moved(by_joints, contacts.point_antenna_m[:, None])[:, 0] * batch.joint_errors_rad[:, None]
    return replace(contacts, covariance_world_m2=contacts.covariance_world_m2 + moved @ np.swapaxes(moved, 1, 2))


def motion_of(rig: Rig, batch: Batch, found: Contacts) -> tuple[np.ndarray, Shapes]:
    """Input of a motion test for successive frames: the error of a contact's distance, in its standard deviations, per
    N/m of load on each piece of the antenna along the world's axes (B, G, 3), and the frames' shapes in the world."""
    pan, tilt = batch.pan_rad, batch.tilt_rad
    rotation, translation = rig.kinematics.world_antenna(pan, tilt)
    numbers = found.numbers
    fitted = (found.status != NO_ANTENNA) & (found.status != FAILED) & numbers.finite
    points = np.einsum("bij,bgj->bgi", rotation, numbers.pieces_m) + translation[:, None]
    points = np.where(fitted[:, None, None], points, np.nan)
    distance = np.where(found.status == NO_CONTACT, np.nan, numbers.unknowns[:, 0])
    std_m = numbers.pieces_std_m
    if batch.joint_errors_rad is not None:
        swung = _moved(rig.kinematics.by_joints(pan, tilt), numbers.pieces_m)
        std_m = np.hypot(std_m, np.linalg.norm(swung * batch.joint_errors_rad[:, None, None], axis=(-2, -1)))
    # a load's components along y and z of the antenna, from those along the world's axes
    push = numbers.push @ np.swapaxes(rotation[:, :, 1:], 1, 2)
    times = np.full(len(found), np.nan) if batch.time_s is None else batch.time_s
    return push, Shapes(times, points, std_m, distance)


def _at_rest(contact: Contact, shift: float) -> Contact:
    """`Contacts.at_rest` of one frame."""
    if not (abs(shift) > ContactSettings.largest_shift and contact.status in LOCATED):
        return contact
    return in_motion(contact, _swinging(contact.distance_m, abs(shift) * contact.distance_std_m, shift))


def _swinging(distance_m: float, off_m: float, shift: float) -> str:
    """By how much the antenna's inertia shifts a contact's distance, m and standard deviations, in words."""
    off = f"{1e3 * off_m:.1f} mm off, {abs(shift):.1f} std"
    off = off if off_m < distance_m else "off by more than itself"
    return f"the antenna swings: its inertia puts the distance {off}"


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
        self._waiting: deque[tuple[Sequence[Contact], np.ndarray, int]] = deque()  # from which frame on

    def push(self, contacts: Sequence[Contact], push: np.ndarray, shapes: Shapes) -> Iterator[Contact]:
        """The contacts that can be judged once these frames are known, the latter two as from `motion_of`."""
        for several, rows, shift in self._judged(contacts, push, shapes):
            yield from map(_at_rest, several[rows], shift.tolist())

    def push_together(self, contacts: Contacts, push: np.ndarray, shapes: Shapes) -> Iterator[Contacts]:
        """As `push`, many frames at once."""
        return map(_rested, self._judged(contacts, push, shapes))

    def finish(self) -> Iterator[Contact]:
        """The contacts that wait for later frames, at the end of the recording."""
        loads = self._motion.finish()
        for several, rows, shift in () if loads is None else self._ready(loads):
            yield from map(_at_rest, several[rows], shift.tolist())

    def finish_together(self) -> Iterator[Contacts]:
        """As `finish`, many frames at once."""
        loads = self._motion.finish()
        return iter(()) if loads is None else map(_rested, self._ready(loads))

    def _judged(
        self, contacts: Sequence[Contact], push: np.ndarray, shapes: Shapes
    ) -> Iterator[tuple[Sequence[Contact], slice, np.ndarray]]:
        """Contacts, which of them are judged, and how far inertia shifts these, in deviations."""
        if not self._waiting and not np.isfinite(shapes.time_s).any():
            return iter([(contacts, slice(0, len(push)), np.zeros(len(push)))])
        self._waiting.append((contacts, push, 0))
        return self._ready(self._motion.push(shapes))

    def _ready(self, loads: Inertia) -> Iterator[tuple[Sequence[Contact], slice, np.ndarray]]:
        load, significant, begin = np.asarray(loads.load_N_m), np.asarray(loads.significant), 0
        while begin < len(load):
            contacts, push, first = self._waiting.popleft()
            last = min(len(push), first + len(load) - begin)
            if last < len(push):
                self._waiting.appendleft((contacts, push, last))
            own = slice(begin, begin := begin + last - first)
            shift = (push[first:last] * load[own]).sum(axis=(1, 2))
            yield contacts, slice(first, last), np.where(significant[own], shift, 0.0)


def _rested(judged: tuple[Any, slice, np.ndarray]) -> Contacts:
    """The rows of contacts that a motion test has judged, with its results (B,)."""
    contacts, rows, shift = judged
    found: Contacts = contacts if rows == slice(0, len(contacts)) else contacts.picked(rows)
    return found.at_rest(shift)


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
