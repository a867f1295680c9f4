"""contacts.csv and contacts.parquet: one row per frame, whatever became of it."""

from __future__ import annotations

import csv
import importlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from vbaa_calib.core.csv_rows import csv_rows, number, whole_number
from vbaa_calib.core.errors import InputError
from vbaa_calib.core.files import replacing, require_file

from .contacts import LOCATED, STATUSES, ContactRow, ContactTable

TOGETHER = 4096
"""Rows of a row group."""


def _require_arrow(path: Path) -> Any:
    """The package pyarrow with its Parquet part. Raises InputError naming the file that needs it."""
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError:
        remedy = "pip install vbaa-calib[parquet], or take the suffix .csv"
        raise InputError("Parquet needs the package pyarrow", where=path, remedy=remedy) from None


def _write_parquet(path: Path, rows: Iterable[Mapping[str, Any]], force: bool) -> None:
    """Write rows of the same columns, at least one, as they come, whole or not at all; NaN stays NaN.

    Raises InputError as `files.replacing` does.
    """
    arrow = _require_arrow(path)
    rest, writer = iter(rows), None
    with replacing(path, force) as temporary:
        try:
            while several := list(islice(rest, TOGETHER)):
                table = arrow.table({name: [row[name] for row in several] for name in several[0]})
                writer = arrow.parquet.ParquetWriter(temporary, table.schema) if writer is None else writer
                writer.write_table(table)
        finally:
            if writer is not None:
                writer.close()


def _read_parquet(path: Path, columns: Sequence[str], optional: Sequence[str]) -> Iterator[dict[str, str]]:
    """Rows as text, as `csv_rows` gives them: "" for null and NaN, and the row's number from 1 on as `line`.

    Raises InputError for a missing or damaged file, or a missing column.
    """
    arrow = _require_arrow(path)
    require_file(path)
    line = 0
    try:
        with arrow.parquet.ParquetFile(path) as file:
            known = _known(file.schema_arrow.names, columns, optional, path)
            for batch in file.iter_batches(TOGETHER, columns=known):
                data = batch.to_pydict()
                for values in zip(*(data[name] for name in known), strict=True):
                    line += 1
                    yield dict(zip(known, map(_text, values), strict=True)) | {"line": str(line)}
    except (arrow.ArrowException, OSError) as error:
        why = str(error).partition("\n")[0]
        raise InputError(f"is not a valid Parquet file ({why})", where=path, remedy="write it again") from None


def _known(names: Sequence[str], columns: Sequence[str], optional: Sequence[str], path: Path) -> list[str]:
    for name in columns:
        if name not in names:
            remedy = f"the columns {','.join(columns)} are needed"
            raise InputError(f"column {name} is missing", where=path, remedy=remedy)
    return [*columns, *(name for name in optional if name in names)]


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


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


def _row_of(record: Mapping[str, str], path: Path) -> ContactRow:
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


__all__ = [
    "COLUMNS",
    "EXTRA_COLUMNS",
    "LOCATED",
    "STATUSES",
    "ContactRow",
    "ContactTable",
    "check_format",
    "read_contacts",
    "write_contacts",
]

PARQUET = ".parquet"
ROWS_TOGETHER = 1024
"""Rows that are put into columns at once: as columns they take a fifth of the room."""


def check_format(path: Path) -> None:
    """Raises InputError for a suffix that is neither .csv nor .parquet, or a Parquet file that could not be written."""
    if path.suffix == PARQUET:
        _require_arrow(path)
    elif path.suffix != ".csv":
        raise InputError("is neither .csv nor .parquet", where=path, remedy="the suffix chooses the format")


def write_contacts(path: Path, rows: Iterable[ContactRow], force: bool = False) -> None:
    """Write the rows, at least one, whole or not at all, as Parquet or CSV (nine digits) by suffix.

    Each is written as it comes: a generator of rows may be longer than the memory.

    Raises InputError when the file exists and `force` is off.
    """
    path = Path(path)
    if path.suffix == PARQUET:
        _write_parquet(path, map(cells, rows), force)
        return
    with replacing(path, force) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*COLUMNS, *EXTRA_COLUMNS])
        for row in rows:
            writer.writerow([_cell_text(name, value) for name, value in cells(row).items()])


def _cell_text(name: str, value: Cell) -> str:
    if isinstance(value, float):
        digits = 15 if name == "time_s" else 9  # a clock that counts from 1970 has spent nine on whole seconds
        return f"{value:.{digits}g}" if np.isfinite(value) else ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def read_contacts(path: Path) -> ContactTable:
    """Read contacts from a CSV, or from a Parquet file by its suffix.

    Raises
    ------
    InputError : a missing file, column or number, an unknown status, a frame that stands twice, times that run
        backwards, a covariance that is none; with file, line and remedy.
    """
    path = Path(path)
    read = _read_parquet if path.suffix == PARQUET else csv_rows
    records: Iterable[dict[str, str]] = read(path, COLUMNS, EXTRA_COLUMNS)
    rows: list[ContactRow] = []
    parts: list[ContactTable] = []
    lines: dict[int, str] = {}
    time_s = -np.inf
    for record in records:
        row, where = _row_of(record, path), f"{path} line {record['line']}"
        if row.frame in lines:
            raise InputError(
                f"frame {row.frame} stands already in line {lines[row.frame]}", where=where, remedy="keep one of them"
            )
        if row.time_s < time_s:
            raise InputError(f"time_s runs backwards, {time_s:g} to {row.time_s:g}", where=where, remedy="sort by time")
        lines[row.frame], time_s = record["line"], row.time_s
        rows.append(row)
        if len(rows) == ROWS_TOGETHER:
            parts.append(ContactTable.from_rows(rows))
            rows.clear()
    if rows:
        parts.append(ContactTable.from_rows(rows))
    if not parts:
        raise InputError("has no rows", where=path, remedy="one for every frame is needed")
    return ContactTable.joined(parts)
