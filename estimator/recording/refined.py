"""Contacts of a recording refined jointly: rig errors and friction are estimated from all frames together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.contact.common_errors import empty_frames, unknowns_of
from estimator.contact.drift import DriftSettings, parameter_changes
from estimator.contact.estimate import ContactEstimator
from estimator.contact.inputs import Batch
from estimator.contact.settings import ContactSettings
from estimator.object.estimate import estimate_object
from estimator.object.friction import Friction, steady_slides
from estimator.recording.problem import FrictionPrior, RecordingProblem, State
from estimator.recording.settings import RefineSettings
from estimator.recording.solve import Solution, solved
from estimator.solver.linearised import bend, free_antennas, linearised
from estimator.solver.rig_arrays import UNKNOWNS, RigArrays
from estimator.table.contacts import COLUMNS, FRICTION_RAD, LOCATED, ContactRow, ContactTable, Measured, joint_angles
from vbaa_calib.antenna.rungs import REFERENCE
from vbaa_calib.antenna.shape import CONTACT
from vbaa_calib.core.arrays import validate_arguments
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.robust import finite_or_none
from vbaa_calib.rig import POSE_PARAMETERS, Rig
from vbaa_calib.session import Frame, KnownObject

if TYPE_CHECKING:
    from estimator.object.estimate import ObjectEstimate
    from estimator.object.track import Track


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of refining a recording of B frames."""

    contacts: ContactTable  # with refined numbers; their shared deviations are what is left of rig and friction
    framewise: ContactTable  # the table as it came
    refined: np.ndarray  # (B,) bool, which frames were
    foreign: np.ndarray  # (B,) bool, which contradict the rest and stay as they were
    rig: Rig  # by all frames together, with what is left of its covariance
    calibrated: Rig  # the rig as it came
    object: ObjectEstimate | None  # by the refined contacts, before its friction is used; None without evidence
    reason: str  # why nothing was refined; "" where something was
    notes: tuple[str, ...]
    offness: float  # how far the rig is off, in its calibration's deviations
    rig_p: float  # probability that it is so by accident
    trend_p: float = 1.0  # probability that a rig which stays as it is seems to change as much with time

    @property
    def friction(self) -> Friction | None:
        """The object's friction."""
        return None if self.object is None else self.object.friction

    def summary(self) -> dict[str, Any]:
        """The numbers as plain data."""
        rows = self.refined
        before, after = self.framewise.picked(rows), self.contacts.picked(rows)
        left = self.calibrated.drifted() if self.reason else self.rig.drifted(0.0)
        std = np.sqrt(np.diag(left.covariance))
        of_object = {} if self.object is None else self.object.summary()
        return {
            "frames": len(rows),
            "located": int(self.framewise.located.sum()),
            "refined": int(rows.sum()),
            "foreign": [int(each) for each in self.framewise.frame[self.foreign]],
            "reason": self.reason,
            "notes": list(self.notes),
            "distance_std_m": _pair(before.distance_std_m, after.distance_std_m),
            "distance_shared_std_m": _pair(before.distance_shared_std_m, after.distance_shared_std_m),
            "friction": of_object.get("friction"),
            "stiffness": of_object.get("stiffness"),
            "rig": {
                "offness": finite_or_none(self.offness),
                "p": finite_or_none(self.rig_p),
                "parameters": parameter_changes(self.calibrated, self.rig.step_from(self.calibrated)[: len(std)], std),
            },
        }


def _pair(before: np.ndarray, after: np.ndarray) -> dict[str, float | None]:
    """Root mean squares before and after."""
    values = (float(np.sqrt(np.mean(each**2))) if len(each) else np.nan for each in (before, after))
    return dict(zip(("framewise", "refined"), map(finite_or_none, values), strict=True))


@validate_arguments
def refine(
    contacts: ContactTable, rig: Rig, recording: Sequence[Measured], known: KnownObject | None = None
) -> Refined:
    """Solve one maximum a posteriori problem over all frames of a recording.

    contacts : of `vbaa estimate` with this rig. recording : what was measured in each of its B frames, in order.
    rig : as calibrated, with the drift that may have come since; with several cameras, `recording` has what each saw.
    known : the object, where its place is known.

    Raises
    ------
    InputError : contacts and recording are not of one another, or not of this rig; no frame is located.
    """
    _check_frames(contacts, recording)
    came, contacts = contacts, _completed(contacts, recording, rig)
    _check(contacts, rig)
    rows = _usable(contacts, recording)
    problem, start = _begun(contacts, rig, recording, rows, known)
    strokes = _strokes(contacts, rows)
    found = solved(problem, start, strokes)
    reason = _refusal(found, known is not None) or _walk_of_zero(contacts, rig, recording)
    touched: ObjectEstimate | None = None
    notes: list[str] = []
    if not reason and known is not None and found.offness > RefineSettings.allowed_excess:
        notes.append(f"the rig is off {found.offness:.1f} times as far as its calibration says; allowed for")
        offness, p = found.offness, found.prior_p
        found = replace(solved(problem, found.state, strokes, offness), offness=offness, prior_p=p)
    elif not reason and known is None:
        table = _table(contacts, problem, found, rows)
        touched = _object(table, _rig_of(problem, found))
        before = _as_estimated(table, problem.friction_rad)
        prior = None if touched is None else _by_coulomb(table, touched.track, touched.friction, before)
        if prior is not None:
            problem, found, note = _with_coulomb(problem, found, prior.picked(rows), strokes)
            notes += note
    # with two cameras the rig is known so well that the frames' errors of second order look like a trend
    if not reason and not rig.others and found.trend_p < RefineSettings.another_rig:
        found = found.changing()
        size = 2.0 * float(np.linalg.norm(found.trend))
        notes.append(
            f"the rig changes while the recording lasts, by {size:.1f} deviations of its calibration: allowed for; "
            "it is better refined in parts"
        )
    foreign, refined = np.zeros((2, len(contacts)), bool)
    foreign[rows[found.weight == 0.0]] = True
    if reason:
        nothing = np.zeros(len(contacts), bool)
        return Refined(came, came, nothing, foreign, rig, rig, None, reason, (), found.offness, found.prior_p)
    if foreign.any():
        notes.append(f"{foreign.sum()} frames do not belong to the rest and stay as they were")
    refined[rows[found.weight > 0.0]] = True
    table, better = _table(contacts, problem, found, rows), _rig_of(problem, found)
    off = found.offness, found.prior_p, found.trend_p
    return Refined(table, contacts, refined, foreign, better, rig, touched, "", tuple(notes), *off)


def _completed(contacts: ContactTable, recording: Sequence[Measured], rig: Rig) -> ContactTable:
    """The contacts of a rig with several cameras, with unlocated ones estimated again from all of them: edge-on to
    one camera, the antenna is seen from the side by another."""
    if not rig.others:
        return contacts
    rows = list(contacts.rows())
    open_rows = [index for index, row in enumerate(rows) if row.status not in (*LOCATED, "not_quasistatic")]
    estimator = ContactEstimator(rig, friction=contacts.assumed_friction_rad)
    seen = (replace(recording[index], time_s=np.nan) for index in open_rows)
    for index, contact in zip(open_rows, estimator.run(seen), strict=True):
        row = rows[index]
        # a touch that any of them sees is one, wherever it may be
        if contact.status in LOCATED or (row.status, contact.in_contact) == ("no_contact", True):
            reading = recording[index].moment_Nm
            frame = Frame(None, row.pan_rad, row.tilt_rad, reading, frame=row.frame, time_s=row.time_s)
            rows[index] = ContactRow.of(frame, contact)
    return ContactTable.from_rows(rows)


def _with_coulomb(
    problem: RecordingProblem, found: Solution, prior: FrictionPrior, strokes: np.ndarray
) -> tuple[RecordingProblem, Solution, list[str]]:
    """The recording solved again with friction angles by Coulomb's law, except in frames that contradict it, and
    notes; unchanged where many do."""
    again = replace(problem, friction=prior)
    second = solved(again, found.state, strokes)
    angle = again.friction_rad * second.state.unknowns[:, 3]
    std = again.friction_rad * np.sqrt(second.equations.own_covariance[:, 3, 3])
    wrong, broken = _contradicted(prior, angle, std)
    if broken:
        note = f"{wrong.sum()} frames see a friction that is not Coulomb's with one coefficient: not used"
        return problem, found, [note]
    if wrong.any():
        before = problem.friction
        mean, spread = np.where(wrong, (before.mean_rad, before.std_rad), (prior.mean_rad, prior.std_rad))
        again = replace(problem, friction=FrictionPrior(mean, spread))
        second = solved(again, second.state, strokes)
    return again, second, []


def _check_frames(contacts: ContactTable, recording: Sequence[Measured]) -> None:
    """Raises InputError where the frames are not those that the contacts were made of."""
    if len(recording) != len(contacts):
        raise InputError(
            f"{len(contacts)} contacts, but {len(recording)} frames", remedy="give the recording that they were made of"
        )
    apart = np.array([[each.pan_rad, each.tilt_rad] for each in recording]) - np.stack(
        [contacts.pan_rad, contacts.tilt_rad], axis=1
    )
    far = np.abs(apart).max(axis=1) > RefineSettings.joints_apart_rad
    if far.any():
        which = int(contacts.frame[np.argmax(far)])
        raise InputError(
            f"frame {which} has other joint angles in the recording than among the contacts",
            remedy="give the session that the contacts were made of",
        )


def _check(contacts: ContactTable, rig: Rig) -> None:
    """Raises InputError where the contacts are not of this rig, or none has a point."""
    joint_angles(rig.kinematics, contacts)
    if not contacts.located.any():
        raise InputError("no frame has a contact point", remedy="estimate a recording in which the antenna touches")
    longest = float(np.nanmax(np.where(contacts.located, contacts.distance_m, np.nan)))
    if longest > 1.001 * rig.antenna.length_m:
        raise InputError(
            f"a contact lies {longest:.3f} m along the antenna, which is {rig.antenna.length_m:.3f} m long",
            remedy="give the rig.json that the contacts were made with",
        )


def _usable(contacts: ContactTable, recording: Sequence[Measured]) -> np.ndarray:
    """(P,) rows of located frames with a force and enough points in one camera's picture."""
    points = [
        max(np.isfinite(seen.points_px).all(axis=1).sum() for seen in (each, *each.others.values()))
        for each in recording
    ]
    enough = np.array(points) >= ContactSettings.fewest_points
    whole = np.isfinite(contacts.distance_std_m + contacts.force_y_N + contacts.force_z_N)
    rows = np.flatnonzero(contacts.located & whole & enough)
    if not len(rows) and (contacts.located & ~whole & enough).any():
        what = "in no located frame is the force known in all directions"
        raise InputError(what, remedy="tilt the camera along the antenna, or read the moment")
    if not len(rows):
        raise InputError("no located frame has points in the recording", remedy="give the session of these contacts")
    return rows


def _begun(
    contacts: ContactTable, rig: Rig, recording: Sequence[Measured], rows: np.ndarray, known: KnownObject | None
) -> tuple[RecordingProblem, State]:
    """The problem and its initial state: the contacts as estimated, the rig as calibrated."""
    arrays, at = RigArrays.from_rig(rig, FRICTION_RAD), contacts.picked(rows)
    touching = Batch.of(rig, [recording[row] for row in rows.tolist()])
    quiet = np.flatnonzero(contacts.status == "no_contact")
    free = Batch.of(rig, [recording[row] for row in quiet.tolist()]) if len(quiet) else touching.picked(slice(0))
    static = _static(free, arrays)
    problem = RecordingProblem(
        rig=rig,
        axes=arrays.axes,
        touching=touching,
        free=free.picked(static),
        free_s=contacts.time_s[quiet[static]],
        friction_rad=FRICTION_RAD,
        fixed_at_tip=at.status == "tip_contact",
        friction=_as_estimated(at, FRICTION_RAD),
        time_s=at.time_s,
        known=known,
    )
    rotation, _ = rig.kinematics.world_antenna(at.pan_rad, at.tilt_rad)
    gravity = np.einsum("bji,j->bi", rotation, rig.gravity_world_m_s2)
    unknowns = unknowns_of(empty_frames(arrays, gravity), contacts, rows)
    return problem, State(unknowns, np.zeros(problem.size))


def _strokes(contacts: ContactTable, rows: np.ndarray) -> np.ndarray:
    """(P,) index of the stroke to which each of these rows belongs."""
    late = np.diff(contacts.time_s[rows]) > RefineSettings.gap_s
    return np.concatenate([[0], np.cumsum((np.diff(rows) > RefineSettings.gap_frames) | late)])


def _refusal(found: Solution, known: bool) -> str:
    """The reason why the recording cannot be refined; "" if it can."""
    if not found.converged or not np.isfinite(found.state.shared).all():
        return "the frames do not come to a common solution: is it another rig?"
    foreign = float(np.mean(found.weight == 0.0))
    if foreign > RefineSettings.foreign_share:
        share = f"{100 * foreign:.0f} % of the frames contradict the rest"
        return f"{share}: the rig changed in between, or it is another one; look at `vbaa check`"
    if found.prior_p < RefineSettings.another_rig and (not known or found.offness >= RefineSettings.largest_excess):
        off = f"the frames together say that the rig is off {found.offness:.1f} times as far as its calibration says"
        return f"{off}: it has drifted beyond what was allowed for, or it is another rig; look at `vbaa check`"
    return ""


def _object(table: ContactTable, rig: Rig) -> ObjectEstimate | None:
    try:
        return estimate_object(table, rig, events=False)
    except InputError:
        return None


def _rig_of(problem: RecordingProblem, found: Solution) -> Rig:
    """The rig with the solved shared steps and its posterior covariance."""
    axes, count = problem.axes, problem.axes.shape[1]
    covariance = axes @ found.covariance[:count, :count] @ axes.T
    return problem.rig_at(found.state.shared).with_covariance(0.5 * (covariance + covariance.T))


def _refined_reason(reason: str) -> str:
    """The reason without what no longer applies: the friction is known now."""
    return "; ".join([*(each for each in reason.split("; ") if "(--friction)" not in each), "refined"])


def _table(contacts: ContactTable, problem: RecordingProblem, found: Solution, rows: np.ndarray) -> ContactTable:
    """The table with the refined frames' numbers. A frame's covariance is its own noise plus what it shares: the
    remaining errors of the rig and, since neighbours rub alike, of the friction angle."""
    belongs = found.weight > 0.0
    equations, unknowns = found.equations, found.state.unknowns
    rig = problem.rig_at(found.state.shared)
    length, kinematics = rig.antenna.length_m, rig.kinematics
    batch = problem.touching
    rotation, translation = kinematics.world_antenna(batch.pan_rad, batch.tilt_rad)
    # columns: point and force, then the distance
    by_own = np.concatenate([equations.by_own, length * np.eye(UNKNOWNS)[None, :1].repeat(len(rows), 0)], axis=1)
    by_shared = np.concatenate([equations.by_shared, np.zeros((len(rows), 1, problem.size))], axis=1)
    total = by_own @ equations.own_covariance @ np.swapaxes(by_own, 1, 2)
    of_friction = (
        by_own @ equations.own_covariance[:, :, 3:] * (problem.friction_rad / problem.friction.std_rad)[:, None, None]
    )
    root = np.linalg.cholesky(found.covariance)
    modes = np.concatenate([(by_shared - by_own @ equations.through) @ root, of_friction], axis=2)
    world = np.einsum("bij,bjs->bis", rotation, modes[:, :3])
    point = np.einsum("bij,bj->bi", rotation, equations.touch[:, :3]) + translation
    if not kinematics.axes_known:
        turned, shifted = kinematics.by_axes(batch.pan_rad, batch.tilt_rad)
        moved = np.einsum("kbij,bj->bik", turned, equations.touch[:, :3]) + np.moveaxis(shifted, 0, -1)
        pose = problem.axes[: len(POSE_PARAMETERS)] @ root[: problem.axes.shape[1]]
        world[:, :, : root.shape[1]] += moved @ kinematics.axes_by_pose @ pose
        world = np.concatenate([world, moved * kinematics.axes_std], axis=2)
    shared = modes @ np.swapaxes(modes, 1, 2)
    # the friction's part is in the own covariance of the unknowns, too
    friction_part = of_friction @ np.swapaxes(of_friction, 1, 2)
    whole = total - friction_part + shared
    own_world = rotation @ (total - friction_part)[:, :3, :3] @ np.swapaxes(rotation, 1, 2)
    world_shared = world @ np.swapaxes(world, 1, 2)
    arrays = problem.arrays_at(found.state.shared)
    gravity = np.einsum("bji,j->bi", rotation, rig.gravity_world_m_s2)
    lying = unknowns * np.array([1.0, 0.0, 0.0, 0.0])
    free = bend(empty_frames(arrays, gravity), REFERENCE, lying[:, None]).points_m[:, CONTACT]
    sensor = rig.moment_sensor
    std = np.sqrt(np.einsum("bii->bi", whole))
    shared_std = np.sqrt(np.einsum("bii->bi", shared))
    angle_std = problem.friction_rad * np.sqrt(equations.own_covariance[:, 3, 3])
    put = {
        "distance_m": unknowns[:, 0] * length,
        "distance_std_m": std[:, 6],
        "distance_shared_std_m": shared_std[:, 6],
        "point_antenna_m": equations.touch[:, :3],
        "point_world_m": point,
        "covariance_world_m2": own_world + world_shared,
        "point_shared_std_m": np.sqrt(np.einsum("bii->bi", world_shared)),
        "force_covariance_yz_N2": whole[:, 4, 5],
        "force_shared_std_N": shared_std[:, 3:6],
        "force_world_N": np.einsum("bij,bj->bi", rotation, equations.touch[:, 3:]),
        "tangent_world": np.einsum("bij,bj->bi", rotation, equations.tangent),
        "moment_residual_Nm": np.where(
            np.isfinite(batch.readings_Nm[:, 0]), equations.reading * rig.reading_noise[0] / sensor.gain, np.nan
        ),
        "friction_angle_rad": problem.friction_rad * unknowns[:, 3],
        "friction_angle_std_rad": angle_std,
        "friction_prior_rad": problem.friction.std_rad,
        "force_y_N": equations.touch[:, 4],
        "force_y_std_N": std[:, 4],
        "force_z_N": equations.touch[:, 5],
        "force_z_std_N": std[:, 5],
        "deflection_y_m": (equations.touch[:, :3] - free)[:, 1],
        "deflection_z_m": (equations.touch[:, :3] - free)[:, 2],
        "bias_std": np.zeros(len(rows)),
        "model": np.full(len(rows), REFERENCE),
        "reason": np.array([_refined_reason(each) for each in contacts.reason[rows]], dtype=object),
    }
    columns = {}
    for name in COLUMNS:
        column = getattr(contacts, name)
        if name in put:
            column = column.astype(object) if name in ("reason", "model") else column.copy()
            column[rows[belongs]] = put[name][belongs]
            column = column.astype(str) if name in ("reason", "model") else column
        columns[name] = column
    return ContactTable(**columns)


def _as_estimated(table: ContactTable, unit_rad: float) -> FrictionPrior:
    """The prior with which frames were estimated one by one."""
    known = np.where(np.isfinite(table.friction_prior_rad), table.friction_prior_rad, unit_rad)
    return FrictionPrior(np.zeros(len(table)), np.maximum(known, 1e-4))


def _by_coulomb(table: ContactTable, track: Track, friction: Friction, before: FrictionPrior) -> FrictionPrior | None:
    """Prior of the friction angles (B,) by the recording's coefficient; None where it has none.

    All lie in the cone. Where the shape determines the object's normal, the force's direction λ about the antenna says
    how much of the cone is left along it: tan²α ≤ μ² − tan²λ, with equality where the contact slides, and along the
    antenna the slip's sign is the angle's. At the tip nothing is known.
    """
    if friction.determined:
        mu, std = friction.mu, friction.std
    elif np.isfinite(friction.interval[1]):
        mu, std = float(friction.interval[1]), 0.0
    else:
        return None
    cone = np.hypot(np.arctan(mu + std), RefineSettings.least_friction_rad)
    mean, spread = np.zeros(len(table)), np.full(len(table), cone / np.sqrt(2.0))
    if not friction.determined:
        spread = np.minimum(spread, before.std_rad)
    else:
        rows, across = friction.row, np.tan(np.clip(friction.lateral_rad, -1.0, 1.0)) / mu if mu > 0.0 else None
        known = friction.lateral_std_rad < RefineSettings.lateral_known_rad
        if across is not None:
            unsure = friction.lateral_std_rad / mu
            left = np.maximum(1.0 - across**2, 0.0) + 2.0 * np.abs(across) * unsure + unsure**2
            rim = np.hypot(np.arctan(mu) * np.sqrt(np.minimum(left, 1.0)), RefineSettings.least_friction_rad)
            spread[rows[known]] = np.minimum(rim, spread[rows])[known]
        speed = np.linalg.norm(track.slip_velocity_m_s, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            along, turn = track.longitudinal_m_s / speed, track.slip_std_m_s / speed
            slides = (
                steady_slides(track, table.time_s)
                & (np.abs(along) > RefineSettings.slip_along)
                & (turn < RefineSettings.slip_turn)
            )
            sliding_rad = np.arctan(mu * along)
            doubt = np.sqrt((std * along) ** 2 + (RefineSettings.rim * mu) ** 2 + RefineSettings.least_friction_rad**2)
        mean, spread = np.where(slides, sliding_rad, mean), np.where(slides, doubt, spread)
    at_tip = table.status == "tip_contact"
    return FrictionPrior(np.where(at_tip, before.mean_rad, mean), np.where(at_tip, before.std_rad, spread))


def _contradicted(prior: FrictionPrior, angle_rad: np.ndarray, std_rad: np.ndarray) -> tuple[np.ndarray, bool]:
    """(B,) mask of the frames that contradict the law's angle, and whether they are so many that it does not apply.
    angle_rad, std_rad : (B,) posterior with the prior."""
    reduction = prior.std_rad**2 - std_rad**2
    tells = reduction > RefineSettings.informative * prior.std_rad**2
    off = np.abs(angle_rad - prior.mean_rad) / np.sqrt(np.maximum(reduction, 1e-12))
    wrong = tells & (off > RefineSettings.law_contradicted)
    return wrong, bool(wrong.sum() > max(3, RefineSettings.law_share * tells.sum()))


def _static(batch: Batch, arrays: RigArrays) -> np.ndarray:
    """(B,) mask of the frames in which the antenna is certainly free, with all of its errors allowed for."""
    if not len(batch):
        return np.zeros(0, bool)
    frames = batch.frames(arrays)
    static = np.asarray(frames.usable.sum(-1) >= DriftSettings.fewest_points)
    static[static] = free_antennas(frames.picked(static)).gain < DriftSettings.free_gain
    return static


def _walk_of_zero(contacts: ContactTable, rig: Rig, recording: Sequence[Measured]) -> str:
    """How far the moment sensor's zero drifts, in words, by the frames without a located contact in which the pictures
    alone show the free antenna; "" where the drift is within the noise of the readings and the rig's uncertainty.

    What such frames read in addition to the free antenna's weight is the zero, unless something pushes along the line
    of sight: that comes and goes with the strokes, and the zero does not.
    """
    rows = np.flatnonzero(~contacts.located & np.isfinite(contacts.time_s))
    if len(rows) < RefineSettings.zero_frames:
        return ""
    arrays, apart = RigArrays.from_rig(rig, FRICTION_RAD), Batch.of(rig, [recording[row] for row in rows.tolist()])
    read = _static(replace(apart, readings_Nm=np.full_like(apart.readings_Nm, np.nan)), arrays)
    read &= np.isfinite(apart.readings_Nm[:, 0])
    time_s = contacts.time_s[rows][read]
    if len(time_s) < RefineSettings.zero_frames or not np.ptp(time_s) > 0.0:
        return ""
    frames = apart.picked(read).frames(arrays)
    found = linearised(frames, REFERENCE, np.tile(np.array([0.5, 0.0, 0.0, 0.0]), (len(time_s), 1)))
    off, by_rig = found.residual[:, 0], found.readings[:, 0, UNKNOWNS:]
    when = (time_s - time_s.mean()) / np.ptp(time_s)
    # every two frames' slope, the median: frames that are pushed along the line of sight are few, or scatter
    first, second = np.triu_indices(len(when), 1)
    apart = when[second] - when[first]
    far = np.abs(apart) > 0.1
    slope = float(np.median((off[second] - off[first])[far] / apart[far]))
    rest = off - slope * when
    scatter = max(1.0, 1.4826 * float(np.median(np.abs(rest - np.median(rest)))))
    of_rig = float(np.linalg.norm(when @ by_rig) / (when @ when))
    std = np.hypot(scatter * np.sqrt(np.pi / 2.0 / (when @ when)), of_rig)
    if abs(slope) < RefineSettings.zero_walks * std:
        return ""
    return (
        f"the moment sensor's zero walks by {slope:+.0f} deviations of its noise while the recording lasts, or "
        "something pushes along the line of sight: forces would be off by as much; look at `vbaa estimate --track-zero`"
    )
