"""The moments of a recording that a scene can show: which frames, and each frame in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError

from .readable import thinned

MOST_FORCE_N, MOST_WAY_M = 1e4, 1e4
MOST = 240
"""Longer recordings are shown at this many moments spread over them, and at the one of the greatest force."""


@dataclass(frozen=True, eq=False)
class Moments:
    """M moments in the order of time.

    Attributes
    ----------
    row : (M,) index into the contact table.
    time_s : (M,) since the recording's first frame.
    frame : (M,) number of the frame.
    main : the moment of the greatest force: what a picture that stands still shows.
    words : M sentences on what is known of each moment.
    """

    row: np.ndarray
    time_s: np.ndarray
    frame: np.ndarray
    main: int
    words: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.row)


def moments_of(table: ContactTable, phase: np.ndarray | None = None, most: int = MOST) -> Moments:
    """The moments of a recording.

    Parameters
    ----------
    phase : (B,) a word per frame on its motion, as `estimator.track` gives it.

    Raises
    ------
    InputError : no frame has a located contact, or one lies or is pushed beyond all measure.
    """
    refuse_absurd(table)
    size = np.where(table.located, np.linalg.norm(table.force_world_N, axis=1), np.nan)
    if not table.located.any():
        raise InputError(
            "no frame has a located contact (status ok or tip_contact)", remedy="see the reason column of contacts.csv"
        )
    # tables of other makers may have points without forces
    strongest = int(np.nanargmax(size)) if np.isfinite(size).any() else int(np.flatnonzero(table.located)[0])
    rows = np.union1d(thinned(np.arange(len(table)), most), strongest)
    return Moments(
        row=rows,
        time_s=table.time_s[rows] - table.time_s[0],
        frame=table.frame[rows],
        main=int(np.searchsorted(rows, strongest)),
        words=tuple(_words(table, int(row), None if phase is None else str(phase[row])) for row in rows),
    )


def refuse_absurd(table: ContactTable, where: object = None) -> None:
    """Raises InputError for a contact beyond all measure: single precision, in which all is drawn, cannot hold it."""
    for values, most, unit in ((table.force_world_N, MOST_FORCE_N, "N"), (table.point_world_m, MOST_WAY_M, "m")):
        beyond = np.flatnonzero(table.located & (np.abs(np.nan_to_num(values)) > most).any(axis=1))
        if len(beyond):
            what = f"frame {table.frame[beyond[0]]} has a contact beyond {most:g} {unit}"
            raise InputError(what, where=where, remedy="estimate it again: no antenna reaches that far")


def _words(table: ContactTable, row: int, phase: str | None) -> str:
    """For example "sliding: 157.4 ± 0.2 mm from the clamp, 69.1 mN"."""
    status = str(table.status[row]).replace("_", " ")
    head = "located" if status == "ok" else status
    if phase not in (None, "", "unknown", "free"):
        head = f"{phase}, {head}" if status != "ok" else str(phase)
    if not table.located[row]:
        return head
    parts = []
    if np.isfinite(table.distance_m[row]):
        std = table.distance_std_m[row]
        spread = f" ± {1e3 * std:.2g}" if np.isfinite(std) else ""
        parts.append(f"{1e3 * table.distance_m[row]:.1f}{spread} mm from the clamp")
    size = float(np.linalg.norm(table.force_world_N[row]))
    if np.isfinite(size):
        parts.append(f"{1e3 * size:.1f} mN")
    return f"{head}: {', '.join(parts)}" if parts else head
