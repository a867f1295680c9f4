"""What the calibration benchmark leaves: a table for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from .calibration import Row


def as_text(rows: Sequence[Row], draws: int) -> str:
    """The table for people."""
    head = (
        f"{'rig':<36}{'method':<24}{'mm on C':>9}{'× oracle':>10}{'mm, jig':>9}{'× oracle':>10}{'s':>8}"
        f"{'folds %':>9}{'lost %':>8}{'caught %':>10}"
    )
    title = (
        f"medians of {draws} draws; mm on C: its pose is told; jig: its pose is solved with the same lens; "
        "lost: good corners left out; caught: outliers left out"
    )
    lines = [title, head]
    rig = ""
    for row in rows:
        shown, rig = (row.rig if row.rig != rig else ""), row.rig
        numbers = (
            (row.error_mm, 9, 4, 1),
            (row.ratio, 10, 3, 1),
            (row.jig_error_mm, 9, 4, 1),
            (row.jig_ratio, 10, 3, 1),
            (row.seconds, 8, 3, 1),
            (row.folds, 9, 0, 100),
            (row.good_dropped, 8, 2, 100),
            (row.outliers_found, 10, 1, 100),
        )
        cells = (_cell(value, width, digits, scale) for value, width, digits, scale in numbers)
        lines.append(f"{shown:<36}{row.method:<24}" + (row.note if row.error_mm is None else "".join(cells)))
    return "\n".join(lines)


def _cell(value: float | None, width: int, digits: int, scale: float) -> str:
    return f"{'–':>{width}}" if value is None else f"{scale * value:>{width}.{digits}f}"
