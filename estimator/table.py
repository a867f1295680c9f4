"""contacts.csv and contacts.parquet: one row per frame, whatever became of it."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from vbaa_calib.csv_rows import csv_rows
from vbaa_calib.errors import InputError
from vbaa_calib.files import replacing

from .contact_row import LOCATED, STATUSES, ContactRow, ContactTable
from .parquet import read_parquet, require_arrow, write_parquet
from .table_cells import COLUMNS, EXTRA_COLUMNS, Cell, cells, row_of

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
TOGETHER = 1024
"""Rows that are put into columns at once: as columns they take a fifth of the room."""


def check_format(path: Path) -> None:
    """Raises InputError for a suffix that is neither .csv nor .parquet, or a Parquet file that could not be written."""
    if path.suffix == PARQUET:
        require_arrow(path)
    elif path.suffix != ".csv":
        raise InputError("is neither .csv nor .parquet", where=path, remedy="the suffix chooses the format")


def write_contacts(path: Path, rows: Iterable[ContactRow], force: bool = False) -> None:
    """Write the rows, at least one, whole or not at all, as Parquet or CSV (nine digits) by suffix.

    Each is written as it comes: a generator of rows may be longer than the memory.

    Raises InputError when the file exists and `force` is off.
    """
    path = Path(path)
    if path.suffix == PARQUET:
        write_parquet(path, map(cells, rows), force)
        return
    with replacing(path, force) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*COLUMNS, *EXTRA_COLUMNS])
        for row in rows:
            writer.writerow([_text(name, value) for name, value in cells(row).items()])


def _text(name: str, value: Cell) -> str:
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
    read = read_parquet if path.suffix == PARQUET else csv_rows
    records: Iterable[dict[str, str]] = read(path, COLUMNS, EXTRA_COLUMNS)
    rows: list[ContactRow] = []
    parts: list[ContactTable] = []
    lines: dict[int, str] = {}
    time_s = -np.inf
    for record in records:
        row, where = row_of(record, path), f"{path} line {record['line']}"
        if row.frame in lines:
            raise InputError(
                f"frame {row.frame} stands already in line {lines[row.frame]}", where=where, remedy="keep one of them"
            )
        if row.time_s < time_s:
            raise InputError(f"time_s runs backwards, {time_s:g} to {row.time_s:g}", where=where, remedy="sort by time")
        lines[row.frame], time_s = record["line"], row.time_s
        rows.append(row)
        if len(rows) == TOGETHER:
            parts.append(ContactTable.from_rows(rows))
            rows.clear()
    if rows:
        parts.append(ContactTable.from_rows(rows))
    if not parts:
        raise InputError("has no rows", where=path, remedy="one for every frame is needed")
    return ContactTable.joined(parts)
