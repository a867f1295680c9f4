"""A picture and a table of a session that is being written."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2)
"""Quick rather than small: a session has hundreds of pictures."""


def write_picture(path: Path, picture: np.ndarray) -> None:
    """A picture (H, W) uint8 as PNG."""
    path.write_bytes(cv2.imencode(".png", picture, _PNG)[1].tobytes())


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """At least one row as CSV; the columns are the first one's keys."""
    with path.open("w", encoding="utf-8", newline="") as table:
        writer = csv.DictWriter(table, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
