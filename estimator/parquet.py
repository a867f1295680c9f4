"""Parquet files by pyarrow, which is needed for nothing else and so may be missing."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from vbaa_calib.errors import InputError
from vbaa_calib.files import replacing, require_file

TOGETHER = 4096
"""Rows of a row group."""


def require_arrow(path: Path) -> Any:
    """The package pyarrow with its Parquet part. Raises InputError naming the file that needs it."""
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError:
        remedy = "pip install vbaa-calib[parquet], or take the suffix .csv"
        raise InputError("Parquet needs the package pyarrow", where=path, remedy=remedy) from None


def write_parquet(path: Path, rows: Iterable[Mapping[str, Any]], force: bool) -> None:
    """Write rows of the same columns, at least one, as they come, whole or not at all; NaN stays NaN.

    Raises InputError as `files.replacing` does.
    """
    arrow = require_arrow(path)
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


def read_parquet(path: Path, columns: Sequence[str], optional: Sequence[str]) -> Iterator[dict[str, str]]:
    """Rows as text, as `csv_rows` gives them: "" for null and NaN, and the row's number from 1 on as `line`.

    Raises InputError for a missing or damaged file, or a missing column.
    """
    arrow = require_arrow(path)
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
