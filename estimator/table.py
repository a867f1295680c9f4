"""contacts.csv: one row per frame, whatever became of it."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vbaa_calib.errors import InputError
from vbaa_calib.files import number, read_csv, write_text

if TYPE_CHECKING:
    from .contact import Contact

STATUSES = (
    "ok",
    "no_contact",
    "tip_contact",
    "unobservable",
    "low_signal",
    "not_quasistatic",
    "no_antenna",
    "failed",
)
LOCATED = ("ok", "tip_contact")
"""The statuses whose contact point may be used."""

_SCALARS = (
    "distance_m",
    "distance_std_m",
    "force_y_N",
    "force_y_std_N",
    "force_z_N",
    "force_z_std_N",
    "deflection_y_m",
    "deflection_z_m",
    "moment_residual_Nm",
)
_VECTORS = {
    "point_antenna_m": ("x_m", "y_m", "z_m"),
    "point_world_m": ("X_m", "Y_m", "Z_m"),
    "covariance_world_m2": ("cov_XX", "cov_XY", "cov_XZ", "cov_YY", "cov_YZ", "cov_ZZ"),
    "force_world_N": ("FX_N", "FY_N", "FZ_N"),
}
_UPPER = np.triu_indices(3)

COLUMNS = (
    *("frame", "time_s", "status", "in_contact", "model"),
    *_SCALARS[:-1],
    *_VECTORS["point_antenna_m"],
    *_VECTORS["point_world_m"],
    *_VECTORS["covariance_world_m2"],
    *("moment_residual_Nm", "reason"),
)
"""What every contacts.csv has."""
EXTRA_COLUMNS = _VECTORS["force_world_N"]
"""What ours has besides; optional when read."""
_NEEDED_WHEN_LOCATED = ("distance_m", "force_y_N", "force_z_N", "point_antenna_m", "point_world_m")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


def _unknown(*shape: int) -> np.ndarray:
    return np.full(shape, np.nan)


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactRow:
    """What is known of one frame. A number that does not exist is NaN here and an empty cell in the file.

    Attributes
    ----------
    status : one of `STATUSES`; `reason` says in words why it is not "ok".
    in_contact : False also where it is not known.
    model : name of the mechanical model that was fitted.
    distance_m, distance_std_m : arc length from the clamp to the contact.
    force_y_N, force_z_N : the object's force on the antenna, antenna frame, each with its standard deviation.
    deflection_y_m, deflection_z_m : contact point less the same point of the free antenna, antenna frame.
    point_antenna_m, point_world_m : (3,) the contact on the antenna's centreline.
    covariance_world_m2 : (3, 3) of the world point.
    force_world_N : (3,) the object's force on the antenna, world frame.
    moment_residual_Nm : reading less what the fitted contact predicts.
    """

    frame: int
    time_s: float
    status: str
    in_contact: bool = False
    model: str = ""
    distance_m: float = np.nan
    distance_std_m: float = np.nan
    force_y_N: float = np.nan
    force_y_std_N: float = np.nan
    force_z_N: float = np.nan
    force_z_std_N: float = np.nan
    deflection_y_m: float = np.nan
    deflection_z_m: float = np.nan
    point_antenna_m: np.ndarray = field(default_factory=lambda: _unknown(3))
    point_world_m: np.ndarray = field(default_factory=lambda: _unknown(3))
    covariance_world_m2: np.ndarray = field(default_factory=lambda: _unknown(3, 3))
    force_world_N: np.ndarray = field(default_factory=lambda: _unknown(3))
    moment_residual_Nm: float = np.nan
    reason: str = ""

    @staticmethod
    def of(frame: int, time_s: float, contact: Contact) -> ContactRow:
        """The row of one estimated frame."""
        return ContactRow(
            frame=frame,
            time_s=time_s,
            status=contact.status,
            in_contact=contact.in_contact,
            model=contact.model,
            distance_m=contact.distance_m,
            distance_std_m=contact.distance_std_m,
            force_y_N=contact.force_N[1],
            force_y_std_N=contact.force_std_N[1],
            force_z_N=contact.force_N[2],
            force_z_std_N=contact.force_std_N[2],
            deflection_y_m=contact.deflection_m[1],
            deflection_z_m=contact.deflection_m[2],
            point_antenna_m=contact.point_antenna_m,
            point_world_m=contact.point_world_m,
            covariance_world_m2=contact.covariance_world_m2,
            force_world_N=contact.force_world_N,
            moment_residual_Nm=contact.moment_residual_Nm,
            reason=contact.reason,
        )


@dataclass(frozen=True, eq=False)
class ContactTable:
    """`ContactRow` by columns for B frames: (B,), (B, 3) or (B, 3, 3); NaN where a number does not exist."""

    frame: np.ndarray
    time_s: np.ndarray
    status: np.ndarray
    in_contact: np.ndarray
    model: np.ndarray
    distance_m: np.ndarray
    distance_std_m: np.ndarray
    force_y_N: np.ndarray
    force_y_std_N: np.ndarray
    force_z_N: np.ndarray
    force_z_std_N: np.ndarray
    deflection_y_m: np.ndarray
    deflection_z_m: np.ndarray
    point_antenna_m: np.ndarray
    point_world_m: np.ndarray
    covariance_world_m2: np.ndarray
    force_world_N: np.ndarray
    moment_residual_Nm: np.ndarray
    reason: np.ndarray

    @staticmethod
    def from_rows(rows: Sequence[ContactRow]) -> ContactTable:
        """The same rows, at least one, as columns."""
        return ContactTable(**{f.name: np.array([getattr(row, f.name) for row in rows]) for f in fields(ContactTable)})

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def located(self) -> np.ndarray:
        """(B,) bool: the contact point of this frame may be used."""
        return np.isin(self.status, LOCATED)


def write_contacts(path: Path, rows: Sequence[ContactRow], force: bool = False) -> None:
    """Write contacts.csv, whole or not at all. Raises InputError when it exists and `force` is off."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *EXTRA_COLUMNS])
    for row in rows:
        cells = _cells(row)
        writer.writerow([cells[name] for name in (*COLUMNS, *EXTRA_COLUMNS)])
    write_text(Path(path), text.getvalue(), force)


def _cells(row: ContactRow) -> dict[str, str]:
    cells = {
        "frame": str(int(row.frame)),
        "time_s": f"{row.time_s:.9g}",
        "status": row.status,
        "in_contact": str(bool(row.in_contact)).lower(),
        "model": row.model,
        "reason": " ".join(row.reason.split()),
    }
    numbers = {name: getattr(row, name) for name in _SCALARS}
    for name, columns in _VECTORS.items():
        value = getattr(row, name)
        numbers |= zip(columns, value[_UPPER] if value.ndim == 2 else value, strict=True)
    return cells | {name: f"{value:.9g}" if np.isfinite(value) else "" for name, value in numbers.items()}


def read_contacts(path: Path) -> ContactTable:
    """Read contacts.csv.

    Raises
    ------
    InputError : a missing file, column or number, an unknown status, a frame that stands twice, times that run
        backwards, a covariance that is none; with file, line and remedy.
    """
    path = Path(path)
    rows: list[ContactRow] = []
    lines: dict[int, str] = {}
    for record in read_csv(path, COLUMNS, EXTRA_COLUMNS):
        row, where = _row(record, path), f"{path} line {record['line']}"
        if row.frame in lines:
            raise InputError(
                f"frame {row.frame} stands already in line {lines[row.frame]}", where=where, remedy="keep one of them"
            )
        if rows and row.time_s < rows[-1].time_s:
            raise InputError(
                f"time_s runs backwards, {rows[-1].time_s:g} to {row.time_s:g}", where=where, remedy="sort by time"
            )
        lines[row.frame] = record["line"]
        rows.append(row)
    return ContactTable.from_rows(rows)


def _row(record: Mapping[str, str], path: Path) -> ContactRow:
    where = f"{path} line {record['line']}"
    frame = number(record, "frame", path)
    if frame < 0 or frame != int(frame):
        raise InputError(f"frame is {record['frame']}", where=where, remedy="a whole number from 0 on is needed")
    if record["status"] not in STATUSES:
        raise InputError(
            f"status is {record['status']!r}", where=where, remedy=f"one of {', '.join(STATUSES)} is needed"
        )
    if record["in_contact"].lower() not in _BOOLEANS:
        raise InputError(f"in_contact is {record['in_contact']!r}", where=where, remedy="true or false is needed")
    values: dict = {name: _optional(record, name, path) for name in _SCALARS}
    for name in values:
        if name.endswith(("_std_m", "_std_N")) and values[name] < 0:
            raise InputError(f"{name} is {record[name]}", where=where, remedy="a standard deviation is not negative")
    values |= {name: _vector(record, columns, path) for name, columns in _VECTORS.items()}
    if record["status"] in LOCATED:
        if not _BOOLEANS[record["in_contact"].lower()]:
            raise InputError(f"is {record['status']} without being in contact", where=where, remedy="mend the row")
        for name in _NEEDED_WHEN_LOCATED:
            if not np.isfinite(values[name]).all():
                columns = ", ".join(_VECTORS.get(name, (name,)))
                remedy = "give it, or a status that says why it is missing"
                raise InputError(f"{columns} is empty in a row that is {record['status']}", where=where, remedy=remedy)
    values["covariance_world_m2"] = _covariance(values["covariance_world_m2"], where)
    return ContactRow(
        frame=int(frame),
        time_s=number(record, "time_s", path),
        status=record["status"],
        in_contact=_BOOLEANS[record["in_contact"].lower()],
        model=record["model"],
        reason=record["reason"],
        **values,
    )


def _optional(record: Mapping[str, str], column: str, path: Path) -> float:
    return number(record, column, path) if record.get(column) else np.nan


def _vector(record: Mapping[str, str], columns: Sequence[str], path: Path) -> np.ndarray:
    value = np.array([_optional(record, column, path) for column in columns])
    if np.isnan(value).any() and not np.isnan(value).all():
        where = f"{path} line {record['line']}"
        raise InputError(f"only some of {', '.join(columns)} are given", where=where, remedy="give all or none")
    return value


def _covariance(upper: np.ndarray, where: str) -> np.ndarray:
    """(6,) upper triangle to (3, 3), checked."""
    matrix = np.empty((3, 3))
    matrix[_UPPER] = matrix.T[_UPPER] = upper
    if np.isfinite(upper).all():
        smallest, _, largest = np.linalg.eigvalsh(matrix)
        if smallest < -1e-6 * max(largest, 1e-30):
            remedy = "check cov_XX to cov_ZZ: no direction may have a negative variance"
            raise InputError("the covariance of the world point is not one", where=where, remedy=remedy)
    return matrix
