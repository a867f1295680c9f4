"""What the calibration benchmark leaves: a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from .calibration_run import Row
from .rows import cell

_TITLE = (
    "mm on C: median of {draws} draws, its pose told; jig: its pose solved with the same lens; × oracle: of medians, "
    "then of root mean squares; s: median of one solve; lost: good corners left out; caught: outliers left out"
)


def as_text(rows: Sequence[Row], draws: int) -> str:
    """The table for people."""
    head = (
        f"{'rig':<34}{'method':<23}{'mm on C':>8}{'× oracle':>14}{'mm, jig':>9}{'× oracle':>14}{'s':>8}"
        f"{'folds %':>8}{'lost %':>8}{'caught %':>9}"
    )
    lines = [_TITLE.format(draws=draws), head]
    rig = ""
    for row in rows:
        shown, rig = (row.rig if row.rig != rig else ""), row.rig
        lines.append(f"{shown:<34}{row.method:<23}" + (_numbers(row) if row.seconds is not None else row.note))
    return "\n".join(lines)


def _numbers(row: Row) -> str:
    cells = (
        (row.error_mm, 8, 4, 1),
        (row.ratio, 7, 3, 1),
        (row.rms_ratio, 7, 3, 1),
        (row.jig_error_mm, 9, 4, 1),
        (row.jig_ratio, 7, 3, 1),
        (row.jig_rms_ratio, 7, 3, 1),
        (row.seconds, 8, 3, 1),
        (row.folds, 8, 0, 100),
        (row.good_dropped, 8, 2, 100),
        (row.outliers_found, 9, 1, 100),
    )
    remark = "; ".join(part for part in (row.models, row.note) if part)
    return "".join(cell(*each) for each in cells) + (f"  {remark}" if remark else "")
