"""contacts.csv and contacts.parquet: one row per frame, whatever became of it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from vbaa_calib.errors import InputError
from vbaa_calib.files import read_csv, write_text

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


def check_format(path: Path) -> None:
    """Raises InputError for a suffix that is neither .csv nor .parquet, or a Parquet file that could not be written."""
    if path.suffix == PARQUET:
        require_arrow(path)
    elif path.suffix != ".csv":
        raise InputError("is neither .csv nor .parquet", where=path, remedy="the suffix chooses the format")


def write_contacts(path: Path, rows: Sequence[ContactRow], force: bool = False) -> None:
    """Write the rows, at least one, whole or not at all, as Parquet or CSV (nine digits) by suffix.

    Raises InputError when the file exists and `force` is off.
    """
    path = Path(path)
    table = [cells(row) for row in rows]
    if path.suffix == PARQUET:
        write_parquet(path, {name: [line[name] for line in table] for name in table[0]}, force)
        return
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *EXTRA_COLUMNS])
    writer.writerows([_text(name, value) for name, value in line.items()] for line in table)
    write_text(path, text.getvalue(), force)


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
    read = read_parquet if path.suffix == PARQUET else read_csv
    records: Iterable[dict[str, str]] = read(path, COLUMNS, EXTRA_COLUMNS)
    rows: list[ContactRow] = []
    lines: dict[int, str] = {}
    for record in records:
        row, where = row_of(record, path), f"{path} line {record['line']}"
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
    if not rows:
        raise InputError("has no rows", where=path, remedy="one for every frame is needed")
    return ContactTable.from_rows(rows)
