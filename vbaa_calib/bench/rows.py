"""Rows of a benchmark: to a CSV, to JSON, to the cells of a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files import write_text


def write_csv(path: Path, rows: Sequence[Any], force: bool) -> None:
    """One line per row (at least one dataclass instance), columns named by its fields; empty where there is no number.

    That is where a value is None, NaN or infinite. Several words in one cell are separated by semicolons.
    """
    lines = [{name: _joined(value) for name, value in as_json(row).items()} for row in rows]
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(lines[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    write_text(path, text.getvalue(), force)


def _joined(value: Any) -> Any:
    return "; ".join(map(str, value)) if isinstance(value, list) else value


def as_json(value: Any) -> Any:
    """Dataclasses, sequences and NumPy's numbers as what JSON knows; None for NaN and infinity."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if is_dataclass(value):
        return {field.name: as_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def cell(value: float | None, width: int, digits: int, scale: float = 1.0) -> str:
    """A number set to the right, times `scale`; a dash where there is none."""
    return f"{'–':>{width}}" if value is None else f"{scale * value:>{width}.{digits}f}"
