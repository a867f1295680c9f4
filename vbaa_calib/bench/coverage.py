"""`vbaa bench coverage`: do whole calibrations know how wrong they are?"""

from __future__ import annotations

from collections.abc import Sequence

from .coverage_report import as_text, write_figure
from .coverage_run import Row, run
from .subject import Findings, Options


def measure(options: Options) -> Findings:
    """Every quantity on every rig; a draw is one calibration."""
    rows, rigs = run(options.draws, options.seed, options.jobs)
    return Findings(
        as_text(rows, rigs, options.draws),
        {"coverage.csv": rows, "coverage_rigs.csv": rigs},
        {"coverage.png": lambda path, force: write_figure(path, rows, options.draws, force)},
        {"rows": rows, "rigs": rigs},
        headline(rows),
    )


def headline(rows: Sequence[Row]) -> str:
    """Of the quantities with a goal: how many meet it, and the span of sampled over predicted deviations."""
    judged = [row for row in rows if row.judged]
    if not judged:
        return "no rig could be calibrated twice"
    ratios = [row.ratio for row in judged]
    met = sum(row.met for row in judged)
    return (
        f"goal met by {met} of {len(judged)}; sampled over predicted deviation {min(ratios):.2f} to {max(ratios):.2f}"
    )
