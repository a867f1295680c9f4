"""The located contacts of one object, with their errors split into own and shared ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.contact.common_errors import CommonErrors
from estimator.object.surface.settings import SurfaceSettings
from estimator.table.contacts import ContactTable
from vbaa_calib.core.arrays import Rows, spread_evenly
from vbaa_calib.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Touches(Rows):
    """P located contacts, world frame."""

    point_m: np.ndarray  # (P, 3) on the antenna's centreline
    force_N: np.ndarray  # (P, 3) the object's force on the antenna, not zero
    tangent: np.ndarray  # (P, 3) of the antenna, towards the tip; NaN where unknown, and at the tip
    distance_m: np.ndarray  # (P,) arc length from the clamp
    own_m2: np.ndarray  # (P, 3, 3) covariance of a point's own error, independent of the others'; NaN where unknown
    modes_m: np.ndarray  # (P, 3, S) effects of S independent common errors of unit deviation
    force_modes_N: np.ndarray  # (P, 3, S)
    tangent_modes: np.ndarray  # (P, 3, S)
    frame: np.ndarray  # (P,)
    row: np.ndarray  # (P,) of the table
    notes: tuple[str, ...] = ()  # what was left out, in words


def touches_of(table: ContactTable, shared: CommonErrors | None = None) -> Touches:
    """The usable contacts: located, with a force of known direction; thinned to `most_touches`.

    `shared` are the common parts of their errors; without it all errors count as each contact's own. Raises InputError
    where no frame has a contact point with its force.
    """
    size = np.linalg.norm(table.force_world_N, axis=1)
    usable = table.located & np.isfinite(table.point_world_m).all(axis=1) & np.isfinite(size) & (size > 0)
    biased = usable & (table.bias_std > SurfaceSettings.biased_std)
    row, left_out, off = np.flatnonzero(usable & ~biased), int(biased.sum()), "off by more than one standard deviation"
    if not len(row):
        what = "no frame has a located contact with a force (status ok or tip_contact)"
        remedy = "record contacts, or see the reason column of contacts.csv"
        if left_out:
            what = f"all {left_out} contacts were found with a model that is {off}"
            remedy = "estimate them with --model auto"
        elif table.located.any() and not np.isfinite(table.force_world_N).all(axis=1).any():
            what, remedy = "the contacts have no force in the world frame (FX_N, FY_N, FZ_N)", "estimate them again"
        raise InputError(what, remedy=remedy)
    partly, why = int((table.located & ~usable).sum()), "the force is not known in all directions"
    unused = ((partly, why), (left_out, f"the model is {off}"))
    notes = [f"{count} contact{'s' * (count != 1)} not used: {words}" for count, words in unused if count]
    if len(row) > SurfaceSettings.most_touches:
        notes.append(f"{len(row)} contacts were thinned evenly to {SurfaceSettings.most_touches}")
        row = row[spread_evenly(len(row), SurfaceSettings.most_touches)]
    if shared is None:
        shared = CommonErrors.none(table)
    elif unknown := int(np.sum(~np.isfinite(shared.point_m[row]).all(axis=(1, 2)))):
        why = "the calibration's errors are not given (distance_std_m): they count as the contacts' own"
        notes.append(f"of {unknown} contacts {why}")
    tangent = table.tangent_world[row]
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    known = (np.abs(length - 1) < 0.1) & (table.status[row] != "tip_contact")[:, None]
    every = (each[row] for each in (shared.point_m, shared.force_N, shared.tangent))
    modes_m, force_modes_N, tangent_modes = (np.where(np.isfinite(each), each, 0.0) for each in every)
    return Touches(
        point_m=table.point_world_m[row],
        force_N=table.force_world_N[row],
        tangent=np.where(known, tangent / np.where(known, length, 1.0), np.nan),
        distance_m=table.distance_m[row],
        own_m2=shared.own_m2[row],
        modes_m=modes_m,
        force_modes_N=force_modes_N,
        tangent_modes=tangent_modes,
        frame=table.frame[row],
        row=row,
        notes=tuple(notes),
    )
