"""One row of contacts.csv: from a frame's result to its cells, and back with every cell checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from vbaa_calib.csv_rows import number, whole_number
from vbaa_calib.errors import InputError

from .contact_row import LOCATED, STATUSES, ContactRow

Cell = int | float | bool | str

_SCALARS = (
    "distance_m",
    "distance_std_m",
    "force_y_N",
    "force_y_std_N",
    "force_z_N",
    "force_z_std_N",
    "deflection_y_m",
    "deflection_z_m",
)
_EXTRA_SCALARS = (
    "friction_angle_rad",
    "friction_angle_std_rad",
    "bias_std",
    "condition",
    "pan_rad",
    "tilt_rad",
    "evidence",
    "friction_prior_rad",
)
_VECTORS = {
    "point_antenna_m": ("x_m", "y_m", "z_m"),
    "point_world_m": ("X_m", "Y_m", "Z_m"),
    "covariance_world_m2": ("cov_XX", "cov_XY", "cov_XZ", "cov_YY", "cov_YZ", "cov_ZZ"),
    "force_world_N": ("FX_N", "FY_N", "FZ_N"),
    "tangent_world": ("TX", "TY", "TZ"),
}
_NUMBERS = (*_SCALARS, "moment_residual_Nm", *_EXTRA_SCALARS)
_UPPER = np.triu_indices(3)

COLUMNS = (
    *("frame", "time_s", "status", "in_contact", "model"),
    *_SCALARS,
    *_VECTORS["point_antenna_m"],
    *_VECTORS["point_world_m"],
    *_VECTORS["covariance_world_m2"],
    *("moment_residual_Nm", "reason"),
)
"""What every contacts.csv has."""
EXTRA_COLUMNS = (*_VECTORS["force_world_N"], *_EXTRA_SCALARS, *_VECTORS["tangent_world"])
"""What ours has besides; optional when read."""
_NEEDED_WHEN_LOCATED = ("distance_m", "force_y_N", "force_z_N", "point_antenna_m", "point_world_m")
_DEVIATIONS = ("_std_m", "_std_N", "_std_rad")
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


def cells(row: ContactRow) -> dict[str, Cell]:
    """Column → value in the order of the columns; NaN where a number does not exist."""
    values: dict[str, Cell] = {
        "frame": int(row.frame),
        "time_s": float(row.time_s),
        "status": row.status,
        "in_contact": bool(row.in_contact),
        "model": row.model,
        "reason": " ".join(row.reason.split()),
    }
    values |= {name: float(getattr(row, name)) for name in _NUMBERS}
    for name, columns in _VECTORS.items():
        value = getattr(row, name)
        values |= zip(columns, (value[_UPPER] if value.ndim == 2 else value).tolist(), strict=True)
    return {name: values[name] for name in (*COLUMNS, *EXTRA_COLUMNS)}


def row_of(record: Mapping[str, str], path: Path) -> ContactRow:
    """The row behind a record of texts, whose place in the file is its `line`. Raises InputError for a wrong cell."""
    where = f"{path} line {record['line']}"
    if record["status"] not in STATUSES:
        raise InputError(
            f"status is {record['status']!r}", where=where, remedy=f"one of {', '.join(STATUSES)} is needed"
        )
    if record["in_contact"].lower() not in _BOOLEANS:
        raise InputError(f"in_contact is {record['in_contact']!r}", where=where, remedy="true or false is needed")
    in_contact = _BOOLEANS[record["in_contact"].lower()]
    values: dict = {name: _optional(record, name, path) for name in _NUMBERS}
    for name in values:
        if name.endswith(_DEVIATIONS) and values[name] < 0:
            raise InputError(f"{name} is {record[name]}", where=where, remedy="a standard deviation is not negative")
    values |= {name: _vector(record, columns, path) for name, columns in _VECTORS.items()}
    tangent = values["tangent_world"]
    if np.isfinite(tangent).all() and abs(np.linalg.norm(tangent) - 1.0) > 1e-3:
        raise InputError(
            "TX, TY, TZ is not of length 1", where=where, remedy="give the antenna's unit tangent, or none"
        )
    if record["status"] in LOCATED:
        _check_located(values, record["status"], in_contact, where)
    values["covariance_world_m2"] = _covariance(values["covariance_world_m2"], where)
    return ContactRow(
        frame=whole_number(record, "frame", path),
        time_s=number(record, "time_s", path),
        status=record["status"],
        in_contact=in_contact,
        model=record["model"],
        reason=record["reason"],
        **values,
    )


def _check_located(values: Mapping[str, float | np.ndarray], status: str, in_contact: bool, where: str) -> None:
    if not in_contact:
        raise InputError(f"is {status} without being in contact", where=where, remedy="mend the row")
    for name in _NEEDED_WHEN_LOCATED:
        if not np.isfinite(values[name]).all():
            columns = ", ".join(_VECTORS.get(name, (name,)))
            remedy = "give it, or a status that says why it is missing"
            raise InputError(f"{columns} is empty in a row that is {status}", where=where, remedy=remedy)


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
