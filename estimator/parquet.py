"""Parquet files by pyarrow, which is needed for nothing else and so may be missing."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vbaa_calib.errors import InputError
from vbaa_calib.files import replacing


def require_arrow(path: Path) -> Any:
    """The package pyarrow with its Parquet part. Raises InputError naming the file that needs it."""
    try:
        importlib.import_module("pyarrow.parquet")
        return importlib.import_module("pyarrow")
    except ImportError:
        remedy = "pip install vbaa-calib[parquet], or take the suffix .csv"
        raise InputError("Parquet needs the package pyarrow", where=path, remedy=remedy) from None


def write_parquet(path: Path, columns: Mapping[str, Sequence[Any]], force: bool) -> None:
    """Write columns of one length, whole or not at all; NaN stays NaN. Raises InputError as `files.replacing` does."""
    arrow = require_arrow(path)
    table = arrow.table(dict(columns))
    with replacing(path, force) as temporary:
        arrow.parquet.write_table(table, temporary)


def read_parquet(path: Path, columns: Sequence[str], optional: Sequence[str]) -> Iterator[dict[str, str]]:
    """Rows as text, as `files.read_csv` gives them: "" for null and NaN, and the row's number from 1 on as `line`.

    Raises InputError for a missing or damaged file, or a missing column.
    """
    arrow = require_arrow(path)
    if not path.is_file():
        raise InputError(
            "is a folder, not a file" if path.is_dir() else "no such file", where=path, remedy="check the path"
        )
    try:
        with arrow.parquet.ParquetFile(path) as file:
            data = file.read().to_pydict()
    except (arrow.ArrowException, OSError) as error:
        why = str(error).partition("\n")[0]
        raise InputError(f"is not a valid Parquet file ({why})", where=path, remedy="write it again") from None
    for name in columns:
        if name not in data:
            remedy = f"the columns {','.join(columns)} are needed"
            raise InputError(f"column {name} is missing", where=path, remedy=remedy)
    known = [*columns, *(name for name in optional if name in data)]
    for line, values in enumerate(zip(*(data[name] for name in known), strict=True), start=1):
        yield dict(zip(known, map(_text, values), strict=True)) | {"line": str(line)}


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
