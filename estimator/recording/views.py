"""One frame as seen by several cameras: each camera's part of the joint problem of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.contact.drift import DriftSettings
from estimator.contact.estimate import ContactEstimator
from estimator.contact.inputs import Batch
from estimator.solver.linearised import free_antennas
from estimator.solver.rig_arrays import RigArrays
from estimator.table.contacts import LOCATED, ContactRow, ContactTable, Measured
from vbaa_calib.rig import Rig
from vbaa_calib.session import Frame


@dataclass(frozen=True, eq=False)
class Pictures:
    """One camera's part of the joint problem.

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
        """The part after the shared steps (S,), of which the first R are the rig's."""
        return self.rig.moved(self.axes @ shared[: self.axes.shape[1]])


def completed(contacts: ContactTable, recording: Sequence[Measured], rig: Rig) -> ContactTable:
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
    """(B,) mask of the frames in which the antenna is certainly free, with all of its errors allowed for."""
    if not len(batch):
        return np.zeros(0, bool)
    frames = batch.frames(arrays)
    static = np.asarray(frames.usable.sum(-1) >= DriftSettings.fewest_points)
    static[static] = free_antennas(frames.picked(static)).gain < DriftSettings.free_gain
    return static
