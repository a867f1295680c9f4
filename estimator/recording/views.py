"""Several pictures of one frame: what each of some cameras that watch the same antenna saw of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.contact.drift import DriftSettings
from estimator.contact.estimate import ContactEstimator
from estimator.contact.inputs import Batch
from estimator.contact.settings import ContactSettings
from estimator.solver.linearised import free_antennas
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import LOCATED, ContactRow, ContactTable, Measured
from vbaa_calib.core.arrays import gate
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.least_squares import disagreement_p
from vbaa_calib.geometry.independent_axes import independent_axes
from vbaa_calib.rig import POSE_PARAMETERS, RIG_PARAMETERS, Rig
from vbaa_calib.session import READINGS, Frame

from .settings import RefineSettings

_POSE = len(POSE_PARAMETERS)  # of a camera, in front of `RIG_PARAMETERS`
_ANTENNA = slice(_POSE, len(RIG_PARAMETERS) - 2)  # the antenna's, without its sensor


@gate
@dataclass(frozen=True, eq=False)
class View:
    """A further camera's part of a recording.

    rig : of that camera, calibrated with the same antenna. recording : (B,) its frames, in the order of the contacts,
        without points where it saw nothing; the readings are the first camera's.
    """

    rig: Rig
    recording: Sequence[Measured]


@dataclass(frozen=True, eq=False)
class Pictures:
    """What one camera gives to the joint problem.

    rig : its camera's; antenna, sensor and joints are the first one's. axes : (17 + P, R) about it, of the R
        independent steps of all rigs together. touching, free : B contacts and F frames of the free antenna, at times
        free_s (F,). straight, straight_s : Z frames without a located contact, with the free antenna in the picture,
        whatever is read.
    """

    rig: Rig
    axes: np.ndarray
    touching: Batch
    free: Batch
    free_s: np.ndarray
    straight: Batch
    straight_s: np.ndarray

    def moved(self, shared: np.ndarray) -> Rig:
        """After the shared steps (S,), of which the first R are the rigs'."""
        return self.rig.moved(self.axes @ shared[: self.axes.shape[1]])


def relative_to(first: Rig, axes: np.ndarray, other: Rig) -> tuple[Rig, np.ndarray]:
    """A further camera's rig with the first one's antenna, and the axes (17 + Q, R') of its steps: the first rig's R,
    axes (17 + P, R), then what is left of the camera's pose and lens once the antenna is known.

    What a calibration knows of pose and antenna together moves the pose with the antenna.

    Raises
    ------
    InputError : it is another antenna.
    """
    wide, near = other.drifted(), first.drifted()
    apart = first.antenna.parameters - other.antenna.parameters
    both = near.covariance[_ANTENNA, _ANTENNA] + wide.covariance[_ANTENNA, _ANTENNA]
    square = float(apart @ _inverse(both) @ apart)
    length = first.antenna.length_m / other.antenna.length_m - 1.0
    if (
        abs(length) > RefineSettings.length_log
        or disagreement_p(np.array([square]), np.array([len(apart)]))[0] < RefineSettings.another_antenna
    ):
        raise InputError(
            "the cameras' rigs have different antennas",
            remedy="calibrate both cameras with the antenna of this recording",
        )
    covariance = wide.covariance
    own = np.r_[:_POSE, len(RIG_PARAMETERS) : len(covariance)]
    across = covariance[own, _ANTENNA]
    slopes = across @ _inverse(covariance[_ANTENNA, _ANTENNA])
    left = independent_axes(covariance[np.ix_(own, own)] - slopes @ across.T)
    left = left[:, np.abs(left).max(axis=0) > 0.0]
    count, tip, sensor = axes.shape[1], first.tip, first.wrench_sensor
    # sensor and tip, after pose, antenna and lens, are the first rig's
    more = axes[len(near.covariance) :]
    whole = np.zeros((len(covariance) + len(more), count + left.shape[1]))
    with_sensor = slice(_POSE, len(RIG_PARAMETERS))
    whole[with_sensor, :count] = axes[with_sensor]
    whole[own, :count], whole[own, count:] = slopes @ axes[_ANTENNA], left
    whole[len(covariance) :, :count] = more
    if sensor is not None:
        apart_from = np.zeros((len(sensor.covariance), len(covariance)))
        exact = not len(sensor.covariance)
        sensor = sensor if exact else replace(sensor, covariance=np.hstack([apart_from, sensor.own_covariance]))
    if tip is not None:
        tip = replace(tip, covariance=np.zeros(len(whole) - 1))
    step = np.zeros(len(covariance))
    step[own] = slopes @ apart
    moved = replace(wide, tip=None).moved(step)
    same = {name: getattr(first, name) for name in ("antenna", "moment_sensor", "kinematics")}
    return replace(moved, **same, gravity_world_m_s2=first.gravity_world_m_s2, wrench_sensor=sensor, tip=tip), whole


def _inverse(covariance: np.ndarray) -> np.ndarray:
    """Of a covariance (K, K) that may be singular, whatever the units of its rows."""
    std = np.sqrt(np.diag(covariance))
    unit = np.where(std > 0.0, std, 1.0)
    return np.asarray(np.linalg.pinv(covariance / np.outer(unit, unit), 1e-12, True) / np.outer(unit, unit))


def completed(contacts: ContactTable, recording: Sequence[Measured], views: Sequence[View]) -> ContactTable:
    """The contacts, those that the first camera does not locate by the others, frame by frame: edge-on to one camera,
    the antenna is seen from the side by another."""
    rows = list(contacts.rows())
    for view in views:
        open_rows = [
            index
            for index, row in enumerate(rows)
            if row.status not in (*LOCATED, "not_quasistatic")
            and len(view.recording[index].points_px) >= ContactSettings.fewest_points
        ]
        seen = (
            replace(
                view.recording[index],
                **{name: getattr(recording[index], name) for name in READINGS.values()},
                time_s=np.nan,
            )
            for index in open_rows
        )
        estimator = ContactEstimator(view.rig, friction=contacts.assumed_friction_rad)
        for index, contact in zip(open_rows, estimator.run(seen), strict=True):
            row = rows[index]
            # a touch that any of them sees is one, wherever it may be
            if contact.status in LOCATED or (row.status, contact.in_contact) == ("no_contact", True):
                reading = recording[index].moment_Nm
                frame = Frame(None, row.pan_rad, row.tilt_rad, reading, frame=row.frame, time_s=row.time_s)
                rows[index] = ContactRow.of(frame, contact)
    return ContactTable.from_rows(rows) if views else contacts


def pictures_of(
    contacts: ContactTable, rows: np.ndarray, recording: Sequence[Measured], arrays: RigArrays, rig: Rig
) -> Pictures:
    """One camera's contacts in these rows, and its frames of the free antenna."""
    touching = Batch.of(rig, [recording[row] for row in rows.tolist()])
    others = np.flatnonzero(~contacts.located)
    apart = Batch.of(rig, [recording[row] for row in others.tolist()]) if len(others) else touching.picked(slice(0))
    quiet = contacts.status[others] == "no_contact"
    quiet[quiet] = _static(apart.picked(quiet), arrays)
    straight = _static(replace(apart, readings_Nm=np.full_like(apart.readings_Nm, np.nan)), arrays)
    return Pictures(
        rig,
        arrays.axes,
        touching,
        apart.picked(quiet),
        contacts.time_s[others[quiet]],
        apart.picked(straight),
        contacts.time_s[others[straight]],
    )


def _static(batch: Batch, arrays: RigArrays) -> np.ndarray:
    """(B,) bool, frames in which the antenna is free beyond doubt, all of its errors allowed for."""
    if not len(batch):
        return np.zeros(0, bool)
    frames = batch.frames(arrays)
    static = np.asarray(frames.usable.sum(-1) >= DriftSettings.fewest_points)
    static[static] = free_antennas(frames.picked(static)).gain < DriftSettings.free_gain
    return static
