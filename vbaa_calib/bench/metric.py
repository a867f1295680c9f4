"""`vbaa bench metric`: pixels to rays, speed against error, beside OpenCV and kornia."""

from __future__ import annotations

from collections.abc import Sequence

from .metric_report import as_text, write_figure
from .metric_run import EXACT_PX, Row, run
from .subject import Findings, Options

REPEATS = {False: 5, True: 3}
"""Timings of each number, without and with --quick."""


def measure(options: Options) -> Findings:
    """Every method on every lens; a draw is a random pixel."""
    rows = run(options.draws, options.seed, REPEATS[options.quick])
    return Findings(
        as_text(rows, options.draws),
        {"metric.csv": rows},
        {"metric.png": lambda path, force: write_figure(path, rows, options.draws, force)},
        {"rows": rows},
        headline(rows),
    )


def headline(rows: Sequence[Row]) -> str:
    """Our error, and OpenCV's times at the accuracy that it needs most steps for."""
    ours = [row for row in rows if row.method == "this layer"]
    times = [_equal(rows, row.lens, "OpenCV").ratio for row in ours]
    silent = 100 * max(row.silent for row in ours)
    return (
        f"error ≤ {max(row.error_px for row in ours):.0e} px, silently wrong {silent:.0f} %; at equal accuracy OpenCV "
        f"takes {min(times):.1f} to {max(times):.0f} times as long"
    )


def _equal(rows: Sequence[Row], lens: str, family: str) -> Row:
    """Of one family the quickest method that is exact, or as good as it gets."""
    own = [row for row in rows if row.lens == lens and row.method.startswith(family)]
    best = min(row.error_px for row in own)
    return min((row for row in own if row.error_px <= max(EXACT_PX, 2.0 * best)), key=lambda row: row.batch_ms)
