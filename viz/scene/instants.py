"""The instants of a recording that a scene can show: which frames, and each frame in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.table.contacts import ContactTable
from vbaa_calib.core.errors import InputError

from .readable import thinned

MOST = 240
"""Longer recordings are shown at this many instants spread over them, and at the one of the greatest force."""


@dataclass(frozen=True, eq=False)
class Instants:
    """M instants in the order of time.

    Attributes
    ----------
    row : (M,) index into the contact table. frame : (M,) number of the frame.
    time_s : (M,) since the recording's first frame.
    main : the instant of the greatest force: what a picture that stands still shows.
    words : M sentences on what is known of each instant.
    """

    row: np.ndarray
    time_s: np.ndarray
    frame: np.ndarray
    main: int
    words: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.row)


def instants_of(table: ContactTable, phase: np.ndarray | None = None, most: int = MOST) -> Instants:
    """The instants of a recording. `phase` (B,) is a word per frame on its motion, as `estimator.track` gives it.

    Raises InputError when no frame has a located contact, or one is out of reach.
    """
    refuse_out_of_reach(table)
    if not table.located.any():
        raise InputError(
            "no frame has a located contact (status ok or tip_contact)", remedy="see the reason column of contacts.csv"
        )
    # tables of other makers may have points without forces
    force = np.linalg.norm(table.force_world_N, axis=1)
    strongest = int(np.argmax(np.where(table.located, np.nan_to_num(force), -1.0)))
    rows = np.union1d(thinned(np.arange(len(table)), most), strongest)
    return Instants(
        row=rows,
        time_s=table.time_s[rows] - table.time_s[0],
        frame=table.frame[rows],
        main=int(np.searchsorted(rows, strongest)),
        words=tuple(_words(table, int(row), "" if phase is None else str(phase[row]), force[row]) for row in rows),
    )


def refuse_out_of_reach(table: ContactTable, where: object = None) -> None:
    """Raises InputError for a contact beyond 10 km or 10 kN: single precision, in which all is drawn, fails there."""
    for values, unit in ((table.force_world_N, "N"), (table.point_world_m, "m")):
        beyond = np.flatnonzero(table.located & (np.abs(np.nan_to_num(values)) > 1e4).any(axis=1))
        if len(beyond):
            what = f"frame {table.frame[beyond[0]]} has a contact beyond 10000 {unit}"
            raise InputError(what, where=where, remedy="estimate it again: no antenna reaches that far")


def _words(table: ContactTable, row: int, phase: str, force: float) -> str:
    """For example "sliding: 157.4 ± 0.2 mm from the clamp, 69.1 mN"."""
    status = str(table.status[row]).replace("_", " ")
    known = [phase] if phase not in ("", "unknown", "free") else []
    head = ", ".join(known if known and status == "ok" else [*known, "located" if status == "ok" else status])
    if not table.located[row]:
        return head
    distance, std = table.distance_m[row], table.distance_std_m[row]
    parts = []
    if np.isfinite(distance):
        spread = f" ± {1e3 * std:.2g}" if np.isfinite(std) else ""
        parts.append(f"{1e3 * distance:.1f}{spread} mm from the clamp")
    if np.isfinite(force):
        parts.append(f"{1e3 * force:.1f} mN")
    return f"{head}: {', '.join(parts)}" if parts else head
