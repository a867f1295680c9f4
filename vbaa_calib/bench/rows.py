"""Rows of a benchmark to a CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ..files import write_text


def write_csv(path: Path, rows: Sequence[Any], force: bool) -> None:
    """One line per row (at least one dataclass instance), columns named by its fields; empty where a value is None."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(asdict(rows[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_text(path, text.getvalue(), force)
