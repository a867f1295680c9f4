"""CSV tables: read as rows of text, a long one row by row, with the numbers in their cells; written from rows.

Cells are separated by commas, semicolons or tabs, as in the header; lines that begin with # are comments. Between
semicolons numbers may have decimal commas, as spreadsheets write them where these are usual.
"""

from __future__ import annotations

import csv
import io
import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from .errors import InputError
from .files import FILE_LIMITS, require_file

_NOTHING: Mapping[str, str] = {}
_LONGEST = 1_000_000
"""Characters of a line, beyond which it is none of a table."""
MOST_WHOLE = 2**53
"""Whole numbers below are exact as floats."""
_BETWEEN = (",", ";", "\t")
_DECIMAL = re.compile(r"[+-]?\d*([.,])\d+(?:[eE][+-]?\d+)?")


def read_csv(
    path: Path, columns: Sequence[str], optional: Sequence[str] = (), instead: Mapping[str, str] = _NOTHING
) -> list[dict[str, str]]:
    """All rows of a table at once, as `csv_rows` yields them and with its errors; for files that fit into memory."""
    require_file(path, most=FILE_LIMITS.most_bytes)
    return list(csv_rows(path, columns, optional, instead))


def csv_rows(
    path: Path, columns: Sequence[str], optional: Sequence[str] = (), instead: Mapping[str, str] = _NOTHING
) -> Iterator[dict[str, str]]:
    """Yields the rows of a table with a header, as text; each also has its place in the file as `line`.

    Raises InputError, when it comes to it, for a missing file, header, column or cell, and for a table without rows.
    Columns beyond those named are ignored, and so are blank lines. `instead` names a column that may stand in the place
    of a missing one; the row then has that.
    """
    rows = _filled(path)
    _, header = next(rows, (0, []))
    if not header:
        raise InputError("is empty", where=path, remedy=f"the first line must name the columns {','.join(columns)}")
    wanted = [
        instead.get(name, name) if name not in header and instead.get(name) in header else name for name in columns
    ]
    places, line = places_of(header, wanted, optional, path), 0
    for line, cells in rows:
        if len(cells) != len(header):
            what = f"has {len(cells)} cells, the header {len(header)}"
            raise InputError(what, where=f"{path} line {line}", remedy="mend the row")
        yield {name: cells[at] for name, at in places.items()} | {"line": str(line)}
    if line == 0:
        raise InputError("has a header but no rows", where=path, remedy="add at least one row")


def csv_text(rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ()) -> str:
    """A table as CSV text; missing cells are empty. columns : by default the keys of the first row."""
    text = io.StringIO()
    names = columns or list(rows[0])
    writer = csv.DictWriter(text, names, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def header_of(path: Path) -> list[str]:
    """The names of a table's columns; empty for an empty file. Raises InputError as `csv_rows`."""
    return next(_filled(path), (0, []))[1]


def _filled(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of each row that is not blank, the header first."""
    require_file(path)
    line, fresh = 1, True

    def without_comments(lines: Iterator[str]) -> Iterator[str]:
        nonlocal fresh  # at the beginning of a row: a cell in quotes may go on with a line that looks like a comment
        for text in lines:
            begins, fresh = fresh, False
            yield "\n" if begins and text.startswith("#") else text

    try:
        with Path(path).open(encoding="utf-8-sig") as stream:
            begin, header = _beginning(_lines(stream))
            between = max(_BETWEEN, key=(header or begin[-1] if begin else "").count)
            if header is not None:
                line = len(begin) - 1
                yield line, [cell.strip() for cell in next(csv.reader([header], delimiter=between))]
            reader = csv.reader(chain(begin, without_comments(_lines(stream))), strict=True, delimiter=between)
            marks = set[str]()
            while (cells := next(reader, None)) is not None:
                cells = [cell.strip() for cell in cells]
                if between == ";":
                    marks |= {found[1] for cell in cells if (found := _DECIMAL.fullmatch(cell))}
                    if len(marks) > 1:
                        raise csv.Error("numbers with decimal commas, and others with decimal points")
                    if marks == {","}:
                        cells = [cell.replace(",", ".") if _DECIMAL.fullmatch(cell) else cell for cell in cells]
                if any(cells):
                    yield reader.line_num, cells
                line, fresh = reader.line_num + 1, True  # where an error is, if one is
    except csv.Error as error:
        where = f"{path} line {line}"
        raise InputError(f"is not a valid CSV ({error})", where=where, remedy="write it again") from None
    except UnicodeDecodeError:
        raise InputError("is not UTF-8 text", where=path, remedy="save it as UTF-8") from None
    except OSError as error:
        what = f"cannot be read ({error.strerror})"
        raise InputError(what, where=path, remedy="check the path and its permissions") from None


def _beginning(lines: Iterator[str]) -> tuple[list[str], str | None]:
    """The lines up to the first row, comments and preamble replaced by blank ones, and the header if it is a comment.

    The last comment is the header if it has as many cells as the first row, none of them a number, and the row has
    numbers."""
    begin, comment = list[str](), ""
    for text in lines:
        if not text.startswith("#") and not text.startswith("sep=") and text.strip(" \t\r\n,;"):
            names = comment.lstrip("# ").strip()
            between = max(_BETWEEN, key=names.count)
            first, named = text.split(between), names.split(between)
            numbers = [sum(map(_is_number, cells)) for cells in (first, named)]
            is_header = len(named) == len(first) > 1 and numbers[0] > numbers[1] == 0
            return [*begin, text], names if is_header else None
        comment = text if text.startswith("#") else comment
        begin.append("\n")
    return begin, None


def _is_number(text: str) -> bool:
    with suppress(ValueError):
        return math.isfinite(float(text))
    return False


def _lines(stream: TextIO) -> Iterator[str]:
    """The lines of a stream. Raises csv.Error for one that does not end."""
    while line := stream.readline(_LONGEST):
        if len(line) == _LONGEST and not line.endswith("\n"):
            raise csv.Error(f"a line of over {_LONGEST} characters")
        if "\0" in line:  # Python takes it, and no name of a file may hold it
            raise csv.Error("a zero byte")
        yield line


def places_of(header: Sequence[str], columns: Sequence[str], optional: Sequence[str], path: Path) -> dict[str, int]:
    """Index of each wanted column, and of the optional ones that exist. Raises InputError for a missing one."""
    known = [*columns, *(name for name in optional if name in header)]
    for name in known:
        if header.count(name) == 1:
            continue
        problem = "is missing" if name not in header else "stands twice"
        raise InputError(f"column {name} {problem}", where=path, remedy=f"the columns {','.join(columns)} are needed")
    return {name: header.index(name) for name in known}


def plain_rows(lines: bytes, count: int, places: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Whole lines of `count` cells parsed by NumPy: the cells (R, K) of the columns `places`, and the first and last
    byte (R,) of each row; None unless all of these cells are plain numbers. Blank lines are left out."""
    returns = lines.count(b"\r")
    if b'"' in lines or (returns and returns != lines.count(b"\r\n")):
        return None
    data = np.frombuffer(lines if lines.endswith(b"\n") else lines + b"\n", np.uint8)
    ends = np.flatnonzero(data == ord("\n")) + 1
    begins = np.concatenate([[0], ends[:-1]])
    filled = ends - begins > 1 + (data[begins] == ord("\r"))
    cells = np.empty((0, len(places)))
    if filled.any():
        try:
            cells = loaded(lines, count, places)
        except ValueError:
            return None
    if len(cells) != filled.sum() or not np.isfinite(cells).all():
        return None
    return cells, begins[filled], np.minimum(ends[filled], len(lines))


def loaded(lines: bytes, count: int, places: Sequence[int]) -> np.ndarray:
    """(N, K) columns of whole lines of `count` cells. Raises ValueError for lines with another number of cells, for
    cells of these columns that are not numbers, and for text that is not ASCII."""
    if len(lines) < 1 << 18 and "pyarrow.csv" not in sys.modules:  # what is parsed more quickly than Arrow loads
        text, codes = lines.decode("ascii"), np.frombuffer(lines, np.uint8)
        ends, commas = np.flatnonzero(codes < 32), np.flatnonzero(codes == ord(","))
        plain = len(ends) > 0 and ends[-1] == len(codes) - 1 and (codes[ends] == ord("\n")).all()
        even = plain and (np.diff(np.searchsorted(commas, ends), prepend=0) == count - 1).all()
        if not even and any(line.count(",") != count - 1 for line in text.splitlines() if line):
            raise ValueError(f"lines of other than {count} cells")
        return np.loadtxt(io.StringIO(text), delimiter=",", comments=None, usecols=places, ndmin=2)
    import pyarrow
    from pyarrow import csv as arrow_csv

    names, wanted = [str(column) for column in range(count)], [str(column) for column in places]
    table = arrow_csv.read_csv(
        pyarrow.BufferReader(lines),
        arrow_csv.ReadOptions(column_names=names, use_threads=False, block_size=len(lines) + 1),
        arrow_csv.ParseOptions(quote_char=False),
        arrow_csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pyarrow.float64()), include_columns=wanted, null_values=[]
        ),
    )
    return np.column_stack([table.column(name).to_numpy() for name in wanted])


def plain_columns(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> dict[str, np.ndarray] | None:
    """The columns (R,) of a file of finite numbers, read fast; None for any other, which `csv_rows` reads or
    refuses."""
    with suppress(OSError, UnicodeDecodeError, InputError):
        require_file(path, most=FILE_LIMITS.most_bytes)
        first, _, lines = path.read_bytes().partition(b"\n")
        header = [name.strip() for name in first.decode("utf-8-sig").split(",")]
        places = places_of(header, columns, optional, path)
        rows = plain_rows(lines, len(header), list(places.values())) if lines else None
        if rows is not None and len(rows[0]):
            return dict(zip(places, rows[0].T.copy(), strict=True))
    return None


def number(row: Mapping[str, str], column: str, path: Path) -> float:
    """A finite number in a CSV row. Raises InputError naming file, line and column."""
    text, place = row[column], f"{path} line {row['line']}"
    try:
        # float() reads 1_0 as 10; in a table it is a slip of the pen
        value = float(text.replace("_", "?"))
    except ValueError:
        remedy = "write it with a decimal point" if "," in text else "a number in SI units is needed"
        raise InputError(f"{column} is {text!r}", where=place, remedy=remedy) from None
    if not math.isfinite(value):
        raise InputError(f"{column} is {text}", where=place, remedy="a finite number in SI units is needed")
    return value


def whole_number(row: Mapping[str, str], column: str, path: Path) -> int:
    """A whole number, 0 or more, in a CSV row. Raises InputError naming file, line and column."""
    value, place = number(row, column, path), f"{path} line {row['line']}"
    if not 0 <= value < MOST_WHOLE or value != int(value):
        raise InputError(f"{column} is {row[column]}", where=place, remedy="a whole number from 0 on is needed")
    return int(value)
