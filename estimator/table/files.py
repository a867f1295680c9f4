"""contacts.csv and contacts.parquet: a row for every frame, whatever its status; several where a frame has several
contacts."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from functools import lru_cache
from itertools import chain, count, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vbaa_calib.core.arrays import PLAUSIBLE, validate_arguments
from vbaa_calib.core.csv_rows import MOST_WHOLE, csv_rows, number, whole_number
from vbaa_calib.core.errors import InputError, quoted
from vbaa_calib.core.files import most_memory, replacing, require_file
from vbaa_calib.native import core

from .contacts import (
    COLUMNS,
    LOCATED,
    NEEDED,
    OPTIONAL,
    REQUIRED,
    STATUSES,
    ContactRow,
    ContactTable,
    column_names,
    columns_of,
)

if TYPE_CHECKING:
    import pyarrow
    from pyarrow.parquet import ParquetWriter

_PARQUET = ".parquet"
_ROW_GROUP = 4096  # rows of a Parquet row group
_ROWS_TOGETHER = 1024  # rows that are put into columns at once: as columns they take a fifth of the room
_UPPER = np.triu_indices(3)
_NAMES = {field: column_names([field]) for field in COLUMNS}
_DIGITS = {name: column.digits for field, column in COLUMNS.items() for name in _NAMES[field]}
_FORMATS = [f"%.{digits}g" if digits else "%r" for digits in _DIGITS.values()]
_SPECIAL = re.compile(r'[",\r\n]')
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}
_TEXTS = (
    "frame",
    "time_s",
    "status",
    "in_contact",
    "model",
    "reason",
    "contact",
    "antenna",
)  # are read in a way of their own


def check_format(path: Path) -> None:
    """Raises InputError for a suffix that is neither .csv nor .parquet."""
    if path.suffix not in (".csv", _PARQUET):
        raise InputError("is neither .csv nor .parquet", where=path, remedy="the suffix chooses the format")


@validate_arguments
def write_contacts(
    path: Path, rows: Iterable[ContactRow | ContactTable], force: bool = False, about: dict[bytes, bytes] | None = None
) -> None:
    """Write one or more rows, completely or not at all, as Parquet or CSV (nine digits) by the suffix.

    Each is written as it comes: a generator of rows, or of tables, may be longer than the memory. `about` is the
    metadata of a Parquet file, complete after the last row.

    Raises InputError when the file exists and `force` is off.
    """
    path, left = Path(path), iter(rows)
    begun = list(islice(left, 1))
    coming: Iterator[Any] = chain(begun, left)
    whole = bool(begun) and isinstance(begun[0], ContactTable)
    with replacing(path, force) as temporary:
        if path.suffix == _PARQUET:
            _write_parquet(temporary, _table_groups(coming) if whole else _row_groups(coming), about)
            return
        named = not whole and any("antenna" in cells_of(row) for row in begun)
        with temporary.open("w", encoding="utf-8", newline="") as stream:
            stream.write(header_line(named))
            stream.writelines(map(_lines, coming) if whole else (row_line(cells_of(row)) for row in coming))


def _write_parquet(path: Path, groups: Iterable[Mapping[str, Any]], about: dict[bytes, bytes] | None) -> None:
    """Write groups of rows by their columns; nothing if there are none."""
    import pyarrow

    with ExitStack() as open_files:
        parquet = None
        for group in groups:
            table = pyarrow.table(group)
            parquet = parquet or open_files.enter_context(_parquet_writer(path, table.schema))
            parquet.write_table(table)
        if parquet is not None and about:
            parquet.add_key_value_metadata(about)


def _row_groups(rows: Iterator[Any]) -> Iterator[dict[str, list[Any]]]:
    while several := [cells_of(row) for row in islice(rows, _ROW_GROUP)]:
        yield {name: [cells[name] for cells in several] for name in several[0]}


def _table_groups(tables: Iterator[Any]) -> Iterator[dict[str, np.ndarray]]:
    """Groups of Parquet columns, from tables of one antenna with a clamp that does not move."""
    several = list[ContactTable]()
    for table in chain(tables, [None]):
        several += [] if table is None else [table]
        if several and (table is None or sum(map(len, several)) >= _ROW_GROUP):
            yield _columns_of(ContactTable.joined(several))
            several.clear()


def _columns_of(table: ContactTable) -> dict[str, np.ndarray]:
    """The file's columns (B,) of a table, without those of named antennas; NaN for missing numbers."""
    found = dict[str, np.ndarray]()
    for field, names in _NAMES.items():
        values = getattr(table, field)
        values = values[:, _UPPER[0], _UPPER[1]] if values.ndim == 3 else values
        found |= {name: values if values.ndim == 1 else values[:, at] for at, name in enumerate(names)}
    found["reason"] = np.array([" ".join(words.split()) for words in table.reason.tolist()], object)
    return {name: found[name] for name in columns_of(False)}


def _lines(table: ContactTable) -> str:
    """The lines of contacts.csv of a table, as `row_line` writes them."""
    numbers, digits, texts = list[np.ndarray](), list[int](), list[list[str]]()
    nothing = np.full(len(table), np.nan)
    for name, values in _columns_of(table).items():
        is_text = values.dtype.kind not in "fi"
        words = np.where(values, "true", "false") if values.dtype == bool else values
        texts += [words.tolist()] if is_text else []
        digits.append(0 if is_text else _DIGITS[name] if values.dtype == float else 17)
        numbers.append(nothing if is_text else values)
    found: str = core.table.lines(np.column_stack(numbers), np.array(digits, np.intc), texts)
    return found


def _parquet_writer(path: Path, schema: pyarrow.Schema) -> ParquetWriter:
    """A writer that uses dictionaries for texts alone: those of numbers would take three times the space."""
    import pyarrow
    from pyarrow.parquet import ParquetWriter

    texts = [column.name for column in schema if pyarrow.types.is_string(column.type)]
    return ParquetWriter(path, schema, use_dictionary=texts)


def header_line(named: bool = False) -> str:
    """The first line of contacts.csv, with or without names of antennas."""
    return ",".join(columns_of(named)) + "\n"


@lru_cache(maxsize=16)
def _format(kinds: tuple[type, ...]) -> tuple[str, list[int]]:
    """The format of a line with cells of these types where all numbers exist, and which cells are no floats."""
    forms = [form if kind is float else "%s" for form, kind in zip(_FORMATS, kinds, strict=False)]
    return ",".join(forms) + "\n", [place for place, kind in enumerate(kinds) if kind is not float]


def row_line(cells: Mapping[str, Any]) -> str:
    """A line of contacts.csv from the result of `cells_of`. Where all numbers exist, the usual case, it is written by
    one format."""
    values = list(cells.values())
    form, others = _format(tuple(map(type, values)))
    if math.isfinite(sum(value for value in values if type(value) is float)):
        for place in others:
            values[place] = _quoted(_text(values[place]))
        return form % tuple(values)
    return ",".join(map(_quoted, map(_text, values, _DIGITS.values()))) + "\n"


def _quoted(text: str) -> str:
    """A cell, quoted as `csv` does."""
    return '"' + text.replace('"', '""') + '"' if _SPECIAL.search(text) else text


@validate_arguments
def read_contacts(path: Path, several: bool = False, antenna: str | None = None) -> ContactTable:
    """Read contacts from a CSV, or from a Parquet file by its suffix.

    Parameters
    ----------
    several : whether a frame may have several contacts, one row each, with numbers of their own in the column contact;
        else such a frame is one row without contact (`ContactTable.without_pairs`).
    antenna : the one to take of a table of several antennas.

    Raises
    ------
    InputError : a missing file, column or number, an unknown status, a duplicate frame, times that run backwards, a
        matrix that is no covariance; with file, line and remedy.
    """
    path = Path(path)
    if path.suffix != _PARQUET and antenna is None and (quick := _plain_table(path)) is not None:
        return quick
    read = _parquet_rows if path.suffix == _PARQUET else csv_rows
    rows: list[ContactRow] = []
    parts: list[ContactTable] = []
    lines: dict[tuple[int, int, str], str] = {}
    names: dict[str, int] = {}
    time_s = -np.inf
    for record in read(path, column_names(REQUIRED), column_names(OPTIONAL)):
        row, where = _row_of(record, path), f"{path} line {record['line']}"
        names[row.antenna] = names.get(row.antenna, 0) + 1
        if antenna is not None and row.antenna != antenna:
            continue
        key = row.frame, row.contact, row.antenna
        if key in lines:
            what = f"frame {row.frame} stands already in line {lines[key]}"
            raise InputError(what, where=where, remedy="keep one of them, or number them in the column contact")
        if row.time_s < time_s:
            raise InputError(f"time_s runs backwards, {time_s:g} to {row.time_s:g}", where=where, remedy="sort by time")
        lines[key], time_s = record["line"], row.time_s
        rows.append(row)
        if len(rows) == _ROWS_TOGETHER:
            parts.append(ContactTable.from_rows(rows))
            rows.clear()
    if rows:
        parts.append(ContactTable.from_rows(rows))
    if len(names) > 1 and antenna is None:
        what = f"has contacts of {len(names)} antennas, {', '.join(names)}: only one is supported here"
        raise InputError(what, where=path, remedy="name one: --antenna NAME")
    if names and not parts:
        raise InputError(f"has no antenna {antenna}", where=path, remedy=f"there are {', '.join(filter(None, names))}")
    if not parts:
        raise InputError("has no rows", where=path, remedy="one for every frame is needed")
    table = ContactTable.joined(parts)
    if (alone := ~np.isin(table.frame, table.frame[table.contact == 0])).any():
        what = f"frame {int(table.frame[alone][0])} has a further contact, but none that is 0"
        raise InputError(what, where=path, remedy="number a frame's contacts from 0 in the column contact")
    return table if several else table.without_pairs()


def _plain_table(path: Path) -> ContactTable | None:
    """The table of a CSV in the form that `write_contacts` writes, read by columns; None for any other, or one that
    is not in order, which `read_contacts` reads or refuses row by row."""
    try:
        # small ones are read before Arrow is loaded, large ones would take much memory
        data = path.read_bytes() if 1 << 18 < path.stat().st_size < 1 << 26 else b""
    except OSError:
        return None
    header = data.partition(b"\n")[0].decode("utf-8", "replace").rstrip("\r").split(",")
    needed, known = column_names(REQUIRED), set(column_names(REQUIRED)) | set(column_names(OPTIONAL))
    if (
        "antenna" in header
        or len(set(header)) < len(header)
        or not set(needed) <= set(header)
        or b"\n#" in data
        or b"\0" in data
    ):
        return None
    import pyarrow
    from pyarrow import csv as arrow_csv

    texts = ("status", "in_contact", "model", "reason")
    kinds = {name: pyarrow.string() if name in texts else pyarrow.float64() for name in header if name in known}
    convert = arrow_csv.ConvertOptions(column_types=kinds, include_columns=list(kinds), null_values=[""])
    try:
        options = arrow_csv.ReadOptions(use_threads=False)
        table = arrow_csv.read_csv(pyarrow.BufferReader(data), options, convert_options=convert)
    except pyarrow.ArrowInvalid:
        return None
    words = {name: np.array([text.strip() for text in table.column(name).to_pylist()]) for name in texts}
    numbers = {name: table.column(name).to_numpy() for name in kinds if name not in texts}
    if any(np.isfinite(each).sum() != len(each) - table.column(name).null_count for name, each in numbers.items()):
        return None  # infinite, or NaN in letters
    values = {
        field: numbers.get(names[0], np.full(len(table), np.nan))
        if len(names) == 1
        else np.column_stack([numbers.get(name, np.full(len(table), np.nan)) for name in names])
        for field, names in _NAMES.items()
        if field not in texts
    }
    values["contact"] = np.nan_to_num(values["contact"])
    values["antenna"] = np.full(len(table), "")
    lower = np.char.lower(words["in_contact"])
    upper = values.pop("covariance_world_m2")
    matrices = np.empty((len(table), 3, 3))
    matrices[:, *_UPPER] = matrices[:, _UPPER[1], _UPPER[0]] = upper
    if not len(table) or not np.isin(lower, list(_BOOLEANS)).all():
        return None
    whole = {name: values.pop(name) for name in ("frame", "contact")}
    if any(not ((each >= 0) & (each < MOST_WHOLE) & (each == np.floor(each))).all() for each in whole.values()):
        return None
    found = ContactTable(
        **values,
        **{name: each.astype(int) for name, each in whole.items()},
        **{name: words[name] for name in ("status", "model", "reason")},
        in_contact=np.isin(lower, [name for name, is_true in _BOOLEANS.items() if is_true]),
        covariance_world_m2=matrices,
    )
    return found if _in_order(found) else None


def _in_order(table: ContactTable) -> bool:
    """Whether every row of a table fulfils what `_row_of` and `read_contacts` require, with one contact a frame."""
    columns = {name: np.asarray(getattr(table, name)).reshape(len(table), -1) for name in COLUMNS if name not in _TEXTS}
    missing = [np.isnan(each).sum(axis=1) for each in columns.values()]
    widths = [each.shape[1] for each in columns.values()]
    partly = any(((count > 0) & (count < wide)).any() for count, wide in zip(missing, widths, strict=True))
    negative = any((each < 0.0).any() for name, each in columns.items() if "_std_" in name and each.shape[1] == 1)
    length = np.linalg.norm(table.tangent_world, axis=1)
    located = table.picked(table.located)
    needed = all(np.isfinite(getattr(located, name)).all() for name in NEEDED)
    reached = (located.distance_m > 0.0) & (located.distance_m < PLAUSIBLE.place_m)
    known = np.isfinite(table.covariance_world_m2).all(axis=(1, 2))
    variances = np.linalg.eigvalsh(table.covariance_world_m2[known])
    return bool(
        np.isin(table.status, list(STATUSES)).all()
        and not (table.contact.any() or partly or negative)
        and (np.isnan(length) | (np.abs(length - 1.0) <= 1e-3)).all()
        and located.in_contact.all()
        and needed
        and reached.all()
        and (variances[:, 0] >= -1e-6 * np.maximum(variances[:, 2], 1e-30)).all()
        and len(np.unique(table.frame)) == len(table)
        and (np.diff(table.time_s) >= 0.0).all()
    )


def rewrite_contacts(
    path: Path, changed: Callable[[int, str, str], tuple[str, str]], about: dict[bytes, bytes] | None = None
) -> None:
    """Change status and reason of rows in a file of `write_contacts`, completely or not at all, row by row.

    changed : from a row's number, counted from 0, its status and reason to the new status and reason. All else stays to
    the digit, and so does a Parquet file's metadata, to which `about` is added.
    """
    number = count()

    def cells(statuses: Iterable[str], reasons: Iterable[str]) -> list[tuple[str, str]]:
        pairs = [changed(next(number), *pair) for pair in zip(statuses, reasons, strict=True)]
        return [(status, " ".join(reason.split())) for status, reason in pairs]

    with ExitStack() as open_files:
        temporary = open_files.enter_context(replacing(path, True))
        if path.suffix == _PARQUET:
            import pyarrow
            from pyarrow.parquet import ParquetFile

            before = open_files.enter_context(ParquetFile(path))
            kept = {key: value for key, value in before.metadata.metadata.items() if key != b"ARROW:schema"}
            after = open_files.enter_context(_parquet_writer(temporary, before.schema_arrow))
            for index in range(before.num_row_groups):
                table = before.read_row_group(index)
                pairs = cells(*(table[name].to_pylist() for name in ("status", "reason")))
                for name, values in zip(("status", "reason"), zip(*pairs, strict=True), strict=True):
                    place = table.column_names.index(name)
                    table = table.set_column(place, table.schema.field(place), pyarrow.array(values, pyarrow.string()))
                after.write_table(table)
            after.add_key_value_metadata(kept | (about or {}))
            return
        old = open_files.enter_context(path.open(encoding="utf-8", newline=""))
        new = open_files.enter_context(temporary.open("w", encoding="utf-8", newline=""))
        rows, writer = csv.reader(old), csv.writer(new, lineterminator="\n")
        header = next(rows)
        writer.writerow(header)
        status, reason = header.index("status"), header.index("reason")
        for row in rows:
            ((row[status], row[reason]),) = cells([row[status]], [row[reason]])
            writer.writerow(row)


def cells_of(row: ContactRow | ContactTable) -> dict[str, int | float | bool | str]:
    """Column → value in the order of the columns; NaN for missing numbers. Raises InputError."""
    if not isinstance(row, ContactRow):
        raise InputError(f"a row is {quoted(row)}", remedy="give a ContactRow for each frame")
    values, cells = vars(row), list[Any]()
    for field, names in _NAMES.items():
        value = values[field]
        if len(names) == 1:  # most of them: NumPy would take longer than all else
            cells.append(
                value if type(value) in (float, int, str, bool) else value.item() if hasattr(value, "item") else value
            )
        elif len(names) == 3:
            cells += value.tolist() if type(value) is np.ndarray else value
        else:  # the upper triangle
            (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(value).tolist()
            cells += xx, xy, xz, yy, yz, zz
    found = dict(zip(columns_of(bool(row.antenna)), cells, strict=False))
    found["reason"] = " ".join(row.reason.split())
    return found


def _text(value: Any, digits: int = 0) -> str:
    """A cell; "" for missing values. Floats with all digits, or with `digits`."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float) and digits:
        return f"{value:.{digits}g}" if math.isfinite(value) else ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def _parquet_rows(path: Path, columns: tuple[str, ...], optional: tuple[str, ...]) -> Iterator[dict[str, str]]:
    """Rows as text, as `csv_rows` yields them: "" for null and NaN, and the row's number from 1 on as `line`."""
    import pyarrow
    from pyarrow.parquet import ParquetFile

    require_file(path)
    line = 0
    try:
        with ParquetFile(path) as file:
            groups = [file.metadata.row_group(index) for index in range(file.num_row_groups)]
            largest = max((group.total_byte_size for group in groups), default=0)
            # bytes of memory that a row takes as columns
            if file.metadata.num_rows * 700 + largest > most_memory(path.stat().st_size):
                what = f"unpacks to {file.metadata.num_rows} rows, {largest / 1e6:.0f} MB at once"
                raise InputError(what, where=path, remedy="it is damaged or forged: write it again")
            names = file.schema_arrow.names
            for missing in (name for name in columns if name not in names):
                remedy = f"the columns {','.join(columns)} are needed"
                raise InputError(f"column {missing} is missing", where=path, remedy=remedy)
            known = [name for name in (*columns, *optional) if name in names]
            for batch in file.iter_batches(_ROW_GROUP, columns=known):
                for record in batch.to_pylist():
                    line += 1
                    yield {name: _text(value) for name, value in record.items()} | {"line": str(line)}
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        why = str(error).partition("\n")[0]
        raise InputError(f"is not a valid Parquet file ({why})", where=path, remedy="write it again") from None


def _row_of(record: Mapping[str, str], path: Path) -> ContactRow:
    """The row from a record of texts; `line` is its place in the file. Raises InputError for a wrong cell."""
    where, status = f"{path} line {record['line']}", record["status"]
    if status not in STATUSES:
        raise InputError(f"status is {status!r}", where=where, remedy=f"one of {', '.join(STATUSES)} is needed")
    if record["in_contact"].lower() not in _BOOLEANS:
        raise InputError(f"in_contact is {record['in_contact']!r}", where=where, remedy="true or false is needed")
    in_contact = _BOOLEANS[record["in_contact"].lower()]
    values = {name: _numbers(record, name, path) for name in COLUMNS if name not in _TEXTS}
    tangent = values["tangent_world"]
    if np.isfinite(tangent).all() and abs(np.linalg.norm(tangent) - 1.0) > 1e-3:
        raise InputError(
            "TX, TY, TZ is not of length 1", where=where, remedy="give the antenna's unit tangent, or none"
        )
    if status in LOCATED:
        if not in_contact:
            raise InputError(f"is {status} without being in contact", where=where, remedy="mend the row")
        for name in NEEDED:
            if not np.isfinite(values[name]).all():
                what = f"{', '.join(_NAMES[name])} is empty in a row that is {status}"
                raise InputError(what, where=where, remedy="give it, or a status that says why it is missing")
        if not 0.0 < values["distance_m"] < PLAUSIBLE.place_m:
            what = f"distance_m is {values['distance_m']:g} in a row that is {status}"
            raise InputError(what, where=where, remedy="give metres from the clamp along the antenna, above 0")
    upper, matrix = values["covariance_world_m2"], np.empty((3, 3))
    matrix[_UPPER] = matrix.T[_UPPER] = upper
    if np.isfinite(upper).all():
        smallest, _, largest = np.linalg.eigvalsh(matrix)
        if smallest < -1e-6 * max(largest, 1e-30):
            remedy = "check cov_XX to cov_ZZ: no direction may have a negative variance"
            raise InputError("cov_XX to cov_ZZ are no covariance", where=where, remedy=remedy)
    values["covariance_world_m2"] = matrix
    return ContactRow(
        frame=whole_number(record, "frame", path),
        time_s=number(record, "time_s", path),
        status=status,
        in_contact=in_contact,
        model=record["model"],
        reason=record["reason"],
        contact=whole_number(record, "contact", path) if record.get("contact") else 0,
        antenna=record.get("antenna", ""),
        **values,
    )


def _numbers(record: Mapping[str, str], field: str, path: Path) -> Any:
    """A field's number, or its vector (K,); NaN where it is empty."""
    names, where = _NAMES[field], f"{path} line {record['line']}"
    values = [number(record, name, path) if record.get(name) else math.nan for name in names]
    if len(values) > 1:
        if 0 < sum(map(math.isnan, values)) < len(values):
            raise InputError(f"only some of {', '.join(names)} are given", where=where, remedy="give all or none")
        return np.array(values)
    if "_std_" in field and values[0] < 0:
        raise InputError(f"{field} is {record[field]}", where=where, remedy="a standard deviation is not negative")
    return values[0]
